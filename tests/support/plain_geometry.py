"""Arms with uncertain geometry a second time: plain numpy from the definition, complex numbers go through.

Where an arm is written in Denavit-Hartenberg rows, its link parameters are added to the rows as they are
printed; where it is a chain of joints, they act in frames found from the nominal axes by least squares.
"""

from __future__ import annotations

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
    miss,
)

from zerobeam.model.geometry import Geometry
from zerobeam.model.robot import Robot
from zerobeam.model.tool import Tool

Link = Callable[[Mapping[str, complex]], np.ndarray]
ROWS = {
    "irb1600": (TABLE_1, "standard"),
    "modified": (MODIFIED, "modified"),
    "scara": (SCARA, "standard"),
    "gantry": (GANTRY, "modified"),
}
_Z = np.array([0.0, 0.0, 1.0])


def rotation(axis: str, angle: complex) -> np.ndarray:
    """(4, 4) about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    upper = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    upper["z"] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    result = np.eye(4, dtype=complex)
    result[:3, :3] = upper[axis]
    return result


def shift(x: complex = 0, y: complex = 0, z: complex = 0) -> np.ndarray:
    result = np.eye(4, dtype=complex)
    result[:3, 3] = x, y, z
    return result


def deviation(own: Mapping[str, complex]) -> np.ndarray:
    """Tz(d) Tx(a) Rz(theta) Rx(alpha) Ry(beta), factor by factor."""
    steps = [shift(z=own.get("d", 0)), shift(x=own.get("a", 0))]
    angles = (("z", "theta"), ("x", "alpha"), ("y", "beta"))
    steps += [rotation(axis, own.get(name, 0)) for axis, name in angles]
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

    def frames(self, theta: np.ndarray, own: Mapping[str, Mapping[str, complex]]) -> list[np.ndarray]:
        """(4, 4) of each joint before its motion, and of the flange; `own` parameters by link."""
        frames = [self.first.astype(complex)]
        for i, (kind, axis, link) in enumerate(zip(self.kinds, self.axes, self.links, strict=True)):
            motion = np.eye(4, dtype=complex)
            if kind == "p":
                motion[:3, 3] = axis * theta[i]
            else:
                x, y, z = axis
                cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                motion[:3, :3] += np.sin(theta[i]) * cross + (1 - np.cos(theta[i])) * cross @ cross
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
        return lambda own: start @ deviation(own) @ end

    return Chain(kinds, (_Z,) * len(rows), before, tuple(link(*row) for row in behind))


def chain_of_robot(robot: Robot) -> Chain:
    """The joints of a robot, its links' frames from the axes."""
    transforms = [*(joint.fixed for joint in robot.joints[1:]), robot.flange]
    nexts = [*(joint.axis for joint in robot.joints[1:]), _Z]

    def link(axis: np.ndarray, transform: np.ndarray, after: np.ndarray) -> Link:
        frame = link_frame(axis, transform, after)
        back = np.linalg.inv(frame) @ transform
        return lambda own: frame @ deviation(own) @ back

    links = [
        link(joint.axis, transform, after)
        for joint, transform, after in zip(robot.joints, transforms, nexts, strict=True)
    ]
    kinds = "".join(joint.kind[0] for joint in robot.joints)
    return Chain(kinds, tuple(joint.axis for joint in robot.joints), robot.joints[0].fixed, tuple(links))


def link_frame(axis: np.ndarray, transform: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(4, 4) z along the axis, x along the common normal, at the point of the next axis that is nearest; at
    the next joint's origin where the axes are within 5 degrees of parallel."""
    place, along = transform[:3, 3], transform[:3, :3] @ after
    if np.degrees(np.arccos(min(abs(axis @ along), 1.0))) < 5:
        foot, x = place, place - (place @ axis) * axis
        if np.linalg.norm(x) < 1e-6:
            x = transform[:3, 0] - (transform[:3, 0] @ axis) * axis
    else:
        # Lengths s along this axis and t along the next: s axis - (place + t along) is the shortest.
        s, t = np.linalg.lstsq(np.array([axis, -along]).T, place, rcond=None)[0]
        foot = place + t * along
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
        """(g,) True for a, d: mm, not rad."""
        return np.array([axis in ("a", "d") for _, axis in self.names])

    def grouped(self, values: np.ndarray) -> dict[str, dict[str, complex]]:
        own: dict[str, dict[str, complex]] = {}
        for (of, axis), value in zip(self.names, values, strict=True):
            own.setdefault(of, {})[axis] = value
        return own

    def torques(self, q: np.ndarray, masses: np.ndarray, up: np.ndarray) -> np.ndarray:
        """(n,) minus the derivatives of the potential energy by the revolute joints, of the nominal arm;
        complex q goes through: the masses' circles are sines of each joint's position."""

        def energy(theta: np.ndarray) -> complex:
            ends = self.chain.frames(theta, {})[1:]
            return sum(mass * (end[:3, 3] @ up) for mass, end in zip(masses, ends, strict=True))

        quarter = np.diag(np.full(len(q), np.pi / 2))
        rates = [(energy(q + e) - energy(q - e)) / 2 for e in quarter]
        return np.array([-r if kind == "r" else 0 for r, kind in zip(rates, self.chain.kinds, strict=True)])

    def true_joints(self, q: np.ndarray, delta: np.ndarray, values: np.ndarray) -> np.ndarray:
        own, gravity = self.grouped(values), self.geometry.gravity
        theta = q + delta
        if gravity is not None:
            largest = np.where(gravity.largest > 0, gravity.largest, 1.0)
            bend = self.torques(q, gravity.masses, gravity.up) / largest
            theta = theta + [own.get(f"joint{i + 1}", {}).get("gravity", 0) * b for i, b in enumerate(bend)]
        cosines = [own.get(f"joint{i + 1}", {}).get("cos", 0) for i in range(len(q))]
        sines = [own.get(f"joint{i + 1}", {}).get("sin", 0) for i in range(len(q))]
        return theta + cosines * np.cos(q) + sines * np.sin(q)

    def pose(self, q: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """(4, 4) of the flange at what was recorded; `arm` are offsets (n,) and geometry (g,)."""
        n = len(q)
        theta = self.true_joints(q, arm[:n], arm[n:])
        return self.chain.frames(theta, self.grouped(arm[n:]))[-1]

    def miss(self, tool: Tool, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        """As of `plain_model`; `free` is offsets, geometry, target, tool in one vector."""
        own = free[: len(q) + len(self.names)]
        rest = np.concatenate([np.zeros(len(q)), free[len(own) :]])
        return miss(lambda _: self.pose(q, own), tool, q, spot, rest)

    def covariance(
        self, tool: Tool, q: np.ndarray, spot: np.ndarray, free: np.ndarray, variances: np.ndarray
    ) -> np.ndarray:
        """S (d, d), the joints' noise by the columns of the offsets, as the package takes it."""
        n, g = len(q), len(self.names)
        values = free[n : n + g]
        theta = self.true_joints(q, free[:n], values)
        own = Arm(self.arm.robot, lambda at: self.chain.frames(at, self.grouped(values))[-1])
        rest = np.concatenate([np.zeros(n), free[n + g :]])
        return covariance(own, tool, theta, spot, rest, variances)


def uncertain(name: str, own: Arm, geometry: Geometry) -> UncertainArm:
    """One of the arms of `plain_model` by name, in rows where it has rows."""
    if name in ROWS:
        kinds = "".join(joint.kind[0] for joint in own.robot.joints)
        return UncertainArm(own, chain_of_rows(*ROWS[name], kinds), geometry)
    return UncertainArm(own, chain_of_robot(own.robot), geometry)
