"""What several tests share: benches, scripted devices, slow models."""
