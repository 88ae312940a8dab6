"""What is measured with: one file a kind of instrument, and the registry of all of them."""
