"""What of an arm's geometry is uncertain: link parameters, deflection under gravity, first harmonics.

Link i is the body between the axes of joints i and i + 1; the last one ends at the z axis of the flange. Its
parameters are deviations from nominal, minimal and continuous (Hayati and Mirmirani 1985):

    Tz(d) Tx(a) Ty(b) Rx(alpha) Ry(beta)

in a frame on axis i + 1, where it is nearest to axis i: z along axis i, x along the common normal (the x axis
of Denavit and Hartenberg). Where the two axes are nearly parallel that place is not defined: it is then the
origin of the next joint, and beta is a parameter in place of d. The rotation about z is the joint's offset.
Behind a prismatic joint, where d is the offset, the rotation theta about z is the parameter. The last link is
whole: with a shift b along y, all that can displace the flange relative to the last axis is a parameter.

What the offset of joint i is depends on the recorded positions q where the arm bends:

    delta_i + gravity_i tau_i(q) / max |tau_i| + cos_i cos q_i + sin_i sin q_i

with the torque tau_i of the links' weight about joint i of the nominal arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from ..files.header import GeometryKind
from ..kinematics.dh import NEARLY_PARALLEL
from ..kinematics.robot import JointKind, Robot

if TYPE_CHECKING:
    from ..files.header import Header, StatedGeometry

LinkAxis = Literal["a", "b", "alpha", "d", "beta", "theta"]
ANGLES: frozenset[str] = frozenset({"alpha", "beta", "theta"})
# What is added to joints by their posture: the axes of its parameters.
BENDING: dict[Literal["gravity", "harmonics"], frozenset[str]] = {
    "gravity": frozenset({"gravity"}),
    "harmonics": frozenset({"cos", "sin"}),
}


def kind_of_axis(axis: str) -> GeometryKind:
    """Of which kind a geometry parameter with this axis is."""
    bending = next((rung for rung, axes in BENDING.items() if axis in axes), None)
    return bending or ("angle" if axis in ANGLES else "length")


_SHIFTS: tuple[LinkAxis, ...] = ("a", "b", "d")  # along x, y, z
# Of the last link: all but what is the offset of its joint.
_WHOLE: dict[JointKind, tuple[LinkAxis, ...]] = {
    "revolute": ("a", "b", "d", "alpha", "beta"),
    "prismatic": ("a", "b", "theta", "alpha", "beta"),
}
_POSTURES = 4096  # for the largest torque over the joints' ranges
_NO_TORQUE = 1e-6  # of the largest of any joint, and of the weight behind a joint at the arm's whole length


@dataclass(frozen=True, eq=False)
class Link:
    """Link `number` (from 1): its parameters `axes`, and its nominal transform as `before` @ `after` (4, 4)
    with the frame of the parameters in between."""

    number: int
    axes: tuple[LinkAxis, ...]
    before: Matrix
    after: Matrix

    def moved(self, values: Sequence[ca.SX]) -> ca.SX:
        """(4, 4) the transform with the parameters at `values`, in the order of `axes`; mm and rad."""
        by_axis = dict(zip(self.axes, values, strict=True))
        shift = ca.SX.eye(4)
        for row, along in enumerate(_SHIFTS):
            shift[row, 3] = by_axis.get(along, ca.SX(0))
        parts = [ca.SX(self.before), shift]
        for axis, angle in (
            ("z", by_axis.get("theta")),
            ("x", by_axis.get("alpha")),
            ("y", by_axis.get("beta")),
        ):
            if angle is not None:
                parts.append(_rotation(axis, angle))
        parts.append(ca.SX(self.after))
        result = parts[0]
        for part in parts[1:]:
            result = ca.sparsify(result) @ ca.sparsify(part)
        return result


@dataclass(frozen=True, eq=False)
class Gravity:
    """Deflection of the `joints` (from 0) under masses (n,) kg at the links' ends; `up` (3,) in the base
    frame, `largest` (n,) the largest torques, over all postures within the limits: 0 of the other joints."""

    joints: tuple[int, ...]
    masses: Matrix
    up: Matrix
    largest: Matrix


@dataclass(frozen=True, eq=False)
class Geometry:
    """The geometry parameters of one robot, in their order: links from 1, gravity, harmonics.

    `length`, `angle` (n,) are the tolerances of each link, mm and rad; `deflection` and `harmonic` those of
    gravity and of harmonics, rad; `stated` the kinds of which the header states them: the others are assumed.
    """

    links: tuple[Link, ...] = ()
    gravity: Gravity | None = None
    harmonics: tuple[int, ...] = ()
    length: Matrix = field(default_factory=lambda: np.zeros(0))
    angle: Matrix = field(default_factory=lambda: np.zeros(0))
    deflection: float = 0.0
    harmonic: float = 0.0
    stated: frozenset[GeometryKind] = frozenset()

    @classmethod
    def from_header(cls, header: Header, robot: Robot) -> Geometry:
        """The geometry that a header states: none where it is exact. What is `auto` is counted in.

        Raises
        ------
        BadInput
            Tolerances or masses of a wrong number, or harmonics of an arm with a prismatic joint.
        """
        geometry = header.arm
        if geometry is None:
            return NOMINAL
        length, angle = geometry.tolerance.of_links(robot)
        revolute = tuple(i for i, joint in enumerate(robot.joints) if joint.kind == "revolute")
        geometry.require_revolute(robot)
        return cls(
            links=tuple(_links(robot)),
            gravity=_gravity(robot, geometry) if geometry.gravity else None,
            harmonics=revolute if geometry.harmonics else (),
            length=length,
            angle=angle,
            deflection=float(np.radians(geometry.gravity_deg)),
            harmonic=float(np.radians(geometry.harmonics_deg)),
            stated=geometry.declared_kinds,
        )

    @classmethod
    def of_links(cls, robot: Robot, length_mm: float, angle_deg: float) -> Geometry:
        """The link parameters alone, with one tolerance for all lengths and one for all angles."""
        return _of_links(robot, length_mm, angle_deg)

    def of_robot(self, robot: Robot) -> Geometry:
        """The same tolerances of another robot with as many joints of the same kinds."""
        links = tuple(_links(robot)) if self.links else ()
        gravity = self.gravity
        if gravity is not None:
            gravity = _bending(robot, tuple(gravity.masses.tolist()), tuple(gravity.up.tolist()))
        return replace(self, links=links, gravity=gravity)

    def scaled(self, length: float, angle: float, gravity: float = 1.0, harmonics: float = 1.0) -> Geometry:
        """This geometry with its tolerances multiplied: those of links' lengths and angles, of the deflection
        under gravity, and of harmonics, each by a factor."""
        return replace(
            self,
            length=self.length * length,
            angle=self.angle * angle,
            deflection=self.deflection * gravity,
            harmonic=self.harmonic * harmonics,
        )

    def __bool__(self) -> bool:
        return bool(self.names)

    @cached_property
    def names(self) -> tuple[tuple[str, str], ...]:
        """Of each parameter what it belongs to (link2, joint3) and its axis (a, alpha, gravity, cos)."""
        bending = () if self.gravity is None else self.gravity.joints
        return (
            *((f"link{link.number}", axis) for link in self.links for axis in link.axes),
            *((f"joint{i + 1}", "gravity") for i in bending),
            *((f"joint{i + 1}", axis) for i in self.harmonics for axis in ("cos", "sin")),
        )

    def prior_std(self, of: str, axis: str) -> float:
        """Of one parameter, mm or rad: the tolerance of its link, or what is known of real arms."""
        if axis == "gravity":
            return self.deflection
        if axis in ("cos", "sin"):
            return self.harmonic
        tolerances = self.angle if axis in ANGLES else self.length
        return float(tolerances[int(of.removeprefix("link")) - 1])

    def require_enough(self, header: Header, numbers: int, measurements: int, others: int) -> None:
        """BadInput where gravity or harmonics are stated as true, and the measured `numbers` are fewer than
        their parameters and the `others` (offsets, targets, tool) together."""
        for rung, axes in BENDING.items():
            count = sum(axis in axes for _, axis in self.names)
            required = header.arm is not None and getattr(header.arm, rung) is True
            if required and count and numbers < others + count:
                raise BadInput(
                    f"geometry.{rung} is asked for, but fewer numbers are measured than there are unknowns",
                    found=f"{numbers} numbers of {measurements} measurements",
                    allowed=f"at least {others + count}: as many as offsets, targets, tool ({others}) and "
                    f"parameters of {rung} ({count}) together",
                    remedy=f"add measurements, or state {rung}: auto",
                )

    def moved(self, robot: Robot, values: ca.SX) -> Robot:
        """The robot with its links at `values` (g,), which may be symbols: its transforms are then too."""
        if not self.links:
            return robot
        fixed: list[Any] = [joint.fixed for joint in robot.joints] + [robot.flange]
        start = 0
        for link in self.links:
            stop = start + len(link.axes)
            if link.axes:
                fixed[link.number] = link.moved(ca.vertsplit(values[start:stop]))
            start = stop
        joints = tuple(replace(joint, fixed=at) for joint, at in zip(robot.joints, fixed[:-1], strict=True))
        return replace(robot, joints=joints, flange=fixed[-1])

    def applied(self, robot: Robot, values: Matrix) -> Robot:
        """The robot in numbers with its links at `values` (g,), mm and rad; what depends on the posture
        (gravity, harmonics) is in no robot, and left out."""
        moved = self.moved(robot, ca.SX(np.asarray(values, dtype=float)))

        def number(transform: Any) -> Matrix:
            return np.array(ca.evalf(ca.SX(transform)).full())

        joints = tuple(replace(joint, fixed=number(joint.fixed)) for joint in moved.joints)
        return replace(moved, joints=joints, flange=number(moved.flange))

    def bent(self, robot: Robot, arm: ca.SX, recorded: ca.SX) -> ca.SX:
        """(n, 1) offsets that hold at one posture: those of `arm` (n + g,) and what its gravity and harmonics
        add, with what was `recorded` of the posture (see `recorded`)."""
        delta: ca.SX = arm[: robot.n]
        if self.gravity is None and not self.harmonics:
            return delta
        added: ca.SX = ca.vertcat(*self._added(robot, arm[robot.n :], recorded, ca.SX(0)))
        return delta + added

    def _added(self, robot: Robot, values: Any, recorded: Any, zero: Any) -> list[Any]:
        start = sum(len(link.axes) for link in self.links)
        added = [zero] * robot.n
        if self.gravity is not None:
            for i in self.gravity.joints:
                added[i] += values[start] * recorded[2 * robot.n + i]
                start += 1
        for i in self.harmonics:
            added[i] += values[start] * recorded[2 * i] + values[start + 1] * recorded[2 * i + 1]
            start += 2
        return added

    def added(self, robot: Robot, values: Matrix, joints: Matrix) -> Matrix:
        """(n,) in numbers what gravity and harmonics at `values` (g,) add to the offsets at recorded `joints`
        (n,), rad or mm."""
        return np.array(self._added(robot, values, self.recorded(robot, joints), 0.0))

    def recorded(self, robot: Robot, joints: Matrix) -> Matrix:
        """(…, 2n or 3n): cosines, sines as `Robot.recorded_turns`; the torques too where gravity counts."""
        turns = robot.recorded_turns(joints)
        if self.gravity is None:
            return turns
        rows = joints.reshape(-1, robot.n)
        torque = _torques(robot, self.gravity.masses, self.gravity.up, rows) / self._largest
        return np.concatenate([turns, torque.reshape(joints.shape)], axis=-1)

    def recorded_size(self, robot: Robot) -> int:
        """How many numbers `recorded` has for a posture."""
        return (2 if self.gravity is None else 3) * robot.n

    def recorded_symbols(self, robot: Robot, q: ca.SX) -> ca.SX:
        """(2n or 3n, 1) what `recorded` has, of symbols q (n, 1)."""
        parts = [part for turn in robot.turns(q) for part in turn]
        if self.gravity is None:
            return ca.vertcat(*parts)
        torque = torques(robot, q, self.gravity.masses, self.gravity.up)
        return ca.vertcat(*parts, torque / self._largest)

    @property
    def _largest(self) -> Matrix:
        assert self.gravity is not None
        return np.where(self.gravity.largest > 0, self.gravity.largest, 1.0)

    @cached_property
    def key(self) -> bytes:
        """Equal for geometries whose functions are the same."""
        numbers = [part for link in self.links for part in (link.before, link.after)]
        if self.gravity is not None:
            numbers += [self.gravity.masses, self.gravity.up, self.gravity.largest]
        parts = [np.asarray(part, dtype=float).tobytes() for part in numbers]
        return b"".join([repr(self.names).encode(), *parts])


def torques(robot: Robot, q: ca.SX, masses: Matrix, up: Matrix) -> ca.SX:
    """(n, 1) torques of the links' weight about the joint axes at positions q (n, 1), kg mm in units of the
    acceleration of gravity; 0 of prismatic joints. The mass of link i is at the next joint, of the last one
    at the flange."""
    points, axes = robot.skeleton(q), robot.axes(q)
    result = []
    moment, mass = ca.SX.zeros(3), 0.0  # of the links from joint i on, about the base
    for i, joint in reversed(list(enumerate(robot.joints))):
        moment, mass = moment + float(masses[i]) * points[:, i + 2], mass + float(masses[i])
        torque = -ca.dot(axes[:, i], ca.cross(moment - mass * points[:, i + 1], ca.SX(up)))
        result.append(torque if joint.kind == "revolute" else ca.SX(0))
    return ca.vertcat(*reversed(result))


def _torques(robot: Robot, masses: Matrix, up: Matrix, rows: Matrix) -> Matrix:
    """(W, n) torques in numbers at joint positions `rows` (W, n)."""
    if not len(rows):
        return rows
    function = _torque_function(robot, tuple(masses.tolist()), tuple(up.tolist()))
    return np.asarray(function.map(len(rows))(rows.T).full().T)


@lru_cache(maxsize=8)  # every density of a run asks for it
def _torque_function(robot: Robot, masses: tuple[float, ...], up: tuple[float, ...]) -> ca.Function:
    q = ca.SX.sym("q", robot.n)
    return ca.Function("torques", [q], [ca.densify(torques(robot, q, np.array(masses), np.array(up)))])


def _gravity(robot: Robot, geometry: StatedGeometry) -> Gravity | None:
    masses = geometry.masses(robot)
    up = np.array(geometry.up, dtype=float)
    up /= np.abs(up).max()  # first, that nothing underflows
    up /= np.linalg.norm(up)
    return _bending(robot, tuple(masses.tolist()), tuple(up.tolist()))


@lru_cache(maxsize=8)  # every plan and every prediction of a run asks for it
def _bending(robot: Robot, masses_kg: tuple[float, ...], upwards: tuple[float, ...]) -> Gravity | None:
    masses, up = np.array(masses_kg), np.array(upwards)
    rows = np.random.default_rng(0).uniform(robot.lower, robot.upper, (_POSTURES, robot.n))
    largest = np.abs(_torques(robot, masses, up, rows)).max(axis=0)
    # Where no joint carries any torque the largest is rounding itself.
    weight = np.cumsum(masses[::-1])[::-1] * _length(robot)
    largest[largest <= _NO_TORQUE * np.maximum(weight, largest.max(initial=0.0))] = 0.0
    bending = np.flatnonzero(largest)
    return Gravity(tuple(int(i) for i in bending), masses, up, largest) if len(bending) else None


def _length(robot: Robot) -> float:
    """The sum, mm, of all the shifts between the joints, the farthest slides and the flange's included."""
    fixed = [*(joint.fixed for joint in robot.joints), robot.flange]
    shifts = sum(float(np.linalg.norm(each[:3, 3])) for each in fixed)
    farthest = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    slides = np.array([joint.kind == "prismatic" for joint in robot.joints])
    return shifts + float(farthest[slides].sum())


