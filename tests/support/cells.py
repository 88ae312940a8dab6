"""Cells for the tests: headers, arms, plans and simulated runs, made in memory."""

import functools
import pickle
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.experiments.plans.patterns import Pattern, pattern
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run
from zerobeam.model.files.shot import Shot
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.problem import Problem

LASER = {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
OPEN_LASER = {**LASER, "calibrated": False}
AXIS_LASER = {**LASER, "direction": [0, 0, 1]}
PROBE = {"kind": "probe", "calibrated": True, "point_mm": [60, 20, 150]}
OPEN_PROBE = {**PROBE, "calibrated": False}

# Means of the three runs of Table 2, degrees.
TABLE_2 = {"delta2": -1.2168, "delta3": -0.6931, "delta4": 0.1129, "delta5": 0.0053, "delta6": -0.0382}


@functools.cache
def irb1600() -> Robot:
    return load_robot("irb1600", Path("."))


def header(
    tool: dict[str, Any] = LASER,
    *,
    target: Sequence[float] | None = (900.0, 0.0, 0.0),
    joint_deg: float = 0.01,
    spot_mm: float = 0.05,
    noise: dict[str, Any] | None = None,
    geometry: dict[str, Any] | str | None = "exact",
    **more: Any,
) -> Header:
    """A header of the built-in arm with one target `psd` thought to be at `target` (mm).

    Its geometry is exact unless stated otherwise; None: no such key, a typical arm.
    """
    content: dict[str, Any] = {
        "robot": "irb1600",
        "tool": tool,
        "noise": {"joint_deg": joint_deg, "spot_mm": spot_mm, **(noise or {})},
    }
    if geometry is not None:
        content["geometry"] = geometry
    if target is not None:
        content["targets"] = {"psd": {"guess_mm": list(target)}}
    return Header.model_validate({**content, **more})


def plan_of(
    own: Header, postures: Matrix, targets: Sequence[str] | None = None, robot: Robot | None = None
) -> Plan:
    """A plan as if read from a file; `postures` (N, n) rad or mm."""
    names = tuple(targets) if targets is not None else ("psd",) * len(postures)
    lines, arm = tuple(range(1, len(postures) + 1)), robot or irb1600()
    shots = planned(np.array(postures) * arm.display, names)
    return Plan(own, arm, shots, lines, Path("plan.yaml"), "0" * 64, ())


def run_of(own: Header, shots: Iterable[Shot], robot: Robot | None = None) -> Run:
    """A run as if read from a file."""
    shots = tuple(shots)
    lines = tuple(range(2, len(shots) + 2))
    return Run(own, robot or irb1600(), shots, lines, Path("run.jsonl"), "0" * 64, (), 1)


def simulated(plan: Plan, values: dict[str, float] | None = None, seed: int = 0) -> tuple[Truth, Run]:
    """A run of the plan with the named true values (deg, mm), else without any error but the noise."""
    truth = Truth.with_values(plan, values or {})
    return truth, run_of(plan.header, simulated_shots(truth, np.random.default_rng(seed)), plan.robot)


def simulated_problem(
    plan: Plan, values: dict[str, float] | None = None, seed: int = 0
) -> tuple[Truth, Problem]:
    truth, run = simulated(plan, values, seed)
    return truth, Problem.from_run(run)


_POSTURES: dict[bytes, Matrix] = {}


def _once(search: Callable[..., Matrix], *cell: Any) -> Matrix:
    """Postures that were searched for: most tests begin with those of a few cells. Each has its own copy."""
    key = pickle.dumps((search.__name__, cell))
    if key not in _POSTURES:
        _POSTURES[key] = search(*cell)
    return _POSTURES[key].copy()


def varied_postures(own: Header, robot: Robot, target: Sequence[float], count: int, seed: int) -> Matrix:
    """(count, n) random postures within the limits, all joints varied, turned onto `target` (3,) mm."""
    return _once(_varied, own, robot, tuple(target), count, seed)


def _varied(own: Header, robot: Robot, target: tuple[float, ...], count: int, seed: int) -> Matrix:
    rng = np.random.default_rng(seed)
    tries = 40 * count
    middle, width = (robot.lower + robot.upper) / 2, robot.upper - robot.lower
    width = np.minimum(width, np.where(robot.display > 1, np.pi, width))
    middle = np.where(
        robot.display > 1, np.clip(0.0, robot.lower + width / 2, robot.upper - width / 2), middle
    )
    joints = middle + rng.uniform(-0.4, 0.4, (tries, robot.n)) * width
    problem = Problem.build(own, robot, joints, ["psd"] * tries)
    x = problem.parameters.prior_mean.copy()
    x[problem.parameters.block("target", 0)] = target
    weights = servo_joints(problem)
    aimed = aim(problem, x, weights)
    found = aimed.problem.joints
    good = aimed.hit & (found >= robot.lower).all(axis=1) & (found <= robot.upper).all(axis=1)
    if own.tool.kind == "laser":
        origin, direction = aimed.problem.beams(x)
        good &= ((np.asarray(target) - origin) * direction).sum(axis=1) > 200.0
    assert good.sum() >= count, "this cell has too few postures that see the target"
    return found[good][:count]


def good_plan(
    count: int = 10,
    seed: int = 5,
    tool: dict[str, Any] = LASER,
    *,
    target: Sequence[float] | None = None,
    **changes: Any,
) -> Plan:
    """Varied postures of the built-in arm, a plan that tells every offset (by a beam)."""
    place = target or ((900.0, 0.0, 0.0) if tool["kind"] == "laser" else (900.0, 100.0, 500.0))
    own = header(tool, target=place, **changes)
    return plan_of(own, varied_postures(own, irb1600(), place, count, seed))


def placed_plan(
    places: dict[str, Sequence[float]],
    counts: dict[str, int],
    tool: dict[str, Any] = LASER,
    *,
    first_seed: int = 5,
    **changes: Any,
) -> Plan:
    """So many varied postures (`counts`) at each of several targets, by name, at `places` (3,) mm."""
    targets = {name: {"guess_mm": list(places[name])} for name in counts}
    alone = header(tool, target=None)
    postures = [
        varied_postures(alone, irb1600(), places[name], count, first_seed + i)
        for i, (name, count) in enumerate(counts.items())
    ]
    names = [name for name, count in counts.items() for _ in range(count)]
    return plan_of(header(tool, target=None, targets=targets, **changes), np.concatenate(postures), names)


def pattern_plan(which: Pattern, aside: float = 0.0, shots: int = 7, **changes: Any) -> Plan:
    """The paper's X- or Y-Pattern with the target `aside` mm from the base's x axis."""
    own = header(target=(900.0, aside, 0.0), **changes)
    return plan_of(own, _once(pattern, own, irb1600(), np.array([900.0, aside, 0.0]), which, shots))


def random_robot(kinds: str, seed: int) -> Robot:
    """A small arm; `kinds` has one letter a joint, r(evolute) or p(rismatic)."""
    rng = np.random.default_rng(seed)
    joints = []
    for i, kind in enumerate(kinds):
        axis = rng.normal(size=3)
        half = np.pi if kind == "r" else 500.0
        joints.append(
            Joint(
                f"joint{i + 1}",
                "revolute" if kind == "r" else "prismatic",
                random_pose(rng, 300.0),
                axis / np.linalg.norm(axis),
                -half,
                half,
            )
        )
    return Robot(f"random {kinds}", tuple(joints), random_pose(rng, 100.0))


def random_pose(rng: np.random.Generator, length: float) -> Matrix:
    """A rigid transform (4, 4) with a shift of about `length` mm."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.normal(size=3) * length
    return pose


def exact_copy(run: Path, file: Path) -> Path:
    """A copy of a recorded run whose arm is taken as exact: solved in a fraction of the time."""
    text = run.read_text(encoding="utf-8").replace('"robot":', '"geometry":"exact","robot":', 1)
    file.write_text(text, encoding="utf-8")
    return file
