"""One palette, one typeface, one canvas; the blocks that all pages are made of."""
