"""Programs that a person has: their targets corrected, every other byte as it was."""
