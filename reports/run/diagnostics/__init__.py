"""What a fit of a run is tested by, as sections of its report."""
