"""Plans: patterns, candidate postures, obstacles, and the choice among them."""
