"""How shots come about: patterns, procedure, simulated cell, importers, built-in demo runs."""
