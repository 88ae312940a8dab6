"""What the residuals say of each recording: correlation, steps, and what else may explain them."""
