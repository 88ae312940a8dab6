"""What carries a plan out: the interface of a rig, the simulated cell, a recorded run."""
