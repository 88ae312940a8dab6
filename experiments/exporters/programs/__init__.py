"""A plan as a program for a robot's controller, one file for each language."""
