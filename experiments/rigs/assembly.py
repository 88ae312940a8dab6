"""The parts of a simulated cell, made from its file for a plan: what is not stated suits the plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...analysis.aim import aim, servo_joints
from ...model.constraint import ShotFunctions
from ...model.errors import BadInput
from ...model.noise import Noise
from ...model.plan import Plan
from ...model.problem import Problem
from ...model.reading import did_you_mean
from ...model.robot import Matrix, Robot, shift
from ...model.robot_file import load_robot
from ...model.tool import Tool
from ...model.urdf import roll_pitch_yaw
from ..camera import Camera
from ..psd import Psd
from ..simulate import Truth
from .cell_file import CameraInCell, Cell, EachJoint, EncoderGlitch, PlacedPsd
from .simulated_arm import SimulatedArm, geometry_errors

_PLACED_BY_HAND = 20.0  # mm, std of a PSD about the plan's guess
_FACED_WITHIN = np.cos(np.radians(70.0))  # a face of its own is chosen only if all beams come from this side


@dataclass(frozen=True, eq=False)
class Parts:
    """`truth` has the true offsets; `functions` are of the true arm and beam, the latter by `tool` (4,):
    tilts, rad, and shifts, mm; `wander` mm across the beam; `centres`, `psds` by target."""

    truth: Truth
    functions: ShotFunctions
    tool: Matrix
    wander: float
    arm: SimulatedArm
    centres: dict[str, Matrix]
    psds: dict[str, Psd]
    camera: Camera | None


def assemble(plan: Plan, cell: Cell, rng: np.random.Generator) -> Parts:
    """All parts; BadInput where cell and plan do not go together. The same rng, the same cell."""
    _require_fit(plan, cell)
    problem = Problem.from_plan(plan)
    truth = Truth.drawn(plan, rng, cell.arm.drawn_deg)
    if cell.arm.offsets_deg is not None:
        truth = Truth.stated(plan, _offsets(cell.arm.offsets_deg, problem))
    noise = Noise.from_header(plan.header, plan.robot)
    offsets, _, drawn_tool = problem.split(truth.x)
    tool = np.zeros(4) if problem.tool.calibrated else drawn_tool
    if cell.laser.tilt_deg is not None:
        tool = np.concatenate([np.radians(cell.laser.tilt_deg), tool[2:]])
    if cell.laser.shift_mm is not None:
        tool = np.concatenate([tool[:2], cell.laser.shift_mm])
    aimed = aim(problem, problem.supposed(), servo_joints(problem)).problem
    _, directions = aimed.beams(problem.supposed())
    psds, centres = {}, {}
    for k, name in enumerate(problem.targets):
        placed = cell.psd.placed.get(name, PlacedPsd())
        psds[name] = _psd(cell, placed, directions[problem.target_index == k])
        centres[name] = _centre(plan, problem, name, placed, rng)
    robot = geometry_errors(plan.robot, _geometry(cell, plan.robot))
    return Parts(
        truth=truth,
        functions=ShotFunctions(robot, replace(problem.tool, calibrated=False)),
        tool=tool,
        wander=noise.spot if cell.laser.wander_mm is None else cell.laser.wander_mm,
        arm=_arm(cell, robot, offsets, noise),
        centres=centres,
        psds=psds,
        camera=None if cell.camera is None else _camera(cell.camera, problem.tool),
    )


def turned(rpy_deg: Sequence[float]) -> Matrix:
    """(3, 3) a turn about fixed x, then y, then z."""
    return roll_pitch_yaw(*np.radians(rpy_deg))[:3, :3]


def _require_fit(plan: Plan, cell: Cell) -> None:
    if plan.header.tool.kind != "laser":
        raise BadInput(
            "a simulated cell has a laser and PSDs, the plan's tool is a probe",
            found=f"tool.kind: {plan.header.tool.kind}",
            remedy="run the plan without --cell: its shots are then led by hand",
        )
    if cell.robot is not None:
        own = load_robot(cell.robot, plan.path.parent)
        same = own.n == plan.robot.n and all(
            np.allclose(a.fixed, b.fixed) and a.kind == b.kind
            for a, b in zip(own.joints, plan.robot.joints, strict=True)
        )
        if not same or not np.allclose(own.flange, plan.robot.flange):
            raise BadInput(
                "the plan is for another robot than the one in the cell",
                found=f"the plan's {plan.robot.name} ({plan.robot.n} joints)",
                allowed=f"the cell's {own.name} ({own.n} joints)",
                remedy="take the plan of this robot, or correct `robot` in the cell file",
            )
    known = tuple(dict.fromkeys(plan.targets))
    for name in cell.psd.placed:
        if name not in known:
            raise BadInput(
                "the cell places a PSD that is no target of the plan",
                found=name,
                allowed=", ".join(known),
                remedy=did_you_mean(name, known) or "take it out, or correct the name",
            )
    for fault in cell.faults:
        if isinstance(fault, EncoderGlitch) and fault.joint > plan.robot.n:
            raise BadInput(
                "an encoder glitch is of a joint that the arm has not",
                found=f"joint {fault.joint}",
                allowed=f"1 to {plan.robot.n}",
            )


def _offsets(stated: dict[str, float], problem: Problem) -> dict[str, float]:
    known = [item.name for item in problem.parameters.items if item.group == "offset"]
    for name in stated:
        if name not in known:
            raise BadInput(
                "the cell states the offset of a joint that there is not",
                found=name,
                allowed=", ".join(known),
                remedy=did_you_mean(name, known) or "correct the name",
            )
    return stated


def _each_joint(value: EachJoint, robot: Robot, key: str) -> Matrix:
    """(n,) internal units, from one number or one for each joint in degrees (mm)."""
    values = np.atleast_1d(np.array(value, dtype=float))
    if len(values) not in (1, robot.n):
        raise BadInput(
            f"arm.{key} has the wrong number of values",
            found=f"{len(values)} values",
            allowed=f"one number, or {robot.n}: {robot.name} has {robot.n} joints",
        )
    return np.broadcast_to(values, robot.n) / robot.display


def _arm(cell: Cell, robot: Robot, offsets: Matrix, noise: Noise) -> SimulatedArm:
    stated = cell.arm
    repeatability = (
        noise.joint
        if stated.repeatability_deg is None
        else _each_joint(stated.repeatability_deg, robot, "repeatability_deg")
    )
    return SimulatedArm(
        robot,
        offsets,
        backlash=_each_joint(stated.backlash_deg, robot, "backlash_deg"),
        resolution=_each_joint(stated.resolution_deg, robot, "resolution_deg"),
        repeatability=repeatability,
        speed=stated.speed,
        acceleration=stated.acceleration_deg_s2 / robot.display,
    )


def _geometry(cell: Cell, robot: Robot) -> dict[int, Matrix]:
    errors = {}
    for error in cell.arm.geometry:
        if error.joint > robot.n:
            raise BadInput(
                "a geometric error is of a joint that the arm has not",
                found=f"joint {error.joint}",
                allowed=f"1 to {robot.n}",
            )
        errors[error.joint - 1] = shift(*error.xyz_mm) @ roll_pitch_yaw(*np.radians(error.rpy_deg))
    return errors


def _centre(plan: Plan, problem: Problem, name: str, placed: PlacedPsd, rng: np.random.Generator) -> Matrix:
    """(3,) mm: as stated, or near where the plan supposes it."""
    by_hand = rng.normal(size=3)  # drawn in any case: other draws do not depend on what is stated
    if placed.centre_mm is not None:
        return np.array(placed.centre_mm)
    _, targets, _ = problem.split(problem.supposed())
    stated = plan.header.targets.get(name)
    spread = _PLACED_BY_HAND if stated is None else min(stated.sigma_mm, _PLACED_BY_HAND)
    return np.asarray(targets[problem.targets.index(name)] + spread * by_hand)


def _psd(cell: Cell, placed: PlacedPsd, directions: Matrix) -> Psd:
    """The data sheet; `directions` (N, 3) of the beams that the plan sends to it."""
    stated = cell.psd
    normal: Matrix | None = None
    if placed.normal is None:
        against = -directions.mean(axis=0)
        length = np.linalg.norm(against)
        if length > 0 and (-(directions @ against) / length).min() >= _FACED_WITHIN:
            normal = against / length
    elif placed.normal != "beam":
        normal = np.array(placed.normal) / np.linalg.norm(placed.normal)
    half = stated.leds_mm / 2
    return Psd(
        size=stated.size_mm,
        kind=stated.kind,
        rate=stated.rate_hz,
        noise=stated.noise_mm,
        saturation=stated.saturation,
        markers=np.array([[half, 0.0, 0.0], [-half, 0.0, 0.0]]),
        normal=normal,
        turn=float(np.radians(placed.turn_deg)),
    )


def _camera(stated: CameraInCell, tool: Tool) -> Camera:
    """It looks along the beam, from beside it."""
    point, direction, across = tool.nominal_beam()
    mount = np.eye(4)
    mount[:3, :3] = np.column_stack([across, direction])
    mount[:3, 3] = point + across @ stated.beside_mm - stated.behind_mm * direction
    return Camera(
        width=stated.width_px,
        height=stated.height_px,
        focal=(stated.focal_px, stated.focal_px),
        centre=((stated.width_px - 1) / 2, (stated.height_px - 1) / 2),
        distortion=stated.distortion,
        mount=mount,
    )
