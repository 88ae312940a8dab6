"""Arms with uncertain geometry a second time: plain numpy from the definition. Complex numbers go through,
and many vectors at once, stacked along leading axes (`...`).

Where an arm is written in Denavit-Hartenberg rows, its link parameters are added to the rows as they are
printed; where it is a chain of joints, they act in frames found from the nominal axes by least squares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from plain_model import (
    GANTRY,
    MODIFIED,
    SCARA,
    TABLE_1,
    Arm,
    covariance,
    matrix,
    miss,
)

from zerobeam.model.instruments.kind import Instrument
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.geometry import Geometry

Value = np.ndarray | complex
Link = Callable[[Mapping[str, Value]], np.ndarray]
ROWS = {
    "irb1600": (TABLE_1, "standard"),
    "modified": (MODIFIED, "modified"),
    "scara": (SCARA, "standard"),
    "gantry": (GANTRY, "modified"),
}
_Z = np.array([0.0, 0.0, 1.0])


def rotation(axis: str, angle: Value) -> np.ndarray:
    """(..., 4, 4) about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    upper = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    upper["z"] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    result = matrix(np.eye(4), np.shape(angle))
    result[..., :3, :3] = matrix(upper[axis], np.shape(angle))
    return result


def shift(x: Value = 0, y: Value = 0, z: Value = 0) -> np.ndarray:
    return matrix([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]], np.broadcast(x, y, z).shape)


def deviation(own: Mapping[str, Value]) -> np.ndarray:
    """Tz(d) Tx(a) Ty(b) Rz(theta) Rx(alpha) Ry(beta), factor by factor; what is not there is left out."""
    steps = [shift(**{axis: own[name]}) for name, axis in (("d", "z"), ("a", "x"), ("b", "y")) if name in own]
    angles = (("z", "theta"), ("x", "alpha"), ("y", "beta"))
    steps += [rotation(axis, own[name]) for axis, name in angles if name in own]
    result = np.eye(4, dtype=complex)
    for step in steps:
        result = result @ step
    return result


@dataclass(frozen=True, eq=False)
class Chain:
    """`first` (4, 4) before joint 1; of each joint its kind, its unit axis, and the link behind it."""

    kinds: str
    axes: tuple[np.ndarray, ...]
    first: np.ndarray
    links: tuple[Link, ...]

    def frames(self, theta: np.ndarray, own: Mapping[str, Mapping[str, Value]]) -> list[np.ndarray]:
        """(..., 4, 4) of each joint before its motion, and of the flange; `own` parameters by link."""
        frames = [self.first.astype(complex)]
        for i, (kind, axis, link) in enumerate(zip(self.kinds, self.axes, self.links, strict=True)):
            motion, value = matrix(np.eye(4), theta.shape[:-1]), theta[..., i]
            if kind == "p":
                motion[..., :3, 3] = axis * value[..., None]
            else:
                x, y, z = axis
                cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                sine, rest = np.sin(value)[..., None, None], 1 - np.cos(value)[..., None, None]
                motion[..., :3, :3] += sine * cross + rest * (cross @ cross)
            frames.append(frames[-1] @ motion @ link(own.get(f"link{i + 1}", {})))
        return frames


def chain_of_rows(rows: Sequence[Sequence[float]], convention: str, kinds: str) -> Chain:
    """The rows of a, alpha, d, theta as `plain_model` has them, mm and degrees."""
    rows = [(a, np.radians(alpha), d, np.radians(theta)) for a, alpha, d, theta in rows]
    if convention == "standard":
        before, behind = np.eye(4), rows
    else:  # link i has a and alpha of the next row, the flange none
        before = shift(x=rows[0][0]) @ rotation("x", rows[0][1])
        after = [(a, alpha) for a, alpha, _, _ in rows[1:]] + [(0.0, 0.0)]
        behind = [(a, alpha, d, theta) for (a, alpha), (_, _, d, theta) in zip(after, rows, strict=True)]

    def link(a: float, alpha: float, d: float, theta: float) -> Link:
        start, end = rotation("z", theta) @ shift(z=d) @ shift(x=a), rotation("x", alpha)
        return lambda values: start @ deviation(values) @ end

    return Chain(kinds, (_Z,) * len(rows), before, tuple(link(*row) for row in behind))


def chain_of_robot(robot: Robot) -> Chain:
    """The joints of a robot, its links' frames from the axes."""
    transforms = [*(joint.fixed for joint in robot.joints[1:]), robot.flange]
    nexts = [*(joint.axis for joint in robot.joints[1:]), _Z]

    def link(axis: np.ndarray, transform: np.ndarray, after: np.ndarray) -> Link:
        frame = link_frame(axis, transform, after)
        back = np.linalg.inv(frame) @ transform
        return lambda values: frame @ deviation(values) @ back

    links = [
        link(joint.axis, transform, after)
        for joint, transform, after in zip(robot.joints, transforms, nexts, strict=True)
    ]
    kinds = "".join(joint.kind[0] for joint in robot.joints)
    return Chain(kinds, tuple(joint.axis for joint in robot.joints), robot.joints[0].fixed, tuple(links))


