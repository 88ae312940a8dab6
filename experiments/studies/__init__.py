"""Studies over simulated runs: coverage, the cell, settings, Table 2 of the paper."""
