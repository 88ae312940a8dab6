"""Studies over a grid of settings: their files, how they are carried out, and what they answer."""
