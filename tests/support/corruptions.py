"""Runs spoilt on purpose: what is wrong with each is known, and a diagnosis has to name it."""

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cells import PROBE, TABLE_2, header, plan_of, simulated, varied_postures
from exact_runs import demo_runs

from zerobeam.analysis.diagnostics.diagnosis import Explanation
from zerobeam.analysis.diagnostics.suspects import Cause
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN, load_robot
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.kinematics.robot import Robot

Spoil = Callable[[Run, Path], Run]
SOCKETS = ("left_0", "left_1", "right_0", "right_1", "high_0", "high_1")
_PLACES = {
    "left_0": (800.0, 500.0, 300.0),
    "left_1": (840.0, 530.0, 300.0),
    "right_0": (850.0, -450.0, 350.0),
    "right_1": (890.0, -420.0, 350.0),
    "high_0": (900.0, 100.0, 800.0),
    "high_1": (900.0, 150.0, 800.0),
}


@dataclass(frozen=True)
class Corruption:
    """`what` is wrong with a run, how to make it so, and the cause that a diagnosis has to name."""

    what: str
    run: str
    spoil: Spoil
    cause: Cause
    joints: tuple[int, ...] = ()
    targets: tuple[str, ...] = ()
    measurements: tuple[int, ...] = ()

    def spoilt(self, folder: Path) -> Run:
        return self.spoil(probe_run() if self.run == "probe" else demo(self.run), folder)

    def named_by(self, found: Explanation) -> bool:
        return (
            found.cause == self.cause
            and (not self.joints or found.joints == self.joints)
            and (not self.targets or set(found.targets) == set(self.targets))
            and (not self.measurements or found.measurements == self.measurements)
        )


@functools.cache
def demo(name: str) -> Run:
    return read_run(next(run.path for run in demo_runs() if run.name == name))


@functools.cache
def probe_run() -> Run:
    """A probe in the two sockets of a plate at three places, 24 measurements, without fault."""
    alone = header(PROBE, target=None)
    distances = [
        {"between": [f"{position}_0", f"{position}_1"], "mm": 50, "sigma_mm": 0.1}
        for position in ("left", "right", "high")
    ]
    targets = {name: {"guess_mm": list(position), "sigma_mm": 50} for name, position in _PLACES.items()}
    made_header = header(PROBE, target=None, spot_mm=0.05, targets=targets, distances=distances)
    robot = load_robot("irb1600")
    postures = [
        varied_postures(alone, robot, position, 4, 7 + k) for k, position in enumerate(_PLACES.values())
    ]
    names = [name for name in SOCKETS for _ in range(4)]
    return simulated(plan_of(made_header, np.concatenate(postures), names), TABLE_2, seed=11)[1]


def columns(change: Callable[[Matrix], None]) -> Spoil:
    """A change of the recorded joint angles (N, n), degrees."""

    def spoil(run: Run, folder: Path) -> Run:
        angles = np.array([shot.joints_deg for shot in run.shots])
        change(angles)
        shots = tuple(
            shot.model_copy(update={"joints_deg": tuple(row)})
            for shot, row in zip(run.shots, angles.tolist(), strict=True)
        )
        # `limits: warn`, as for whoever has been told of the limits and went on.
        return replace(run, shots=shots, header=run.header.model_copy(update={"limits": "warn"}))

    return spoil


def swapped(i: int, j: int) -> Spoil:
    def change(angles: Matrix) -> None:
        angles[:, [i - 1, j - 1]] = angles[:, [j - 1, i - 1]]

    return columns(change)


def reversed_sign(i: int) -> Spoil:
    def change(angles: Matrix) -> None:
        angles[:, i - 1] *= -1

    return columns(change)


def zero_off(i: int, degrees: float) -> Spoil:
    def change(angles: Matrix) -> None:
        angles[:, i - 1] += degrees

    return columns(change)


def scaled(factor: float) -> Spoil:
    def change(angles: Matrix) -> None:
        angles *= factor

    return columns(change)


def coupled(times: float) -> Spoil:
    def change(angles: Matrix) -> None:
        angles[:, 2] += times * angles[:, 1]

    return columns(change)


def leant_on(shot: int) -> Spoil:
    """One measurement at other angles than those that were recorded."""

    def change(angles: Matrix) -> None:
        angles[shot] += [3.0, -2.0, 4.0, 1.0, 2.0, 5.0]

    return columns(change)


