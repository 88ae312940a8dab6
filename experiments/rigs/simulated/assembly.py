"""The parts of a simulated cell, made from its file for a plan: what is not stated suits the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ....analysis.observability.aim import aim, servo_joints
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.instruments.flange_tool import flange_tool
from ....model.instruments.kind import Instrument
from ....model.kinematics.robot import Robot, euler, pose_of, same_arm
from ....model.likelihood.constraint import ShotFunctions, shot_functions
from ....model.likelihood.noise import NoiseModel
from ....model.likelihood.problem import Problem
from ....model.parsing.reading import KeyPath, did_you_mean
from ...sensors.detectors import Camera, Psd
from ...simulate import Truth
from .cell_file import CameraInCell, CellFile, EachJoint, EncoderGlitch, PlacedPsd

# Top speeds where the robot file states none.
_TOP_SPEED = {"revolute": 1.0, "prismatic": 1000.0}  # rad/s, mm/s


@dataclass(eq=False)
class SimulatedArm:
    """An arm whose true joints differ from their counts by offset, backlash and a static error.

    The controller drives its count to the commanded position, to the nearest step of the encoder; then

        link = count + offset + bent(count) + error - backlash / 2 * direction of the joint's last motion,

    which is the run's model (true = recorded + delta) where error and backlash are 0: `bent` is what gravity
    and harmonics add to the offsets. The error of each joint, of std `repeatability`, is friction and cables:
    it stays while the arm moves little, so that a servo can take it out, and is drawn again once the arm has
    travelled more than `redraw`.

    All (n,) are rad or mm (a second, a second squared): `offsets`, `backlash` (full width), `resolution` of
    the encoders (0: none), `repeatability`, `acceleration`. `speed` is a share of the joints' top speeds.
    `redraw` is rad: the travel of the joint that goes farthest, summed over motions, a mm for a degree.
    """

    robot: Robot
    offsets: Matrix
    backlash: Matrix
    resolution: Matrix
    repeatability: Matrix
    speed: float
    acceleration: Matrix
    redraw: float = np.radians(2.0)
    bent: Callable[[Matrix], Matrix] = np.zeros_like
    _rng: np.random.Generator = field(init=False, repr=False)
    _count: Matrix = field(init=False, repr=False)
    _direction: Matrix = field(init=False, repr=False)
    _error: Matrix = field(init=False, repr=False)
    _bent: Matrix = field(init=False, repr=False)
    _travel: float = field(init=False, repr=False)

    def begin(self, rng: np.random.Generator, at: Matrix) -> None:
        """Be at the joints `at` (n,), come from below, with a new static error.

        What follows depends on `rng` and `at` alone, not on what was before: a resumed run repeats it.
        """
        self._rng = rng
        self._stop_at(self._steps(at))
        self._direction = np.ones(self.robot.n)
        self._settle()

    def move(self, joints: Matrix) -> float:
        """Go to the joints (n,) as the controller counts, whatever their limits; the seconds it takes."""
        count = self._steps(joints)
        way = count - self._count
        self._stop_at(count)
        self._direction = np.where(way == 0, self._direction, np.sign(way))
        self._travel += float(np.radians(np.abs(way) * self.robot.display).max())
        if self._travel > self.redraw:
            self._settle()
        return self.duration(way)

    def read(self) -> Matrix:
        """(n,) the counts: where the controller takes the joints to be."""
        return self._count.copy()

    def link(self) -> Matrix:
        """(n,) where the joints truly are."""
        offsets = self.offsets + self._bent
        return self._count + offsets + self._error - self.backlash / 2 * self._direction

    def duration(self, way: Matrix) -> float:
        """Seconds for the way (n,): the slowest joint sets it, the others keep step.

        Trapezoidal profile of top speed v and acceleration a: D / v + v / a, or 2 sqrt(D / a) where the way
        D < v^2 / a is too short to reach v (Siciliano et al., Robotics, section 4.2.1).
        """
        top = self.speed * np.array([joint.speed or _TOP_SPEED[joint.kind] for joint in self.robot.joints])
        distance, acceleration = np.abs(way), self.acceleration
        trapezoid = distance / top + top / acceleration
        triangle = 2 * np.sqrt(distance / acceleration)
        return float(np.where(distance < top**2 / acceleration, triangle, trapezoid).max())

    def _steps(self, joints: Matrix) -> Matrix:
        """The joints (n,) to the nearest step of their encoders."""
        step = np.where(self.resolution > 0, self.resolution, 1.0)
        return np.where(self.resolution > 0, step * np.round(joints / step), joints)

    def _stop_at(self, count: Matrix) -> None:
        self._count, self._bent = count, self.bent(count)

    def _settle(self) -> None:
        self._error = self.repeatability * self._rng.normal(size=self.robot.n)
        self._travel = 0.0


def geometry_errors(robot: Robot, errors: Mapping[int, Matrix]) -> Robot:
    """The robot with links that deviate from nominal geometry.

    `errors` has small transforms (4, 4) by the index (from 0) of the joint behind the link; each goes after
    the link's fixed transform: it is stated in that joint's frame.
    """
    joints = list(robot.joints)
    for i, error in errors.items():
        joints[i] = replace(joints[i], fixed=joints[i].fixed @ error)
    return replace(robot, joints=tuple(joints))


_PLACED_BY_HAND = 20.0  # mm, std of a PSD about the plan's guess
_FACED_WITHIN = np.cos(np.radians(70.0))  # a face of its own is chosen only if all beams come from this side


@dataclass(frozen=True, eq=False)
class CellParts:
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
        """The true offsets and geometry by name with the unit, and the tool where it is not as stated. Links
        that the cell file states are there, by other numbers than a header's."""
        parameters = self.truth.problem.parameters
        links: set[str] = set()
        if not self.truth.x[parameters.block("geometry")].any():
            links = {item.name for item in parameters.items if item.group == "geometry"}
        values = {
            name: value
            for name, value in self.truth.provenance().items()
            if name.removeprefix("true ").partition(" (")[0] not in links
        }
        if self.truth.problem.tool.exact and self.tool.any():
            for i, value in enumerate(np.degrees(self.tool[:2]), start=1):
                values[f"true tool.tilt{i} (deg)"] = round(float(value), 9)
            for i, value in enumerate(self.tool[2:], start=1):
                values[f"true tool.shift{i} (mm)"] = round(float(value), 9)
        return values


