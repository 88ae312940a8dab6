"""Rigs that carry a plan out: a simulated cell, a recorded run, an ABB controller."""
