"""The report of an acceptance test: how far the robot was off before and after its calibration."""
