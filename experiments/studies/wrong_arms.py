"""Arms of the study of wrong models: a simulator of its own, in plain NumPy.

An arm has links, gravity, harmonics, tool and backlash at typical sizes; each of them may change from one
measurement of a run to the next. Postures are those of a plan, moved until the beam has the target at the
intended spot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ...model.instruments.flange_tool import FlangeTool
from ...model.kinematics.robot import Robot
from ...model.kinematics.transforms import rotations
from ...model.likelihood.geometry import Geometry

OFFSET_DEG, BACKLASH_DEG, SPOT_MM = 0.5, 0.01, 2.0  # of the arms; of the spots about the centre
_GUESS_MM = 5.0  # how far the PSD is from its guess
_STEPS, _HIT_MM = 30, 1e-9


@dataclass(frozen=True, eq=False)
class Course:
    """An arm, its laser and the PSD over the N measurements of a run, rad and mm.

    `offsets`, `gravity`, `harmonics` (N, n, …) and `links` (N, g) as in `Geometry` (cosine and sine of the
    first harmonic), `second` (N, n) the second harmonic's sine, `gain` (N, n) what a joint turns too far for
    each radian, `backlash` (n,) either side of the true position, `point`, `direction` (N, 3) of the beam,
    `target` (N, 3), `up` (3,), `noise` the factor on the noise, `spots` (N, 2) where the beam has the target.
    """

    robot: Robot
    geometry: Geometry
    offsets: Matrix
    links: Matrix
    gravity: Matrix
    harmonics: Matrix
    second: Matrix
    gain: Matrix
    backlash: Matrix
    point: Matrix
    direction: Matrix
    target: Matrix
    up: Matrix
    noise: float
    spots: Matrix

    @property
    def measurements(self) -> int:
        return len(self.target)


def typical(
    robot: Robot, geometry: Geometry, tool: FlangeTool, target: Matrix, count: int, rng: np.random.Generator
) -> Course:
    """A random arm with deviations of the sizes that `geometry` and `tool` state, for `count` measurements.
    Offset 1 is 0: the base frame is that of the arm."""
    n, links = robot.n, [item for item in geometry.names if item[0].startswith("link")]
    stds = np.array([geometry.prior_std(*item) for item in links])
    offsets = rng.normal(size=n) * np.radians(OFFSET_DEG)
    offsets[0] = 0.0
    direction = tool.direction if tool.direction is not None else np.array([0.0, 0.0, 1.0])
    tilted = direction + np.cross(rng.normal(size=3) * tool.tilt_std, direction)

    def every(value: Matrix) -> Matrix:
        return np.tile(value, (count, *(1 for _ in value.shape)))

    return Course(
        robot=robot,
        geometry=geometry,
        offsets=every(offsets),
        links=every(rng.normal(size=len(links)) * stds),
        gravity=every(rng.normal(size=n) * geometry.deflection),
        harmonics=every(rng.normal(size=(n, 2)) * geometry.harmonic),
        second=every(np.zeros(n)),
        gain=every(np.zeros(n)),
        backlash=np.full(n, np.radians(BACKLASH_DEG)),
        point=every(tool.point + rng.normal(size=3) * tool.shift_std),
        direction=every(tilted / np.linalg.norm(tilted)),
        target=every(target + rng.normal(size=3) * _GUESS_MM),
        up=np.array([0.0, 0.0, 1.0]),
        noise=1.0,
        spots=rng.normal(size=(count, 2)) * SPOT_MM,
    )


def recorded(
    course: Course,
    postures: Matrix,
    noise: Matrix,
    spot_noise: float,
    tool: FlangeTool,
    rng: np.random.Generator,
) -> tuple[Matrix, Matrix] | None:
    """Joints (N, n) rad and spots (N, 2) mm as recorded near `postures` (N, n), with the std `noise` (n,) of
    a joint reading; None where a posture cannot bring its beam onto the target."""
    theta = _aimed(course, postures, tool)
    if theta is None:
        return None
    n = course.robot.n
    joints = theta - course.offsets
    for _ in range(_STEPS):  # what bends the joints depends on what is recorded of them
        joints = theta - course.offsets - _bent(course, joints)
    side = np.where(np.diff(theta, axis=0, prepend=0.0) >= 0, 1.0, -1.0)
    joints = joints + side * course.backlash / 2
    joints = joints + rng.normal(size=joints.shape) * noise * course.noise
    return joints.reshape(-1, n), course.spots + rng.normal(
        size=course.spots.shape
    ) * spot_noise * course.noise


def _bent(course: Course, joints: Matrix) -> Matrix:
    """(N, n) what the true positions have more than those recorded and the offsets."""
    cosine, sine = np.cos(joints), np.sin(joints)
    added = course.harmonics[..., 0] * cosine + course.harmonics[..., 1] * sine
    added += course.second * np.sin(2 * joints) + course.gain * joints
    if course.geometry.gravity is not None:
        largest = np.where(course.geometry.gravity.largest > 0, course.geometry.gravity.largest, np.inf)
        added += course.gravity * _torques(course, joints) / largest
    return added


def _torques(course: Course, joints: Matrix) -> Matrix:
    """(N, n) of equal masses at the ends of the nominal links about the joints, kg mm."""
    robot, gravity = course.robot, course.geometry.gravity
    assert gravity is not None
    _, places, axes = _chain(*_fixed(robot, len(joints)), robot, joints)
    result = np.zeros_like(joints)
    for i in range(robot.n):
        for k in range(i, robot.n):
            force = np.cross(places[:, k + 1] - places[:, i], course.up)
            result[:, i] -= gravity.masses[k] * (axes[:, i] * force).sum(axis=1)
    return result


def _fixed(robot: Robot, count: int) -> tuple[Matrix, Matrix]:
    """(N, n + 1, 4, 4) the nominal transforms, (n, 3) the axes."""
    fixed = np.array([*(joint.fixed for joint in robot.joints), robot.flange])
    return np.tile(fixed, (count, 1, 1, 1)), np.array([joint.axis for joint in robot.joints])


def _with_links(course: Course) -> tuple[Matrix, Matrix]:
    """The same with the links' deviations."""
    fixed, axes = _fixed(course.robot, course.measurements)
    start = 0
    for link in course.geometry.links:
        values = course.links[:, start : start + len(link.axes)]
        start += len(link.axes)
        fixed[:, link.number] = link.before @ _deviation(link.axes, values) @ link.after
    return fixed, axes


