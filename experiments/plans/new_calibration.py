"""The defaults of a new calibration: the header of an instrument at an arm, and how its plan is made.

They are written down here and nowhere else. Lengths grow with the arm's reach, so that an arm of any size
gets a plan; nothing is taken as calibrated that nobody has calibrated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from ...analysis.diagnostics.tcp_positions import spread_postures, within_limits
from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.instruments.registry import KINDS
from ...model.kinematics.robot import Robot

PlaceKind = Literal["front", "table", "floor", "point"]
Point = tuple[float, float, float]
Keys = dict[str, object]  # of a header, or a part of it

JOINT_DEG = 0.01  # noise of a joint
SPOT_MM = 0.05  # noise of a spot, or of the seat of a tip
TARGET_SIGMA_MM = 30.0  # how well a person states where a target is
TOLERANCE = 0.1  # standard uncertainty that the plan is to reach, deg (mm): that of a header
MOST_MEASUREMENTS = 30
CANDIDATES = 3000  # as good as 10,000 to a few per cent, in a third of the time
FEWER_CANDIDATES = 1000  # of what reads six numbers at once: each takes longer, and fewer measurements do
_OUT = 0.6  # of the reach: where a target stands in front of the arm
_HIGH = 0.1  # of the reach, above the base frame: on a stand
_SHORTEST_BEAM, _LONGEST_BEAM = 0.12, 1.4  # of the reach
_STATION_OUT = 2.2  # of the reach: where an instrument stands that looks at the flange
_SOCKETS = ((0.55, 0.2), (0.45, -0.3))  # of the reach: where the sockets of a ball bar are
_BAR = (0.15, 0.5)  # of the reach: its shortest and longest length
_ON_FLANGE: Point = (60.0, 0.0, 60.0)  # off the last axis, so that the last joint moves it
# A tip that nobody has calibrated rotates with the last joint: the sum of both alone is determined.
_TIPS = frozenset({"probe", "plane", "sphere", "ballbar", "dial"})
_FEW_NUMBERS = frozenset({"plane", "sphere", "ballbar", "dial"})
_POSTURES = 1024  # by which the reach is judged


@dataclass(frozen=True)
class PlaceChoice:
    """Where a target may be, in words; `facing` is the outward normal of its face."""

    kind: PlaceKind
    words: str
    facing: Point


PLACES: tuple[PlaceChoice, ...] = (
    PlaceChoice("front", "On a stand in front of the arm, its face up and towards the arm", (-0.5, 0.0, 1.0)),
    PlaceChoice("table", "On a table in front of the arm, at the height of its base", (0.0, 0.0, 1.0)),
    PlaceChoice("floor", "On the floor in front of the arm", (0.0, 0.0, 1.0)),
    PlaceChoice("point", "At a point that I state", (0.0, 0.0, 1.0)),
)
TITLES: Mapping[str, str] = {
    "laser": "Laser and PSD",
    "probe": "Probe in a socket",
    "tracker": "Laser tracker",
    "pose": "Pose camera",
    "plane": "Touches of flat faces",
    "sphere": "Touches of balls",
    "ballbar": "Ball bar",
    "dial": "Dial gauge on flat faces",
}


@dataclass(frozen=True)
class NewCalibration:
    """The keys of a header besides the robot, and the options of `zerobeam plan optimal`."""

    header: Keys
    options: tuple[str, ...]


def reach_of(robot: Robot) -> float:
    """How far from its first axis the arm's flange comes, mm, by postures spread over its ranges."""
    return _reach(robot)


@cache
def _reach(robot: Robot) -> float:
    lower = np.array([_bounded(joint.lower, joint.kind) for joint in robot.joints])
    upper = np.array([_bounded(joint.upper, joint.kind) for joint in robot.joints])
    postures = within_limits(robot, spread_postures(lower, upper, _POSTURES))
    at = np.array([robot.fk(row * robot.display)[:2, 3] for row in postures])
    return float(np.percentile(np.hypot(at[:, 0], at[:, 1]), 99))


def _bounded(limit: float, kind: str) -> float:
    return float(np.clip(limit, -np.pi, np.pi)) if kind == "revolute" else limit


def place_of(kind: PlaceKind, robot: Robot, point: Point | None) -> Point:
    """Where a target is, base frame, mm; BadInput without the point that is to be stated."""
    if (kind == "point") != (point is not None):
        raise BadInput(
            "the point is missing" if point is None else "a point is stated for another place",
            found=kind,
            allowed="point_mm with the place `point`, and with no other",
            argument="point_mm",
        )
    if point is not None:
        return point
    reach = reach_of(robot)
    height = {"front": _HIGH * reach, "table": 0.0, "floor": -(robot.conventions.below_base or 0.0)}[kind]
    return _at((_OUT * reach, 0.0, height))