@lru_cache(maxsize=16)  # every judgement of a run asks for it several times
def _of_links(robot: Robot, length_mm: float, angle_deg: float) -> Geometry:
    angle = float(np.radians(angle_deg))
    return Geometry(tuple(_links(robot)), length=np.full(robot.n, length_mm), angle=np.full(robot.n, angle))


def _links(robot: Robot) -> Iterator[Link]:
    transforms = [*(joint.fixed for joint in robot.joints[1:]), robot.flange]
    axes = [*(joint.axis for joint in robot.joints), np.array([0.0, 0.0, 1.0])]
    for i, (joint, transform) in enumerate(zip(robot.joints, transforms, strict=True)):
        before, parallel = _frame(joint.axis, transform, axes[i + 1])
        if i + 1 == robot.n:
            yield Link(i + 1, _WHOLE[joint.kind], before, np.linalg.inv(before) @ transform)
            return
        next_slides = robot.joints[i + 1].kind == "prismatic"
        link_axes: list[LinkAxis] = [] if next_slides else ["a"]
        if joint.kind == "prismatic":
            link_axes += ["theta", "alpha"] if not parallel else ["alpha", "beta"]
        else:
            link_axes.append("alpha")
            link_axes += ["beta"] if parallel else [] if next_slides else ["d"]
        yield Link(i + 1, tuple(link_axes), before, np.linalg.inv(before) @ transform)


