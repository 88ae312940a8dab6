"""The model a second time: plain numpy from the equations, without CasADi or the package's own chain.

Every function here also takes complex numbers (no conjugates), so that a complex step gives derivatives
without any cancellation; and many vectors at once, stacked along leading axes (`...`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.instruments.kind import Instrument
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Joint, Robot

Pose = Callable[[np.ndarray], np.ndarray]

# The first axis is neither at the base's origin nor along one of its axes.
URDF = """<?xml version="1.0"?>
<robot name="bent">
  <link name="base"/> <link name="one"/> <link name="two"/> <link name="three"/> <link name="four"/>
  <link name="hand"/>
  <joint name="j1" type="revolute">
    <parent link="base"/><child link="one"/>
    <origin xyz="0.1 -0.2 0.35" rpy="0.3 -0.2 0.7"/><axis xyz="0.1 0.2 1"/>
    <limit lower="-2.5" upper="2.5" effort="0" velocity="1"/>
  </joint>
  <joint name="j2" type="revolute">
    <parent link="one"/><child link="two"/>
    <origin xyz="0.15 0 0.1" rpy="-1.5707963267948966 0 0.1"/><axis xyz="0 0 -1"/>
    <limit lower="-1.5" upper="1.5" effort="0" velocity="1"/>
  </joint>
  <joint name="j3" type="prismatic">
    <parent link="two"/><child link="three"/>
    <origin xyz="0.4 0.05 0" rpy="0 0.4 0"/><axis xyz="1 -1 0.5"/>
    <limit lower="-0.1" upper="0.4" effort="0" velocity="1"/>
  </joint>
  <joint name="j4" type="continuous">
    <parent link="three"/><child link="four"/>
    <origin xyz="0.3 0 0.02" rpy="0 1.5707963267948966 0.2"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="four"/><child link="hand"/><origin xyz="0.01 0.02 0.08" rpy="0.5 0 -0.3"/>
  </joint>
</robot>
"""

TABLE_1 = [  # a, alpha, d, theta of the paper's Table 1, mm and degrees
    (150, -90, 486.5, 0),
    (700, 0, 0, -90),
    (0, 90, 0, 180),
    (0, -90, 600, 0),
    (0, 90, 0, 0),
    (0, 0, 0, 0),
]
MODIFIED = [
    (0, 0, 300, 10),
    (50, -90, 0, -90),
    (430, 5, 120, 0),
    (20, -90, 400, 30),
    (0, 90, 0, 0),
    (5, -88, 70, 0),
]
SCARA = [(325, 0, 200, 0), (275, 180, 0, 0), (0, 3, 50, 15), (10, 0, 40, 0)]
GANTRY = [(0, 20, 100, 0), (200, 90, 0, 0), (300, -90, 30, 0), (0, 70, 200, 0)]

DESIGNED = ("irb1600", "modified", "scara", "gantry", "bent")


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot of the package, and the pose of its flange by other means: (..., n) -> (..., 4, 4)."""

    robot: Robot
    pose: Pose

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Joint positions (n,) anywhere within 0.9 of the limits."""
        middle, half = (self.robot.upper + self.robot.lower) / 2, (self.robot.upper - self.robot.lower) / 2
        return middle + rng.uniform(-0.9, 0.9, self.robot.n) * half


def arm(name: str, folder: Path, panda: Path | None = None) -> Arm:
    """One of DESIGNED, or `panda` from its URDF file; `folder` takes files that are written."""
    if name == "irb1600":
        return Arm(load_robot("irb1600", folder), _dh_pose(TABLE_1, "standard", "rrrrrr"))
    if name == "modified":
        return _dh_arm(name, MODIFIED, "modified", "rrrrrr")
    if name == "scara":
        return _dh_arm(name, SCARA, "standard", "rrpr")
    if name == "gantry":
        return _dh_arm(name, GANTRY, "modified", "prrr")
    if name == "bent":
        path = folder / "bent.urdf"
        path.write_text(URDF, encoding="utf-8")
        return Arm(read_urdf(path, "base", "hand"), _urdf_pose(path, "base", "hand"))
    assert panda is not None
    chain = (panda, "panda_link0", "panda_hand_tcp")
    return Arm(read_urdf(*chain), _urdf_pose(*chain))


def _dh_arm(name: str, rows: Sequence[tuple[float, ...]], convention: str, kinds: str) -> Arm:
    fixed, flange = dh_chain(
        [DHRow(a, *np.radians([alpha]), d, *np.radians([theta])) for a, alpha, d, theta in rows], convention
    )
    joints = tuple(
        Joint(f"j{i}", "revolute", before, np.array([0.0, 0.0, 1.0]), -2.5, 2.5)
        if kind == "r"
        else Joint(f"j{i}", "prismatic", before, np.array([0.0, 0.0, 1.0]), -100.0, 300.0)
        for i, (before, kind) in enumerate(zip(fixed, kinds, strict=True))
    )
    return Arm(Robot(name, joints, flange), _dh_pose(rows, convention, kinds))


def _dh_pose(rows: Sequence[tuple[float, ...]], convention: str, kinds: str) -> Pose:
    """Product of the matrices of eq. 1 (standard), or of Craig's eq. 3.6 (modified), as they are printed."""

    def pose(q: np.ndarray) -> np.ndarray:
        result = np.eye(4, dtype=complex)
        for (a, alpha, d, theta), kind, value in zip(rows, kinds, np.moveaxis(q, -1, 0), strict=True):
            angle = np.radians(theta) + (value if kind == "r" else 0)
            along = d + (value if kind == "p" else 0)
            c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
            if convention == "standard":
                link = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, along]]
            else:
                link = [[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * along], [s * sa, c * sa, ca, ca * along]]
            result = result @ matrix([*link, [0, 0, 0, 1]], value.shape)
        return result

    return pose


