"""The simulated cell."""
