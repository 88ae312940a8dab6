"""The posterior, sampled by emcee."""