def _urdf_pose(path: Path, base: str, tip: str) -> Pose:
    """Product along the chain of URDF joints: origin, then motion about or along the axis; metres to mm."""
    root = ElementTree.parse(path).getroot()
    above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    chain = []
    while tip != base:
        chain.insert(0, above[tip])
        tip = above[tip].find("parent").get("link")

    def numbers(element: ElementTree.Element | None, key: str, default: str) -> np.ndarray:
        return np.array((default if element is None else element.get(key, default)).split(), dtype=float)

    steps = []
    for joint in chain:
        before = np.eye(4)
        before[:3, :3] = Rotation.from_euler("xyz", numbers(joint.find("origin"), "rpy", "0 0 0")).as_matrix()
        before[:3, 3] = 1000 * numbers(joint.find("origin"), "xyz", "0 0 0")
        axis = numbers(joint.find("axis"), "xyz", "1 0 0")
        steps.append((joint.get("type"), before, axis / np.linalg.norm(axis)))

    def pose(q: np.ndarray) -> np.ndarray:
        result, values = np.eye(4, dtype=complex), iter(np.moveaxis(q, -1, 0))
        for kind, before, axis in steps:
            result = result @ before
            if kind == "fixed":
                continue
            value = next(values)
            motion = matrix(np.eye(4), value.shape)
            if kind == "prismatic":
                motion[..., :3, 3] = axis * value[..., None]
            else:
                motion[..., :3, :3] = turn(axis, value)
            result = result @ motion
        assert next(values, None) is None
        return result

    return pose


def matrix(rows: Sequence[Sequence[Any]], shape: tuple[int, ...] = ()) -> np.ndarray:
    """(..., rows, columns) of entries that are numbers or of that shape (...)."""
    result = np.empty((*shape, len(rows), len(rows[0])), dtype=complex)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            result[..., i, j] = entry
    return result


