"""The plans of the study `geometry`: the laser of the demo run, and a probe with several targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ....model.arrays import Matrix
from ....model.files.header import Header
from ....model.files.plan import Plan
from ....model.files.robot_file import load_robot
from ....model.kinematics.robot import Robot
from ...plans.candidates import candidates
from ...plans.optimal import Planner, Proposal
from .answer import ToleranceLevel

ChosenFor = Literal["nominal", "freed"]

TYPICAL, CLOSE = ToleranceLevel(0.3, 0.1), ToleranceLevel(0.1, 0.03)
MEASUREMENTS = (7, 12, 20, 40)
CLOSE_MEASUREMENTS = (7, 12)
CANDIDATES = 10_000  # as `zerobeam plan optimal`

_TARGET = (950.0, 150.0, 100.0)
_LASER: dict[str, Any] = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": list(_TARGET)}},
}
_SOCKETS_APART_MM, _PER_SOCKET = 50.0, 10
_PLACEMENTS = {"front": (500.0, 0.0, 100.0), "left": (300.0, 450.0, 250.0), "right": (350.0, -400.0, 20.0)}
_PROBE: dict[str, Any] = {
    "robot": "panda",
    "tool": {"kind": "probe", "calibrated": False, "point_mm": [0, 0, 130]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.1},
}


@dataclass(frozen=True, eq=False)
class StudiedPlan:
    """A plan with `geometry` in its header; `proposal` as `plan optimal` made it, None where it did not."""

    name: str
    words: str
    plan: Plan
    tolerance: ToleranceLevel
    chosen_for: ChosenFor | None = None
    proposal: Proposal | None = None


def with_tolerance(header: Header, tolerance: ToleranceLevel | None) -> Header:
    """The header with link geometry as uncertain as that, without gravity and harmonics; nominal for None."""
    stated = {
        "tolerance": {"length_mm": tolerance.length_mm, "angle_deg": tolerance.angle_deg},
        "gravity": False,
        "harmonics": False,
    } if tolerance is not None else None  # fmt: skip
    content = header.model_dump(by_alias=True, exclude_none=True, exclude_unset=True)
    content.pop("geometry", None)
    return Header.model_validate(content if stated is None else {**content, "geometry": stated})


@lru_cache(maxsize=1)
def studied_plans(seed: int, count: int = CANDIDATES) -> list[Callable[[], StudiedPlan]]:
    """What makes each plan of the study: choosing the plans takes as long as the arms do.

    The candidates of the last study are kept: every piece is one of its plans."""

    @cache
    def planner(chosen_for: ChosenFor) -> tuple[Planner, Robot]:
        header = with_tolerance(Header.model_validate(_LASER), TYPICAL if chosen_for == "freed" else None)
        robot, place = load_robot(header.robot, Path()), np.array(_TARGET)
        found = candidates(header, robot, place, count, seed=seed)
        return Planner(header, robot, place, found), robot

    @cache
    def proposed(shots: int, chosen_for: ChosenFor) -> tuple[Proposal, Robot]:
        own, robot = planner(chosen_for)
        return own.optimal(shots, seed=seed), robot

    def laser(shots: int, chosen_for: ChosenFor, tolerance: ToleranceLevel) -> StudiedPlan:
        proposal, robot = proposed(shots, chosen_for)
        header = with_tolerance(Header.model_validate(_LASER), tolerance)
        close = "" if tolerance == TYPICAL else ", close tolerances"
        return StudiedPlan(
            f"{shots}, {chosen_for}{close}",
            f"laser, {shots} A-optimal measurements of {count} postures, chosen for"
            f" {'nominal' if chosen_for == 'nominal' else 'uncertain'} geometry",
            _plan(header, robot, proposal.postures, ["psd"] * shots),
            tolerance,
            chosen_for,
            proposal,
        )

    chosen: tuple[ChosenFor, ...] = ("nominal", "freed")
    cases = [(shots, own, TYPICAL) for own in chosen for shots in MEASUREMENTS]
    cases += [(shots, "nominal", CLOSE) for shots in CLOSE_MEASUREMENTS]
    return [*((lambda case=case: laser(*case)) for case in cases), lambda: _probe(seed)]


def _probe(seed: int) -> StudiedPlan:
    """Pairs of sockets at a stated distance, each met from random postures; the tip is free."""
    targets, distances = {}, []
    for name, (x, y, z) in _PLACEMENTS.items():
        for k in range(2):
            targets[f"{name}_{k}"] = {"guess_mm": [x + k * _SOCKETS_APART_MM, y, z], "sigma_mm": 30.0}
        between = [f"{name}_0", f"{name}_1"]
        distances.append({"between": between, "mm": _SOCKETS_APART_MM, "sigma_mm": 0.1})
    stated = Header.model_validate({**_PROBE, "targets": targets})
    robot = load_robot(stated.robot, Path())
    postures, at = [], []
    for k, (name, target) in enumerate(targets.items()):
        place = np.array(target["guess_mm"])
        found = candidates(stated, robot, place, _PER_SOCKET, seed=seed + k, name=name)
        postures.append(found.postures)
        at += [name] * len(found.postures)
    header = Header.model_validate({**_PROBE, "targets": targets, "distances": distances})
    return StudiedPlan(
        "probe",
        f"probe with a free tip, {len(_PLACEMENTS)} pairs of sockets, {_PER_SOCKET} random postures at each",
        _plan(with_tolerance(header, TYPICAL), robot, np.concatenate(postures), at),
        TYPICAL,
    )


def _plan(header: Header, robot: Robot, postures: Matrix, targets: list[str]) -> Plan:
    return Plan.of_postures(header, robot, np.round(postures * robot.display, 6), targets, "study")
