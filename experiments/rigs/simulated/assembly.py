"""The parts of a simulated cell, made from its file for a plan: what is not stated suits the plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....analysis.observability.aim import aim, servo_joints
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.files.reading import KeyPath, did_you_mean
from ....model.kinematics.orientation import roll_pitch_yaw
from ....model.kinematics.robot import Robot, same_arm, shift
from ....model.likelihood.constraint import ShotFunctions, shot_functions
from ....model.likelihood.noise import NoiseModel
from ....model.likelihood.problem import Problem
from ....model.likelihood.tool import Tool
from ...sensors.camera import Camera
from ...sensors.psd import Psd
from ...simulate import Truth
from .arm import SimulatedArm, geometry_errors
from .cell_file import CameraInCell, Cell, EachJoint, PlacedPsd
from .faults import EncoderGlitch

_PLACED_BY_HAND = 20.0  # mm, std of a PSD about the plan's guess
_FACED_WITHIN = np.cos(np.radians(70.0))  # a face of its own is chosen only if all beams come from this side


@dataclass(frozen=True, eq=False)
class Parts:
    """`truth` has the true offsets, tool and centres; `functions` are of the true arm and beam, the latter by
    `tool` (4,): tilts, rad, and shifts, mm; `wander` mm across the beam; `centres`, `psds` by target."""

    truth: Truth
    functions: ShotFunctions
    tool: Matrix
    wander: float
    arm: SimulatedArm
    centres: dict[str, Matrix]
    psds: dict[str, Psd]
    camera: Camera | None

    def provenance(self) -> dict[str, float]:
        """The true offsets by name with the unit, and the tool where it is not as stated."""
        stated = self.truth.provenance()
        if self.truth.problem.tool.calibrated and self.tool.any():
            for i, value in enumerate(np.degrees(self.tool[:2]), start=1):
                stated[f"true tool.tilt{i} (deg)"] = round(float(value), 9)
            for i, value in enumerate(self.tool[2:], start=1):
                stated[f"true tool.shift{i} (mm)"] = round(float(value), 9)
        return stated


def assemble(
    plan: Plan, cell: Cell, rng: np.random.Generator, arm: Mapping[str, float] | None = None
) -> Parts:
    """All parts; BadInput where cell and plan do not go together. The same rng, the same cell.

    `arm` has the true offsets and tool by name (deg, mm) in place of random or stated ones.
    """
    _require_fit(plan, cell)
    drawn = Truth.drawn(plan, rng, cell.arm.drawn_deg)
    if arm is not None:
        drawn = drawn.knowing(arm)
        cell = cell.model_copy(update={"arm": cell.arm.model_copy(update={"offsets_deg": None})})
    problem = drawn.problem
    beam = replace(problem.tool, calibrated=False)
    centres = {name: _centre(plan, cell, problem, name, rng) for name in problem.targets}
    block, x = problem.parameters.block, drawn.x.copy()
    x[block("offset")] = offsets = _offsets(cell, problem, drawn.x[block("offset")])
    x[block("geometry")] = 0.0  # how the arm deviates from nominal is stated in the cell file
    for k, name in enumerate(problem.targets):
        x[block("target", k)] = centres[name]
    tool = _tool(cell, np.zeros(4) if problem.tool.calibrated else drawn.x[block("tool")])
    if not problem.tool.calibrated:
        x[block("tool")] = tool
    aimed = aim(problem, problem.nominal(), servo_joints(problem)).problem
    _, directions = aimed.beams(problem.nominal())
    noise = NoiseModel.from_header(plan.header, plan.robot)
    robot = geometry_errors(plan.robot, _geometry(cell))
    return Parts(
        truth=Truth(problem, x),
        functions=shot_functions(robot, beam),
        tool=tool,
        wander=noise.spot if cell.laser.wander_mm is None else cell.laser.wander_mm,
        arm=_arm(cell, robot, offsets, noise),
        centres=centres,
        psds={
            name: _psd(cell, cell.placed(name), directions[problem.target_index == k])
            for k, name in enumerate(problem.targets)
        },
        camera=None if cell.camera is None else _camera(cell.camera, problem.tool),
    )


def turned(rpy_deg: Sequence[float]) -> Matrix:
    """(3, 3) a rotation about fixed x, then y, then z."""
    return roll_pitch_yaw(*np.radians(rpy_deg))[:3, :3]


def _require_fit(plan: Plan, cell: Cell) -> None:
    if plan.header.tool.kind != "laser":
        raise BadInput(
            "a simulated cell has a laser and PSDs, the plan's tool is a probe",
            found=f"tool.kind: {plan.header.tool.kind}",
            remedy="run the plan without --cell: its measurements are then led by hand",
        )
    own = cell.own_robot()
    if own is not None and not same_arm(own, plan.robot):
        raise cell.refuse(
            ("robot",),
            "the plan is for another robot than the one in the cell",
            found=f"the plan's {plan.robot.name} ({plan.robot.n} joints)",
            allowed=f"the cell's {own.name} ({own.n} joints)",
            remedy="take the plan of this robot, or correct `robot` in the cell file",
        )
    for name in cell.psd.placed:
        if name not in plan.target_names:
            raise cell.refuse(
                ("psd", "placed", name),
                "the cell places a PSD that is no target of the plan",
                found=name,
                allowed=", ".join(plan.target_names),
                remedy=did_you_mean(name, plan.target_names) or "take it out, or correct the name",
            )
    joints: list[tuple[KeyPath, int]] = [
        (("arm", "geometry", i), error.joint) for i, error in enumerate(cell.arm.geometry)
    ]
    joints += [
        (("faults", i), fault.joint)
        for i, fault in enumerate(cell.faults)
        if isinstance(fault, EncoderGlitch)
    ]
    for place, joint in joints:
        if joint > plan.robot.n:
            raise cell.refuse(
                (*place, "joint"),
                "the arm has no such joint",
                found=f"joint {joint}",
                allowed=f"1 to {plan.robot.n} ({plan.robot.name})",
            )


def _offsets(cell: Cell, problem: Problem, drawn: Matrix) -> Matrix:
    """(n,) internal units: random, or as stated."""
    if cell.arm.offsets_deg is None:
        return drawn
    known = [item.name for item in problem.parameters.items if item.group == "offset"]
    offsets = np.zeros_like(drawn)
    for name, value in cell.arm.offsets_deg.items():
        if name not in known:
            raise cell.refuse(
                ("arm", "offsets_deg", name),
                "the cell states the offset of a joint that there is not",
                found=name,
                allowed=", ".join(known),
                remedy=did_you_mean(name, known) or "correct the name",
            )
        offsets[known.index(name)] = value
    return offsets / problem.robot.display


def _tool(cell: Cell, drawn: Matrix) -> Matrix:
    """(4,) tilts, rad, and shifts, mm: random, or as stated."""
    tilt, shift_mm = cell.laser.tilt_deg, cell.laser.shift_mm
    return np.concatenate(
        [
            drawn[:2] if tilt is None else np.radians(tilt),
            drawn[2:] if shift_mm is None else shift_mm,
        ]
    )


def _arm(cell: Cell, robot: Robot, offsets: Matrix, noise: NoiseModel) -> SimulatedArm:
    def each_joint(value: EachJoint, key: str) -> Matrix:
        values = np.atleast_1d(np.array(value, dtype=float))
        if len(values) not in (1, robot.n):
            raise cell.refuse(
                ("arm", key),
                f"arm.{key} has the wrong number of values",
                found=f"{len(values)} values",
                allowed=f"one number, or {robot.n}: {robot.name} has {robot.n} joints",
            )
        return np.broadcast_to(values, robot.n) / robot.display

    stated = cell.arm
    return SimulatedArm(
        robot,
        offsets,
        backlash=each_joint(stated.backlash_deg, "backlash_deg"),
        resolution=each_joint(stated.resolution_deg, "resolution_deg"),
        repeatability=noise.joint
        if stated.repeatability_deg is None
        else each_joint(stated.repeatability_deg, "repeatability_deg"),
        speed=stated.speed,
        acceleration=stated.acceleration_deg_s2 / robot.display,
    )


def _geometry(cell: Cell) -> dict[int, Matrix]:
    return {
        error.joint - 1: shift(*error.xyz_mm) @ roll_pitch_yaw(*np.radians(error.rpy_deg))
        for error in cell.arm.geometry
    }


def _centre(plan: Plan, cell: Cell, problem: Problem, name: str, rng: np.random.Generator) -> Matrix:
    """(3,) mm: as stated, or near the plan's nominal position."""
    by_hand = rng.normal(size=3)  # drawn in any case: other draws do not depend on what is stated
    placed = cell.placed(name)
    if placed.centre_mm is not None:
        return np.array(placed.centre_mm)
    targets = problem.split(problem.nominal()).targets
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
