"""Turnable pictures of a run or a plan, and the page of a plan."""