def _deviation(names: tuple[str, ...], values: Matrix) -> Matrix:
    """(N, 4, 4) Tz(d) Ty(b) Tx(a) Rz(theta) Rx(alpha) Ry(beta)."""
    by_name = dict(zip(names, values.T, strict=True))
    result = np.tile(np.eye(4), (len(values), 1, 1))
    for row, name in enumerate(("a", "b", "d")):
        result[:, row, 3] = by_name.get(name, 0.0)
    for name, axis in (("theta", 2), ("alpha", 0), ("beta", 1)):
        if name in by_name:
            turn = np.tile(np.eye(4), (len(values), 1, 1))
            turn[:, :3, :3] = rotations(np.eye(3)[axis], by_name[name])
            result = result @ turn
    return result


def _chain(fixed: Matrix, axes: Matrix, robot: Robot, theta: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """The flange (N, 4, 4); the places (N, n + 1, 3) of the joints and the flange; the axes (N, n, 3)."""
    pose = fixed[:, 0]
    places, directions = [], []
    for i in range(robot.n):
        places.append(pose[:, :3, 3])
        directions.append(pose[:, :3, :3] @ axes[i])
        turn = np.tile(np.eye(4), (len(theta), 1, 1))
        turn[:, :3, :3] = rotations(axes[i], theta[:, i])
        pose = pose @ turn @ fixed[:, i + 1]
    places.append(pose[:, :3, 3])
    return pose, np.stack(places, axis=1), np.stack(directions, axis=1)


def _aimed(course: Course, postures: Matrix, tool: FlangeTool) -> Matrix | None:
    """(N, n) the true positions nearest to `postures` that have the target at the spots."""
    fixed, axes = _with_links(course)
    across = _across(course.direction, tool)
    theta = postures.copy()
    off = np.full(len(theta), np.inf)
    for _ in range(_STEPS):
        pose, places, turning = _chain(fixed, axes, course.robot, theta)
        rotation = pose[:, :3, :3]
        target_in_flange = np.einsum("nji,nj->ni", rotation, course.target - pose[:, :3, 3])
        residual = np.einsum("nai,ni->na", across, target_in_flange - course.point) - course.spots
        off = np.linalg.norm(residual, axis=1)
        if (off < _HIT_MM).all():
            break
        moved = -np.cross(turning, course.target[:, None] - places[:, :-1])
        by_joints = np.einsum("nai,nji,nkj->nak", across, rotation, moved)
        theta = theta - np.einsum("nka,na->nk", np.linalg.pinv(by_joints), residual)
    ahead = ((target_in_flange - course.point) * course.direction).sum(axis=1) > 0
    return theta if (off < 1e-6).all() and ahead.all() else None


def _across(direction: Matrix, tool: FlangeTool) -> Matrix:
    """(N, 2, 3) the axes of the spot: the two coordinate axes across the nominal beam, made square to it."""
    assert tool.direction is not None
    axis = int(np.argmax(np.abs(tool.direction)))
    first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    b1 = first - (direction @ first)[:, None] * direction
    b1 /= np.linalg.norm(b1, axis=1)[:, None]
    b2 = second - (direction @ second)[:, None] * direction
    b2 -= (b2 * b1).sum(axis=1)[:, None] * b1
    return np.stack([b1, b2 / np.linalg.norm(b2, axis=1)[:, None]], axis=1)
