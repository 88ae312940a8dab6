"""The report of a run: one file a section, its figure beside it."""