def turn(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotation (..., 3, 3) by `angle` about the unit `axis`, from the unit quaternion (w, v) of half the
    angle."""
    w, (x, y, z) = np.cos(angle / 2), np.multiply.outer(axis, np.sin(angle / 2))
    cross = matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]], np.shape(angle))
    return np.eye(3) + 2 * np.asarray(w)[..., None, None] * cross + 2 * cross @ cross


# --- the tool and the miss --------------------------------------------------------------------------


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.sqrt((v * v).sum(axis=-1, keepdims=True))


def across(nominal: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(..., 3, 2): b1 is the first of the axes across the nominal beam axis, square to u, and b2."""
    axis = int(np.argmax(np.abs(nominal)))
    first = np.eye(3)[{0: 1, 1: 2, 2: 0}[axis]]
    b1 = unit(first - (first * u).sum(axis=-1, keepdims=True) * u)
    return np.stack([b1, np.sign(nominal[axis]) * np.cross(u, b1)], axis=-1)


def beam(tool: Instrument, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p, u of a laser: u = normalise(u0 + tan(tilt1) b1 + tan(tilt2) b2), p = p0 + shift1 b1 + shift2 b2."""
    p, u = tool.point, tool.direction
    if unknowns.shape[-1]:
        b1, b2 = across(u, u).T
        tilt1, tilt2, shift1, shift2 = np.moveaxis(unknowns, -1, 0)[..., None]
        u = unit(u + np.tan(tilt1) * b1 + np.tan(tilt2) * b2)
        p = p + shift1 * b1 + shift2 * b2
    return p, u


def miss(pose: Pose, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
    """m (..., d) of section 1: y = R'(P - t); B'(y - p) - s of a beam, y - p of a probe.

    `free` is delta, target, tool in one vector.
    """
    n = q.shape[-1]
    delta, target, unknowns = free[..., :n], free[..., n : n + 3], free[..., n + 3 :]
    flange = pose(q + delta)
    y = _rows_times(flange[..., :3, :3], target - flange[..., :3, 3])
    if tool.name == "probe":
        return y - (unknowns if unknowns.shape[-1] else tool.point)
    p, u = beam(tool, unknowns)
    return _rows_times(across(tool.direction, u), y - p) - spot


def _rows_times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """M'v of each."""
    return (np.swapaxes(matrices, -1, -2) @ vectors[..., None])[..., 0]


def by_joints(own: Arm, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(..., d, n) derivative of the miss by the recorded joints, without any step error.

    The miss is a sine of each turn and linear in each slide: half the difference of its values a quarter turn
    (or 1 mm) to either side is its derivative. Complex numbers go through, so that it can be derived again.
    """
    steps = np.diag(np.where(own.robot.display == 1, 1.0, np.pi / 2))
    around = q[..., None, None, :] + np.stack([steps, -steps])
    values = miss(own.pose, tool, around, spot, free[..., None, None, :])
    return np.swapaxes(values[..., 0, :, :] - values[..., 1, :, :], -1, -2) / 2


def covariance(
    own: Arm, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray, variances: np.ndarray
) -> np.ndarray:
    """S (..., d, d) of section 1: joint noise through the miss, and spot noise; `variances` (..., n + 1)."""
    jacobian = by_joints(own, tool, q, spot, free)
    joints, spots = variances[..., None, :-1], variances[..., -1, None, None]
    return (jacobian * joints) @ np.swapaxes(jacobian, -1, -2) + spots * np.eye(jacobian.shape[-2])


def terms(
    own: Arm, tool: Instrument, q: np.ndarray, spot: np.ndarray, free: np.ndarray, variances: np.ndarray
) -> np.ndarray:
    """(..., 2) m' S^-1 m and the whole log det S of one shot."""
    m, s = miss(own.pose, tool, q, spot, free), covariance(own, tool, q, spot, free, variances)
    return np.stack([square(m, s), np.log(np.linalg.det(s.astype(complex)))], axis=-1)


def square(m: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(...) m' S^-1 m."""
    return (m * np.linalg.solve(s, m[..., None])[..., 0]).sum(axis=-1)


# --- derivatives ------------------------------------------------------------------------------------


def by_complex_step(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """(..., size of x) derivative without cancellation: the imaginary part of one tiny imaginary step."""
    step = 1e-30
    columns = [np.imag(function(x + 1j * step * e)) / step for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def by_complex_steps(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """The same of a function that takes many vectors at once: all steps in one call."""
    step = 1e-30
    return np.moveaxis(np.imag(function(x + 1j * step * np.eye(len(x)))) / step, 0, -1)


def by_differences(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """(..., size of x) central differences of fourth order: the error is step^4 / 30 of the fifth derivative,
    and 1.5 roundings of the function over the step."""
    columns = []
    for e in np.diag(steps):
        near = np.asarray(function(x + e)) - np.asarray(function(x - e))
        far = np.asarray(function(x + 2 * e)) - np.asarray(function(x - 2 * e))
        columns.append((8 * near - far) / (12 * e.sum()))
    return np.stack(columns, axis=-1)
