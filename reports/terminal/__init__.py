"""What a person reads in the terminal: answers, and a run under way."""
