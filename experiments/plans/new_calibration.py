"""The defaults of a new calibration: the header of an instrument at an arm, and how its plan is made.

What is stated of an instrument its kind says (`Instrument.proposed`), all else is written down here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np

from ...model.errors import BadInput
from ...model.instruments.kind import ON_THE_FLANGE, TARGET_OUT, Keys, Point, ProposedHeader, whole_point
from ...model.instruments.registry import KINDS, kind_names, kind_of
from ...model.kinematics.pendant import spread_postures, within_limits
from ...model.kinematics.robot import Robot

PlaceKind = Literal["front", "floor", "point"]

JOINT_DEG = 0.01  # noise of a joint
SPOT_MM = 0.05  # noise of a spot, or of the seat of a tip
TOLERANCE = 0.1  # standard uncertainty that the plan is to reach, deg (mm): that of a header
MOST_MEASUREMENTS = 30
CANDIDATES = 3000  # as good as 10,000 to a few per cent, in a third of the time
FEWER_CANDIDATES = 1000  # of what reads six numbers at once: each takes longer, and fewer measurements do
_HIGH = 0.1  # of the reach, above the base frame: on a stand
_SHORTEST_BEAM, _LONGEST_BEAM = 0.12, 1.4  # of the reach
_MANY = 6  # numbers of a reading
_POSTURES = 1024  # by which the reach is judged


@dataclass(frozen=True)
class PlaceChoice:
    """Where a target may be, in words; `facing` is the outward normal of its face."""

    kind: PlaceKind
    words: str
    facing: Point


PLACES: tuple[PlaceChoice, ...] = (
    PlaceChoice("front", "On a stand in front of the arm, its face up and towards the arm", (-0.5, 0.0, 1.0)),
    PlaceChoice("floor", "On the floor or table that the arm stands on, in front of it", (0.0, 0.0, 1.0)),
    PlaceChoice("point", "At a point that I state", (0.0, 0.0, 1.0)),
)


def titles() -> dict[str, str]:
    """The kinds that a person can choose, by name, and what each is called."""
    return {name: kind.title for name, kind in KINDS.items() if kind.title}


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
    at = np.array([robot.fk(row * robot.display, "deg")[:2, 3] for row in postures])
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
    height = _HIGH * reach if kind == "front" else -(robot.conventions.below_base or 0.0)
    return whole_point((TARGET_OUT * reach, 0.0, height))


def mounted_of(kind: str, robot: Robot) -> dict[str, Point]:
    """How an instrument of this kind is assumed to be mounted, by the keys of its header: flange frame, mm;
    nothing of one that states none of it. BadInput for a kind of which there is no default."""
    target = place_of("front", robot, None)
    part = _on_flange(_proposal(kind, reach_of(robot), target).header)
    return {key: part[key] for key in ON_THE_FLANGE if key in part}


def _on_flange(header: Keys) -> Any:
    """The part of a proposed header that states the instrument."""
    instruments: Any = header.get("instruments") or {"": header.get("tool")}
    return next(iter(instruments.values()))


def new_calibration(
    kind: str,
    robot: Robot,
    target: Point,
    facing: Point,
    measurements: int | None,
    mounted: Mapping[str, Point],
) -> NewCalibration:
    """The header of an instrument of this kind with its target at `target`, and how its plan is made.

    `mounted` is how it is on the flange, by those keys of `mounted_of` that are not as that assumes.
    `measurements` None: as few as reach the tolerance and detect a wrong model; of an instrument that reads a
    single number the most, as 30 do not detect all of them. BadInput for a kind of which
    there is no default.
    """
    reach = reach_of(robot)
    proposal = _proposal(kind, reach, target)
    part = _on_flange(proposal.header)
    if unknown := [key for key in mounted if key not in ON_THE_FLANGE or key not in part]:
        raise BadInput(
            "this says nothing of how the instrument is mounted",
            found=", ".join(unknown),
            allowed=", ".join(key for key in ON_THE_FLANGE if key in part) or "nothing",
            argument="mounted",
        )
    part.update({key: list(value) for key, value in mounted.items()})
    header = {"noise": {"joint_deg": JOINT_DEG, "spot_mm": SPOT_MM}} | proposal.header
    if proposal.turns:
        header["held"] = ["delta1", f"delta{robot.n}"]
    options = [f"--candidates={CANDIDATES if proposal.numbers < _MANY else FEWER_CANDIDATES}"]
    if kind_of(kind).beam:
        shortest, longest = (round(share * reach, -1) for share in (_SHORTEST_BEAM, _LONGEST_BEAM))
        options += [f"--facing={_words(facing)}", f"--beam={shortest:g},{longest:g}"]
    if measurements is None and proposal.numbers == 1:
        measurements = MOST_MEASUREMENTS
    if measurements is None:
        options += [f"--tolerance={TOLERANCE:g}", f"--max-shots={MOST_MEASUREMENTS}"]
    else:
        options.append(f"--shots={measurements}")
    return NewCalibration(header, tuple(options))


def _proposal(kind: str, reach: float, target: Point) -> ProposedHeader:
    proposal = kind_of(kind).proposed(reach, target) if kind in kind_names() else None
    if proposal is None:
        raise BadInput(
            "there is no default for this instrument",
            found=kind,
            allowed=", ".join(titles()),
            remedy="write a header, and make a plan of it",
            argument="instrument",
        )
    return proposal


def _words(numbers: Sequence[float]) -> str:
    return ",".join(f"{number:g}" for number in numbers)
