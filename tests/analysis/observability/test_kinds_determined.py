"""What each kind of instrument determines of an IRB 1600, and why not the rest: frames, mounts, scale,
mixes."""

import copy
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from cells import irb1600
from exact_judge import robot_of
from measured_arms import CELLS, Cell, Recorded, recorded

from zerobeam.analysis.observability.causes import BaseFrame, NullDirection, ToolRotation
from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.identifiability import Identified, identify
from zerobeam.model.files.header import Header
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.kinematics.dh import DHRow
from zerobeam.model.likelihood.problem import Problem

JOINT_DEG = 0.002


@cache
def arm_of(kind: str) -> Recorded:
    return recorded(CELLS[kind], 24, np.random.default_rng(3), exact=True, joint_deg=JOINT_DEG)


def problem_of(
    kind: str, rows: Sequence[int] = range(24), *, geometry: str | None = "exact", **changes: Any
) -> Problem:
    cell, arm = CELLS[kind], arm_of(kind)
    entries = copy.deepcopy(cell.instruments)
    for entry in entries.values():
        entry.update({key: value for key, value in changes.items() if key != "held"})
    header = Cell(entries, cell.targets, cell.turns, cell.tool).header(geometry=geometry, joint_deg=JOINT_DEG)
    if "held" in changes:
        content = header.model_dump(mode="json", by_alias=True, exclude_unset=True)
        header = Header.model_validate({**content, "held": changes["held"]})
    measured = [arm.measured[i] for i in rows]
    return Problem.of_measured(header, irb1600(), arm.joints[list(rows)], measured)


def judged(problem: Problem) -> tuple[dict[str, float], dict[str, str], tuple[NullDirection, ...]]:
    """Std without prior (deg, mm) and status by name, and the directions that are not determined."""
    answer: Identified = identify(problem, problem.nominal())
    parameters = problem.parameters
    std = dict(zip(parameters.names, answer.data_std * parameters.display, strict=True))
    return std, dict(zip(parameters.names, answer.status, strict=True)), answer.facts.null_space


@pytest.mark.parametrize("kind", ["tracker", "pose"])
def test_a_free_frame_and_the_first_offset_are_one(kind: str) -> None:
    """By default the offset is held, and the base frame is the reason. Negative control: a known frame."""
    held = {item.name: item.held_by for item in problem_of(kind).parameters.items if item.held}
    assert held == {"delta1": "base frame", "delta6": "tool rotation"}
    std, status, directions = judged(problem_of(kind, held=[]))
    label = next(iter(CELLS[kind].instruments))
    assert status["delta1"] == "unidentifiable"
    assert np.isinf([std["delta1"], *(std[f"{label}.{axis}"] for axis in ("x", "y", "rx", "ry", "rz"))]).all()
    assert std[f"{label}.z"] < 1  # along axis 1 the frame is not turned
    (frame,) = (each for each in directions if isinstance(each.cause, BaseFrame))
    assert (frame.kind, "delta1" in frame.combination) == ("exact", True)
    assert {name.split(".")[0] for name in frame.combination} == {"delta1", label}

    known = {"frame": {"xyz_mm": [2000.0, 300.0, 500.0], "quat": [1, 0, 0, 0]}}
    problem = problem_of(kind, held=[], **known, **_carried(kind))
    std, status, directions = judged(problem)
    assert "held" not in status.values()
    assert std["delta1"] < 0.01
    assert not directions


def _carried(kind: str) -> dict[str, Any]:
    """What the flange carries, stated to be known."""
    if kind == "pose":
        turn = {"guess_quat": [1, 0, 0, 0], "sigma_deg": 0.05}
        return {"mount": {"guess_mm": [0, 0, 50], "sigma_mm": 0.1, **turn}}
    reflectors = CELLS[kind].instruments["leica"]["reflectors"]
    return {"reflectors": {name: {**entry, "sigma_mm": 0.1} for name, entry in reflectors.items()}}


def test_a_mount_that_is_not_known_turns_as_the_last_joint_does() -> None:
    """Five of its six parameters, all but the shift along axis 6. Negative control: a mount whose rotation is
    known determines the offset, by as much as it is known to."""
    std, status, directions = judged(problem_of("pose", held=["delta1"]))
    mount = {axis: std[f"tmac.mount.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")}
    assert {axis for axis, value in mount.items() if np.isinf(value)} == set(mount) - {"z"}
    assert status["delta6"] == "unidentifiable"
    (turning,) = directions
    assert isinstance(turning.cause, ToolRotation)
    assert (turning.kind, turning.cause.joint) == ("exact", 6)

    std, status, directions = judged(problem_of("pose", held=["delta1"], **_carried("pose")))
    assert not directions
    assert 0.02 < std["delta6"] < 0.2  # of the 0.05° that the mount is known to about each axis


