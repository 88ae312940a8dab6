"""The offsets of a run in the files by which they are applied: only identifiable ones."""
