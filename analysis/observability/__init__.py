"""What the data can determine, before and after a measurement, and why not."""
