"""The answer of a run in the files that people apply it by: only what the shots tell leaves in them."""
