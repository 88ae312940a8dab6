"""An arm alone in 3D, and the page with it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from ...model.arrays import Matrix
from ...model.files.whole_file import refuse_existing, write_whole
from ...model.kinematics.robot import Robot
from ...words.wording import clipped, counted
from ..output.html import scene_html
from .scene import Posed, Scene3D, floor_of
from .turnable import SceneWords, turnable


def write_arm_page(path: Path, robot: Robot, postures: Sequence[Matrix]) -> None:
    """The page with the arm in `postures`, (n,) rad or mm each, as one HTML file; never over another file."""
    refuse_existing(path, or_else="choose another name, or remove it first")
    write_whole(path, arm_page(robot, postures))


def arm_page(robot: Robot, postures: Sequence[Matrix]) -> str:
    """Its text."""
    theta = ca.SX.sym("theta", robot.n)
    skeleton = ca.Function("skeleton", [theta], [ca.densify(robot.skeleton(theta))])
    posed = []
    for i, joints in enumerate(postures):
        arm = np.array(skeleton(joints)).T
        posed.append(Posed(f"posture {i}", arm, arm[-1], None, True))
    scene = Scene3D(posed, [], floor_of(robot))
    name = clipped(robot.name, 40)
    words = SceneWords(
        alt=f"{name}: the arm as a line through its joints in {counted(len(posed), 'posture')}, above a floor"
        " grid.",
        caption=f"{scene.grid_words}; x, y and z are the base frame. The line ends at the flange.",
        paper="On paper: posture 0 in black, the others in grey.",
        one="posture",
        laser=False,
    )
    return scene_html(f"Robot {name}", turnable(scene, words))
