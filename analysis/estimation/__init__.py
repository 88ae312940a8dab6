"""The fit: the mode of the posterior and its covariance, and what is asked of a fit."""
