"""The paper's experiments in the simulated world, both methods on the same bytes."""
