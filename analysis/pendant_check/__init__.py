"""An arm's file against poses that its pendant shows: which entry is wrong, if one is."""
