"""The study of arms that are not as drawn: links off by their tolerances."""
