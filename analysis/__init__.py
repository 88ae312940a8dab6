"""What follows from the model: identifiability, fit, covariance, posterior, influence."""