def moved_from(rows: range, mm: tuple[float, float, float]) -> Spoil:
    """Measurements with another place of their targets, by the angles that lead there."""

    def spoil(run: Run, folder: Path) -> Run:
        robot = run.robot
        tip = np.array(run.header.tool.point_mm)

        def change(angles: Matrix) -> None:
            for i in rows:
                q = np.radians(angles[i])
                goal = robot.fk(q, "rad")[:3, :] @ np.append(tip, 1.0) + mm
                for _ in range(30):
                    pose, motion = robot.fk(q, "rad"), robot.jacobian(q, "rad")
                    arm = pose[:3, :3] @ tip
                    by_joints = motion[:3] + np.cross(motion[3:].T, arm).T
                    q = q + np.linalg.lstsq(by_joints, goal - pose[:3, 3] - arm, rcond=None)[0]
                angles[i] = np.degrees(q)

        return columns(change)(run, folder)

    return spoil


def scattered(rows: range, mm: float) -> Spoil:
    """A loose plate: each of these measurements with its targets at a place of its own."""

    def spoil(run: Run, folder: Path) -> Run:
        rng = np.random.default_rng(0)
        for i in rows:
            x, y, z = (rng.normal(size=3) * mm).tolist()
            run = moved_from(range(i, i + 1), (x, y, z))(run, folder)
        return run

    return spoil


def wrong_row(row: int, key: str, value: float) -> Spoil:
    """A robot file with another number in one row (from 1)."""

    def spoil(run: Run, folder: Path) -> Run:
        return replace(run, robot=robot_with(folder, row, key, value))

    return spoil


def robot_with(folder: Path, row: int, key: str, value: float) -> Robot:
    lines = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8").splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("  - {")][row - 1]
    lines[at], count = re.subn(rf"{key}: *-?[\d.]+", f"{key}: {value}", lines[at])
    assert count == 1
    path = folder / "wrong.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return load_robot(path)


CORRUPTIONS = (
    Corruption("columns of J4 and J6 exchanged", "good", swapped(4, 6), "swapped_joints", (4, 6)),
    Corruption("columns of J2 and J3 exchanged", "good", swapped(2, 3), "swapped_joints", (2, 3)),
    Corruption("sign of J1 reversed", "good", reversed_sign(1), "sign", (1,)),
    Corruption("sign of J3 reversed", "good", reversed_sign(3), "sign", (3,)),
    Corruption("zero of J2 90° off", "good", zero_off(2, 90), "zero", (2,)),
    Corruption("zero of J4 180° off", "good", zero_off(4, 180), "zero", (4,)),
    Corruption("radians in place of degrees", "good", scaled(np.pi / 180), "units"),
    Corruption("angles converted from radians to degrees twice", "good", scaled(180 / np.pi), "units"),
    Corruption("J3 recorded against the horizontal (J2 added)", "good", coupled(1.0), "coupling", (2, 3)),
    Corruption("one measurement at other angles", "good", leant_on(3), "measurements", measurements=(3,)),
    Corruption("robot file: sign of alpha in row 4", "good", wrong_row(4, "alpha_deg", 90), "twist", (4, 5)),
    Corruption("robot file: a of row 2 12 mm too long", "good", wrong_row(2, "a_mm", 712), "length"),
    Corruption("columns of J1 and J2 exchanged", "uncalibrated", swapped(1, 2), "swapped_joints", (1, 2)),
    Corruption("sign of J5 reversed", "uncalibrated", reversed_sign(5), "sign", (5,)),
    Corruption("zero of J5 −90° off", "uncalibrated", zero_off(5, -90), "zero", (5,)),
    Corruption("robot file: sign of alpha in row 1", "uncalibrated", wrong_row(1, "alpha_deg", 90), "twist"),
    Corruption("columns of J2 and J3 exchanged", "x-pattern", swapped(2, 3), "swapped_joints", (2, 3)),
    Corruption("sign of J3 reversed", "x-pattern", reversed_sign(3), "sign", (3,)),
    Corruption(
        "the plate loose at one place",
        "probe",
        scattered(range(8, 16), 2.0),
        "placement",
        targets=SOCKETS[2:4],
    ),
    Corruption(
        "one socket moved between two measurements",
        "probe",
        moved_from(range(18, 20), (3.0, -2.0, 1.0)),
        "moved_target",
        targets=("high_0",),
        measurements=(17, 18),
    ),
)  # fmt: skip
