"""Formats of the makers of robots: offsets, plans and programs for controllers, recordings and points."""
