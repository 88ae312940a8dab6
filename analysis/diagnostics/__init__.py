"""Tests of a fit, and what it means at the TCP."""
