"""What speaks for or against a fit, and what it means at the TCP."""
