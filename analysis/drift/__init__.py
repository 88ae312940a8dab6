"""How the offsets of an arm change over its results: random walk, rare jumps, when the next result is due."""
