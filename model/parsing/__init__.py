"""Text that people write, YAML and JSON, and the models by which it is checked, line by line."""