def test_a_rotation_that_is_hardly_measured_leaves_the_position() -> None:
    """Then a pose says of the offsets what a tracker says of one reflector, and the mount's rotation is open.
    Negative control: as measured it says more."""
    pose = problem_of("pose")
    position, status, _ = judged(problem_of("pose", sigma_deg=1e5))
    assert {status[f"tmac.mount.{axis}"] for axis in ("rx", "ry", "rz")} == {"unidentifiable"}
    cell, arm = CELLS["pose"], arm_of("pose")
    reflector = {"kind": "tracker", "sigma_mm": cell.instruments["tmac"]["sigma_mm"], "reflectors": {"R": {}}}
    header = Cell({"leica": reflector}, {}, ()).header(geometry="exact", joint_deg=JOINT_DEG)
    measured = [
        [
            item._replace(
                instrument="leica", variant="R", measured={"measured_mm": item.measured["measured_mm"]}
            )
        ]
        for (item,) in arm.measured
    ]
    tracker, _, _ = judged(Problem.of_measured(header, irb1600(), arm.joints, measured))
    whole, _, _ = judged(pose)
    offsets = [f"delta{i}" for i in range(2, 6)]
    np.testing.assert_allclose([position[n] for n in offsets], [tracker[n] for n in offsets], rtol=0.02)
    assert all(whole[name] < position[name] for name in offsets)
    assert min(whole[name] / position[name] for name in offsets) < 0.5


def scale_left(kind: str) -> float:
    """What of the column of link 2's length the other lengths cannot do, as a share of it."""
    problem = problem_of(kind, geometry=None)
    parameters = problem.parameters
    _, jacobian, _ = information_root(problem, problem.nominal(), 1.0)
    jacobian = jacobian[: len(jacobian) - len(problem.tolerated)]
    items = [parameters.items[i] for i in np.flatnonzero(parameters.free)]
    lengths = np.array([item.unit == "mm" for item in items])
    this = np.array([item.name == "link2.a" for item in items])
    column, others = jacobian[:, this], jacobian[:, lengths & ~this]
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    left = column - others @ np.linalg.lstsq(others, column, rcond=1e-11)[0]
    return float(np.linalg.norm(left) / np.linalg.norm(column))


@pytest.mark.parametrize(
    ("kind", "measures_lengths"),
    [
        *((kind, False) for kind in ("laser", "probe", "plane", "cube")),
        *((kind, True) for kind in ("tracker", "pose", "sphere", "ballbar", "dial", "laser + tracker")),
    ],
)
@pytest.mark.one_in(3)
def test_the_scale_is_known_where_a_length_is_measured(kind: str, measures_lengths: bool) -> None:
    """All lengths of arm, tool and world larger by one factor read the same on a beam, a point, a face."""
    assert (scale_left(kind) > 1e-6) == measures_lengths


@pytest.mark.parametrize("kind", ["tracker", "pose", "plane", "sphere", "ballbar", "dial"])
def test_an_arm_whose_axes_are_all_parallel_is_measured_by_each_kind(kind: str) -> None:
    """No entry of its flange's rotation is out of the plane. Its Jacobian is that of differences."""
    robot = robot_of([DHRow(length, 0.0, 50.0, 0.0) for length in (400.0, 300.0, 80.0)], "rrr")
    cell, joints = CELLS[kind], np.random.default_rng(1).uniform(-1, 1, (6, 3))
    header = cell.header(geometry="exact", joint_deg=JOINT_DEG)
    measured = [[Measurement(*read, {}) for read in cell.turns[i % len(cell.turns)]] for i in range(6)]
    problem = Problem.of_measured(header, robot, joints, measured, planned=True)
    x = problem.nominal() + 0.01 * np.random.default_rng(2).normal(size=len(problem.parameters))
    problem = problem.at_predicted(x)
    _, jacobian = problem.linearise(x)
    for i in range(3):
        step = 1e-6 * np.equal(np.arange(len(x)), i)
        differences = (problem.linearise(x + step)[0] - problem.linearise(x - step)[0]) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, i], differences, rtol=1e-6, atol=1e-4)


def test_a_mix_takes_nothing_away() -> None:
    """Offsets by a laser and a tracker together are known at least as well as by each of them, and some of
    them much better. Negative control: a quarter of the tracker's measurements is no better than all."""
    arm = arm_of("laser + tracker")
    by_laser = [i for i, some in enumerate(arm.measured) if some[0].instrument == "tool"]
    by_tracker = [i for i in range(len(arm.measured)) if i not in by_laser]
    both, laser, tracker, few = (
        np.array([judged(problem_of("laser + tracker", rows))[0][f"delta{i}"] for i in range(2, 6)])
        for rows in (range(24), by_laser, by_tracker, by_tracker[::4])
    )
    assert (both <= 1.0001 * np.minimum(laser, tracker)).all()
    assert (both / laser).min() < 0.7
    assert (few > tracker).all()
