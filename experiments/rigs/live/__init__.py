"""Joints read from the controllers of real arms, which another program or a person moves."""
