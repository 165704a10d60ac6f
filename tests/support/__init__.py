"""What several tests share: rooms, and here counts of cases, papers, and jobs of sweeps."""
