"""Many runs at once: solved piece by piece, a folder of results, tables and one page over all."""
