"""The table of a conversion of taught positions, and its folder."""
