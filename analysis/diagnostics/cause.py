"""What a misfit can be put down to."""

from typing import Literal

Cause = Literal[
    "swapped_joints",
    "sign",
    "zero",
    "units",
    "coupling",
    "metres",
    "mirrored",
    "rows",
    "twist",
    "convention",
    "arm",
    "length",
    "tool",
    "spot",
    "placement",
    "measurements",
    "moved_target",
    "jump",
    "drift",
    "lag",
    "backlash",
    "gain",
    "noise",
    "geometry",
    "gravity",
    "harmonics",
]
