"""What a study over a grid of settings shows: page, tables and figures, whose form follows from the axes."""
