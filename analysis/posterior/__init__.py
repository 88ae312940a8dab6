"""The posterior, sampled."""
