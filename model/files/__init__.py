"""Files in and out: what a person writes, checked line by line, and the journal of a run."""
