"""SLIM (Nachi AX, FD): joint positions of programs, MOVEX … M1J.

Facts, as published programs and post processors agree on them (RoboDK, Cenit): M1J is followed by the joints
of mechanism 1, degrees, joint 1 first; P moves by joints and L in a straight line. A plan is not written as a
program: that R, S and T make it slow, and what stops it, is not certain from what is published.
"""

from __future__ import annotations

import re

from ....model.kinematics.orientation import from_abc, orientation
from ..line_language import LineLanguage

SLIM = LineLanguage(
    name="SLIM",
    grammar="nachi/slim",
    remark=r"'[^\n]*",
    head=r"\A",
    comment="'",
    pose=from_abc,  # of tools and frames; no position of a program is a pose
    numbers=lambda pose: [*pose[:3, 3].tolist(), *orientation(pose[:3, :3]).abc],
    form="X,Y,Z,r,p,y",
    joint_decimals=3,
    remark_width=31,
    literal=re.compile(r"(?<=\()[^()\n]*(?:,[^()\n]*){5,}(?=\))"),
)