def _frame(axis: Matrix, transform: Matrix, next_axis: Matrix) -> tuple[Matrix, bool]:
    """(4, 4) the frame of a link's parameters, seen from the joint before it, and whether the axes are nearly
    parallel. `axis` is that of the joint, `next_axis` the next one's in its own frame behind `transform`."""
    origin, along = transform[:3, 3], transform[:3, :3] @ next_axis
    normal = np.cross(axis, along)
    parallel = bool(np.linalg.norm(normal) < NEARLY_PARALLEL)
    own_x = transform[:3, 0] - (transform[:3, 0] @ axis) * axis
    if parallel:
        normal = origin - (origin @ axis) * axis
        if np.linalg.norm(normal) < 1e-6:
            normal = own_x if np.linalg.norm(own_x) > 0.5 else np.cross(transform[:3, 1], axis)
        foot = origin
    else:
        # The point of the next axis that is nearest to this one.
        rest, slope = origin - (origin @ axis) * axis, along - (along @ axis) * axis
        foot = origin - (rest @ slope) / (slope @ slope) * along
    x = normal / np.linalg.norm(normal)
    # As Denavit and Hartenberg have it: along the next joint's own x axis, not against it.
    x = -x if x @ transform[:3, 0] < -1e-9 else x
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(axis, x), axis, foot
    frame[np.abs(frame) < 1e-12] = 0.0  # no terms of rounding in the symbolic model
    return frame, parallel


def _rotation(axis: Literal["x", "y", "z"] | str, angle: ca.SX) -> ca.SX:
    """(4, 4) about a coordinate axis."""
    j, k = ("xyz".index(axis) + 1) % 3, ("xyz".index(axis) + 2) % 3
    result = ca.SX.eye(4)
    result[j, j] = result[k, k] = ca.cos(angle)
    result[j, k], result[k, j] = -ca.sin(angle), ca.sin(angle)
    return result


NOMINAL = Geometry()