def assemble(
    plan: Plan, cell: CellFile, rng: np.random.Generator, arm: Mapping[str, float] | None = None
) -> CellParts:
    """All parts; BadInput where cell and plan do not go together. The same rng, the same cell.

    `arm` has the true offsets and tool by name (deg, mm) in place of random or stated ones.
    """
    _require_fit(plan, cell)
    drawn = Truth.drawn(plan, rng, cell.arm.drawn_deg)
    deviations = drawn.problem.parameters.block("geometry")
    if arm is not None or cell.arm.geometry is not None:
        drawn.x[deviations] = 0.0
    if arm is not None:
        drawn = drawn.knowing(arm)
        cell = cell.model_copy(update={"arm": cell.arm.model_copy(update={"offsets_deg": None})})
    problem = drawn.problem
    beam = replace(flange_tool(problem.tool), is_calibrated=False)
    centres = {name: _centre(plan, cell, problem, name, rng) for name in problem.targets}
    block, x = problem.parameters.block, drawn.x.copy()
    x[block("offset")] = offsets = _offsets(cell, problem, drawn.x[block("offset")])
    for k, name in enumerate(problem.targets):
        x[block("target", k)] = centres[name]
    tool = _tool(cell, np.zeros(4) if problem.tool.exact else drawn.x[block("tool")])
    if not problem.tool.exact:
        x[block("tool")] = tool
    aimed = aim(problem, problem.nominal(), servo_joints(problem)).problem
    _, directions = aimed.beams(problem.nominal())
    noise = NoiseModel.from_header(plan.header, plan.robot, problem.tool)
    robot = geometry_errors(problem.geometry.applied(plan.robot, x[deviations]), _geometry(cell))

    def bent(count: Matrix) -> Matrix:
        return problem.geometry.added(plan.robot, x[deviations], count)

    return CellParts(
        truth=replace(drawn, x=x),
        functions=shot_functions(robot, beam),
        tool=tool,
        wander=noise.spot if cell.laser.wander_mm is None else cell.laser.wander_mm,
        arm=_arm(cell, robot, offsets, noise, bent),
        centres=centres,
        psds={
            name: _psd(cell, cell.placed(name), directions[problem.target_index == k])
            for k, name in enumerate(problem.targets)
        },
        camera=None if cell.camera is None else _camera(cell.camera, problem.tool),
    )


def turned(rpy_deg: Sequence[float]) -> Matrix:
    """(3, 3) a rotation about fixed x, then y, then z."""
    return euler("xyz", np.radians(rpy_deg))[:3, :3]


