"""Many runs at once: which files, what is kept of each."""
