"""The acceptance test of a corrected robot: a few new measurements against what its calibration predicts."""