def _require_fit(plan: Plan, cell: CellFile) -> None:
    if not plan.header.instrument.beam:
        raise BadInput(
            f"a simulated cell has a laser and PSDs, the plan's tool is a {plan.header.instrument.name}",
            found=f"tool.kind: {plan.header.instrument.name}",
            remedy="run the plan without --cell: its measurements are then led by hand",
        )
    robot = cell.named_robot()
    if robot is not None and not same_arm(robot, plan.robot):
        raise cell.refuse(
            ("robot",),
            "the plan is for another robot than the one in the cell",
            found=f"the plan's {plan.robot.name} ({plan.robot.n} joints)",
            allowed=f"the cell's {robot.name} ({robot.n} joints)",
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
        (("arm", "geometry", i), error.joint) for i, error in enumerate(cell.arm.geometry or ())
    ]
    joints += [
        (("faults", i), fault.joint)
        for i, fault in enumerate(cell.faults)
        if isinstance(fault, EncoderGlitch)
    ]
    for key, joint in joints:
        if joint > plan.robot.n:
            raise cell.refuse(
                (*key, "joint"),
                "the arm has no such joint",
                found=f"joint {joint}",
                allowed=f"1 to {plan.robot.n} ({plan.robot.name})",
            )


def _offsets(cell: CellFile, problem: Problem, drawn: Matrix) -> Matrix:
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


def _tool(cell: CellFile, drawn: Matrix) -> Matrix:
    """(4,) tilts, rad, and shifts, mm: random, or as stated."""
    tilt, shift_mm = cell.laser.tilt_deg, cell.laser.shift_mm
    return np.concatenate(
        [
            drawn[:2] if tilt is None else np.radians(tilt),
            drawn[2:] if shift_mm is None else shift_mm,
        ]
    )


def _arm(
    cell: CellFile, robot: Robot, offsets: Matrix, noise: NoiseModel, bent: Callable[[Matrix], Matrix]
) -> SimulatedArm:
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

    settings = cell.arm
    return SimulatedArm(
        robot,
        offsets,
        backlash=each_joint(settings.backlash_deg, "backlash_deg"),
        resolution=each_joint(settings.resolution_deg, "resolution_deg"),
        repeatability=noise.joint
        if settings.repeatability_deg is None
        else each_joint(settings.repeatability_deg, "repeatability_deg"),
        speed=settings.speed,
        acceleration=settings.acceleration_deg_s2 / robot.display,
        bent=bent,
    )


def _geometry(cell: CellFile) -> dict[int, Matrix]:
    return {error.joint - 1: pose_of(error.xyz_mm, error.rpy_deg) for error in cell.arm.geometry or ()}


def _centre(plan: Plan, cell: CellFile, problem: Problem, name: str, rng: np.random.Generator) -> Matrix:
    """(3,) mm: as stated, or near the plan's nominal position."""
    by_hand = rng.normal(size=3)  # drawn in any case: other draws do not depend on what is stated
    placed = cell.placed(name)
    if placed.centre_mm is not None:
        return np.array(placed.centre_mm)
    targets = problem.split(problem.nominal()).targets
    target = plan.header.targets.get(name)
    spread = _PLACED_BY_HAND if target is None else min(target.sigma_mm, _PLACED_BY_HAND)
    return np.asarray(targets[problem.targets.index(name)] + spread * by_hand)


def _psd(cell: CellFile, placed: PlacedPsd, directions: Matrix) -> Psd:
    """The data sheet; `directions` (N, 3) of the beams that the plan sends to it."""
    settings = cell.psd
    normal: Matrix | None = None
    if placed.normal is None:
        against = -directions.mean(axis=0)
        length = np.linalg.norm(against)
        if length > 0 and (-(directions @ against) / length).min() >= _FACED_WITHIN:
            normal = against / length
    elif placed.normal != "beam":
        normal = np.array(placed.normal) / np.linalg.norm(placed.normal)
    half = settings.leds_mm / 2
    return Psd(
        size=settings.size_mm,
        kind=settings.kind,
        rate=settings.rate_hz,
        noise=settings.noise_mm,
        saturation=settings.saturation,
        markers=np.array([[half, 0.0, 0.0], [-half, 0.0, 0.0]]),
        normal=normal,
        turn=float(np.radians(placed.turn_deg)),
    )


def _camera(settings: CameraInCell, tool: Instrument) -> Camera:
    """The camera of a cell: beside the beam, along it."""
    point, direction, across = tool.nominal_beam()
    mount = np.eye(4)
    mount[:3, :3] = np.column_stack([across, direction])
    mount[:3, 3] = point + across @ settings.beside_mm - settings.behind_mm * direction
    return Camera(
        width=settings.width_px,
        height=settings.height_px,
        focal=(settings.focal_px, settings.focal_px),
        centre=((settings.width_px - 1) / 2, (settings.height_px - 1) / 2),
        distortion=settings.distortion,
        mount=mount,
    )
