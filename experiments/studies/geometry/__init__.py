"""The study of arms that deviate from nominal geometry: links off by their tolerances."""
