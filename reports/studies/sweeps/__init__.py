"""Page, tables and figures of a study over a grid of settings; their form follows from the axes."""
