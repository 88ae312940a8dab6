"""Numbers and sentences as people read them, made once."""