def link_frame(axis: np.ndarray, transform: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(4, 4) z along the axis, x along the common normal, at the point of the next axis that is nearest; at
    the next joint's origin where the axes are within 5 degrees of parallel."""
    position, along = transform[:3, 3], transform[:3, :3] @ after
    if np.degrees(np.arccos(min(abs(axis @ along), 1.0))) < 5:
        foot, x = position, position - (position @ axis) * axis
        if np.linalg.norm(x) < 1e-6:
            x = transform[:3, 0] - (transform[:3, 0] @ axis) * axis
    else:
        # Lengths s along this axis and t along the next: s axis - (place + t along) is the shortest.
        s, t = np.linalg.lstsq(np.array([axis, -along]).T, position, rcond=None)[0]
        foot = position + t * along
        x = foot - s * axis
        if np.linalg.norm(x) < 1e-6:
            x = np.cross(axis, along)
    x = x / np.linalg.norm(x)
    x = -x if x @ transform[:3, 0] < -1e-9 else x
    frame = np.eye(4)
    frame[:3] = np.column_stack([x, np.cross(axis, x), axis, foot])
    return frame


@dataclass(frozen=True, eq=False)
class UncertainArm:
    """An arm, its geometry parameters by the names of the package, and the chain they act on.

    `largest` (n,) are the torques by which those under gravity are divided.
    """

    arm: Arm
    chain: Chain
    geometry: Geometry

    @property
    def names(self) -> tuple[tuple[str, str], ...]:
        return self.geometry.names

    @property
    def lengths(self) -> np.ndarray:
        """(g,) True for a, b, d: mm, not rad."""
        return np.array([axis in ("a", "b", "d") for _, axis in self.names])

    def grouped(self, values: np.ndarray) -> dict[str, dict[str, Value]]:
        actual: dict[str, dict[str, Value]] = {}
        for (of, axis), value in zip(self.names, np.moveaxis(values, -1, 0), strict=True):
            actual.setdefault(of, {})[axis] = value
        return actual

    def torques(self, q: np.ndarray, masses: np.ndarray, up: np.ndarray) -> np.ndarray:
        """(..., n) minus the derivatives of the potential energy by the revolute joints, of the nominal arm;
        complex q goes through: the masses' circles are sines of each joint's position."""

        def energy(theta: np.ndarray) -> np.ndarray:
            ends = self.chain.frames(theta, {})[1:]
            return sum(mass * (end[..., :3, 3] @ up) for mass, end in zip(masses, ends, strict=True))

        quarter, here = np.diag(np.full(q.shape[-1], np.pi / 2)), q[..., None, :]
        rates = (energy(here + quarter) - energy(here - quarter)) / 2
        return np.where([kind == "r" for kind in self.chain.kinds], -rates, 0)

    def true_joints(self, q: np.ndarray, delta: np.ndarray, values: np.ndarray) -> np.ndarray:
        actual, gravity = self.grouped(values), self.geometry.gravity
        bend = np.zeros(q.shape)
        if gravity is not None:
            largest = np.where(gravity.largest > 0, gravity.largest, 1.0)
            bend = self.torques(q, gravity.masses, gravity.up) / largest
        rates = {"gravity": bend, "cos": np.cos(q), "sin": np.sin(q)}
        theta = (q + delta).astype(complex)
        for i in range(q.shape[-1]):
            of_joint = actual.get(f"joint{i + 1}", {})
            for name in of_joint.keys() & rates.keys():
                theta[..., i] += of_joint[name] * rates[name][..., i]
        return theta

    def pose(self, q: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """(..., 4, 4) of the flange at what was recorded; `arm` are offsets (n,) and geometry (g,)."""
        n = q.shape[-1]
        theta = self.true_joints(q, arm[..., :n], arm[..., n:])
        return self.chain.frames(theta, self.grouped(arm[..., n:]))[-1]

    def miss(self, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        """As of `plain_model`; `free` is offsets, geometry, target, tool in one vector."""
        n, g = q.shape[-1], len(self.names)
        values, rest = free[..., : n + g], free[..., n + g :]
        rest = np.concatenate([np.zeros((*free.shape[:-1], n)), rest], axis=-1)
        return miss(lambda _: self.pose(q, values), tool, q, spot, rest)

    def covariance(
        self, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray, variances: np.ndarray
    ) -> np.ndarray:
        """S (..., d, d), the joints' noise by the columns of the offsets, as the package takes it."""
        n, g = q.shape[-1], len(self.names)
        values, rest = free[..., n : n + g], free[..., n + g :]
        theta = self.true_joints(q, free[..., :n], values)
        links = self.grouped(values[..., None, None, :])  # the same at each joint's steps to either side
        actual = Arm(self.arm.robot, lambda at: self.chain.frames(at, links)[-1])
        rest = np.concatenate([np.zeros((*free.shape[:-1], n)), rest], axis=-1)
        return covariance(actual, tool, theta, spot, rest, variances)


def uncertain(name: str, own: Arm, geometry: Geometry) -> UncertainArm:
    """One of the arms of `plain_model` by name, in rows where it has rows."""
    if name in ROWS:
        kinds = "".join(joint.kind[0] for joint in own.robot.joints)
        return UncertainArm(own, chain_of_rows(*ROWS[name], kinds), geometry)
    return UncertainArm(own, chain_of_robot(own.robot), geometry)