def new_calibration(
    kind: str, robot: Robot, target: Point, facing: Point, measurements: int | None
) -> NewCalibration:
    """The header of an instrument of this kind with its target at `target`, and how its plan is made.

    `measurements` None: as few as reach the tolerance and detect a wrong model; of an instrument that reads a
    single number the most, as 30 do not detect all of them. BadInput for a kind of which
    there is no default.
    """
    make = _HEADERS.get(kind)
    if make is None:
        raise BadInput(
            "there is no default for this instrument",
            found=kind,
            allowed=", ".join(_HEADERS),
            remedy="write a header, and make a plan of it",
            argument="instrument",
        )
    reach = reach_of(robot)
    header = {"noise": {"joint_deg": JOINT_DEG, "spot_mm": SPOT_MM}} | make(robot, reach, target)
    if kind in _TIPS:
        header["held"] = ["delta1", f"delta{robot.n}"]
    options = [f"--candidates={FEWER_CANDIDATES if kind == 'pose' else CANDIDATES}"]
    if KINDS[kind].beam:
        shortest, longest = (round(share * reach, -1) for share in (_SHORTEST_BEAM, _LONGEST_BEAM))
        options += [f"--facing={_words(facing)}", f"--beam={shortest:g},{longest:g}"]
    if measurements is None and kind in _FEW_NUMBERS:
        measurements = MOST_MEASUREMENTS
    if measurements is None:
        options += [f"--tolerance={TOLERANCE:g}", f"--max-shots={MOST_MEASUREMENTS}"]
    else:
        options.append(f"--shots={measurements}")
    return NewCalibration(header, tuple(options))


def _words(numbers: Sequence[float]) -> str:
    return ",".join(f"{number:g}" for number in numbers)


def _at(point: Sequence[float] | Matrix) -> Point:
    """A point to the millimetre, as a person states it."""
    x, y, z = (round(float(number)) + 0.0 for number in point)
    return x, y, z


def _laser(robot: Robot, reach: float, target: Point) -> Keys:
    tool = {"kind": "laser", "calibrated": False, "point_mm": [0.0, 0.0, 65.0], "direction": [1.0, 0.0, 0.0]}
    return {"tool": tool, "targets": {"psd": _target(target)}}


def _probe(robot: Robot, reach: float, target: Point) -> Keys:
    tool = {"kind": "probe", "calibrated": False, "point_mm": [60.0, 0.0, 120.0]}
    return {"tool": tool, "targets": {"socket": _target(target)}}


def _tracker(robot: Robot, reach: float, target: Point) -> Keys:
    sigma = {"constant": 0.015, "per_m": 0.006}
    tracker = {"kind": "tracker", "sigma_mm": sigma, "guess_mm": _station(reach)}
    return {"instruments": {"tracker": tracker | {"reflectors": {"R1": {"guess_mm": list(_ON_FLANGE)}}}}}


def _pose(robot: Robot, reach: float, target: Point) -> Keys:
    camera = {"kind": "pose", "sigma_mm": 0.1, "sigma_deg": 0.03, "guess_mm": _station(reach), "mount": {}}
    return {"instruments": {"camera": camera}}


def _plane(robot: Robot, reach: float, target: Point) -> Keys:
    stylus = {"kind": "plane", "tip_mm": [60.0, 0.0, 120.0], "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
    return {"instruments": {"stylus": stylus}, "targets": _faces(target, ("top", "back", "side"))}


def _dial(robot: Robot, reach: float, target: Point) -> Keys:
    gauge = {"kind": "dial", "tip_mm": [60.0, 0.0, 120.0], "direction": [0.0, 0.0, 1.0], "sigma_mm": 0.01}
    faces = {name: row | {"radius_mm": 100.0} for name, row in _faces(target, ("top", "back")).items()}
    return {"instruments": {"gauge": gauge}, "targets": faces}


def _sphere(robot: Robot, reach: float, target: Point) -> Keys:
    stylus = {"kind": "sphere", "tip_mm": [60.0, 0.0, 120.0], "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
    balls = {
        name: {"kind": "sphere", "diameter_mm": 25.4} | _target(_at(np.add(target, (0.0, side * reach, 0.0))))
        for name, side in (("ball1", -0.15), ("ball2", 0.15))
    }
    return {"instruments": {"stylus": stylus}, "targets": balls}


def _ballbar(robot: Robot, reach: float, target: Point) -> Keys:
    lengths = [round(share * reach, -1) for share in _BAR]
    bar = {"kind": "ballbar", "tip_mm": [60.0, 0.0, 120.0], "sigma_mm": 0.005, "range_mm": lengths}
    sockets = {
        f"s{number}": _target(_at(np.add(target, ((out - _OUT) * reach, side * reach, 0.0))))
        for number, (out, side) in enumerate(_SOCKETS, start=1)
    }
    return {"instruments": {"bar": bar}, "targets": sockets}


def _target(at: Point) -> Keys:
    return {"guess_mm": list(at), "sigma_mm": TARGET_SIGMA_MM}


def _station(reach: float) -> list[float]:
    return list(_at((_STATION_OUT * reach, 0.35 * reach, 0.5 * reach)))


_NORMALS: Mapping[str, tuple[Point, Point]] = {  # of the faces of a block, and where each is on it
    "top": ((0.0, 0.0, 1.0), (0.0, 0.0, 50.0)),
    "back": ((-1.0, 0.0, 0.0), (-50.0, 0.0, 0.0)),
    "side": ((0.0, -1.0, 0.0), (0.0, -50.0, 0.0)),
}


def _faces(target: Point, names: Sequence[str]) -> dict[str, Keys]:
    faces = {}
    for name in names:
        normal, offset = _NORMALS[name]
        faces[name] = {"kind": "plane", "normal": list(normal)} | _target(_at(np.add(target, offset)))
    return faces


_HEADERS = {
    "laser": _laser,
    "probe": _probe,
    "tracker": _tracker,
    "pose": _pose,
    "plane": _plane,
    "sphere": _sphere,
    "ballbar": _ballbar,
    "dial": _dial,
}
