"""Arms of the study of wrong models: a simulator of its own, in plain NumPy; and what is wrong with an arm, a
cell, a recording or a robot file, and by which cause a diagnosis may name it.

An arm has links, gravity, harmonics, tool and backlash at typical sizes; each of them may change from one
measurement of a run to the next. Postures are those of a plan, moved until the beam has the target at the
intended spot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import load_robot
from ...model.instruments.flange_tool import FlangeTool
from ...model.kinematics.dh import DHRow, as_row, dh_chain, with_fixed
from ...model.kinematics.robot import Robot, rotations
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


# ── what is wrong ─────────────────────────────────────────────────────────────────────────────

Readings = tuple[Matrix, Matrix]  # joints (N, n) rad and spots (N, 2) mm


@dataclass(frozen=True, eq=False)
class Scenario:
    """One thing that is wrong. `named` are the causes that name it, each with its joints, of any where there
    are none; empty where none can.

    It is not `noticeable` where the residuals of every arm stay as they were. `course` changes the arm or its
    cell, `readings` what is recorded, `robot` the arm that the analysis has. `condition` is the wrong model
    without which a pass is stated, where it says so.
    """

    name: str
    named: str = ""
    condition: str = ""
    course: Callable[[Course], Course] = lambda course: course
    readings: Callable[[Matrix, Matrix], Readings] = lambda joints, spots: (joints, spots)
    robot: Callable[[Robot], Robot] = lambda robot: robot
    measured: str = "irb1600"
    noticeable: bool = True

    def is_named_by(self, cause: str, joints: tuple[int, ...]) -> bool:
        whole = " ".join([cause, *map(str, joints)])
        return any(one in (cause, whole) for one in self.named.split(", ") if one)


def scenarios() -> tuple[Scenario, ...]:
    """All of them; the first is the control, an arm as the model takes it."""
    nothing = Scenario("control: nothing is wrong")
    return (nothing, *_of_joints(), *_of_robot_file(), *_of_cell(), *_of_the_run(), *_of_size(), *_of_spots())


def _of_joints() -> Iterator[Scenario]:
    """What is wrong with the columns of joints."""

    def columns(name: str, named: str, change: Callable[[Matrix], Matrix], condition: str = "") -> Scenario:
        return Scenario(name, named, condition, readings=lambda q, spots: (change(q), spots))

    def swapped(i: int, j: int) -> Callable[[Matrix], Matrix]:
        order = [{i: j, j: i}.get(k, k) - 1 for k in range(1, 7)]
        return lambda q: q[:, order]

    def turned(joint: int) -> Callable[[Matrix], Matrix]:
        return lambda q: q * np.where(np.arange(6) == joint - 1, -1.0, 1.0)

    def shifted(joint: int, degrees: float) -> Callable[[Matrix], Matrix]:
        return lambda q: q + _joint(joint, degrees)

    for i, j in ((1, 2), (2, 3), (4, 6), (5, 6)):
        yield columns(f"columns of J{i} and J{j} exchanged", f"swapped_joints {i} {j}", swapped(i, j))
    for i, named in ((1, "sign 1"), (3, "sign 3"), (5, "sign 5, zero 4")):
        yield columns(f"sign of J{i} reversed", named, turned(i))
    for i, off, named in ((2, 90.0, "zero 2"), (4, 180.0, "zero 4, sign 5"), (3, -30.0, "zero 3")):
        yield columns(f"zero of J{i} {off:g}° off", named, shifted(i, off))
    yield columns("radians in place of degrees", "units", np.radians)
    yield columns("angles converted to degrees twice", "units", np.degrees)
    level = np.eye(6)[2]
    yield columns("J3 recorded against the horizontal", "coupling 2 3", lambda q: q + level * q[:, 1:2])
    yield columns("joints of the measurement before", "rows", lambda q: np.roll(q, 1, axis=0), "reading")


def _of_robot_file() -> Iterator[Scenario]:
    def other_row(row: int, column: int, times: float = 1.0, more: float = 0.0) -> Callable[[Robot], Robot]:
        """With one number of a row multiplied, and so much larger."""

        def change(rows: Matrix) -> Matrix:
            result = rows.copy()
            result[row - 1, column] = times * result[row - 1, column] + more
            return result

        return lambda robot: rows_of(robot, change)

    def another(name: str) -> Callable[[Robot], Robot]:
        return lambda _: load_robot(name, Path())

    file = "robot file: "
    for row, joints in ((1, "1 2"), (4, "4 5")):
        yield Scenario(f"{file}sign of alpha in row {row}", f"twist {joints}", robot=other_row(row, 1, -1.0))
    yield Scenario(
        f"{file}rows of standard DH read as modified",
        "convention",
        robot=lambda robot: rows_of(robot, lambda rows: rows, "modified"),
    )
    for row in (2, 6):
        yield Scenario(f"{file}theta missing in row {row}", f"zero {row}", robot=other_row(row, 3, 0.0))
    for measured, analysed in (
        ("irb1600", "irb2600"),
        ("irb1600", "irb1200_7_70"),
        ("kr6_r900_2", "kr6_r900"),
        ("irb120", "irb1200"),
    ):
        name = f"{measured} analysed as {analysed}"
        yield Scenario(name, "arm", robot=another(analysed), measured=measured)
    for row, letter, mm in ((2, "a", 1.0), (2, "a", 3.0), (2, "a", -3.0), (4, "d", 3.0), (1, "a", 3.0)):
        longer = other_row(row, 2 * "ad".index(letter), 1.0, mm)
        yield Scenario(f"{file}{letter} of row {row} {mm:+g} mm", f"length {row}", "arm", robot=longer)


def rows_of(
    robot: Robot,
    change: Callable[[Matrix], Matrix],
    convention: Literal["standard", "modified"] = "standard",
) -> Robot:
    """A robot of standard rows a, alpha, d, theta (n, 4), mm and rad, with other rows, or with its rows read
    by another convention."""
    ends = [*(joint.fixed for joint in robot.joints[1:]), robot.flange]
    rows = change(np.array([astuple(row)[:4] for end in ends if (row := as_row(end)) is not None]))
    fixed, flange = dh_chain([DHRow(*row.tolist()) for row in rows], convention)
    return with_fixed(robot, [robot.joints[0].fixed @ fixed[0], *fixed[1:], flange])


def _of_cell() -> Iterator[Scenario]:
    """What is wrong with tool and target."""

    def tilted(about: float, across: float) -> Callable[[Course], Course]:
        tilt = np.array([0.0, np.radians(about), np.radians(across)])

        def course(course: Course) -> Course:
            beams = course.direction + tilt
            return replace(course, direction=beams / np.linalg.norm(beams, axis=1)[:, None])

        return course

    for mm in (1.0, 2.0, 5.0):
        yield Scenario(f"TCP {mm:g} mm off", "tool", "tool", _more("point", np.array([0.0, mm, 0.0])))
    for by in (0.1, 0.3, 1.0):
        yield Scenario(f"beam tilted by {by:g}° across the axis of J6", "tool", "beam", tilted(0.0, by))
        # The same as an offset of J6: only what is stated of the tool speaks against it.
        name = f"beam rotated by {by:g}° about the axis of J6"
        yield Scenario(name, "", "beam", tilted(by, 0.0), noticeable=False)
    for mm in (1.0, 3.0):
        moved = _more("target", np.array([0.48, 0.64, -0.6]) * mm, _late)
        yield Scenario(f"PSD moved by {mm:g} mm in mid-run", "moved_target", "moved", moved)


def _of_the_run() -> Iterator[Scenario]:
    """What changes during a run."""

    def off(mm: float) -> Callable[[Matrix, Matrix], Readings]:
        """A spot of one measurement."""
        return lambda q, spots: (q, spots + _only(spots, len(spots) // 3) * np.array([0.8, 0.6]) * mm)

    def early(q: Matrix, spots: Matrix) -> Readings:
        return q - 0.001 * np.diff(q, axis=0, prepend=q[:1]), spots

    def slipped(q: Matrix, spots: Matrix) -> Readings:
        return q + _only(q, 2) * _joint(2, 0.5), spots

    for i in (2, 3, 5):
        for by in (0.1, 0.2, 0.5):
            jump = _more("offsets", _joint(i, by), _late)
            yield Scenario(f"zero of J{i} jumps by {by:g}°", f"jump {i}", "jump", jump)
    drifting = _more("offsets", _joint(2, 0.1), _passed)
    drift = _more("target", np.array([0.96, 1.28, -1.2]), _passed)
    growing = _more("links", lambda course: _link(course, "link2", "a", 0.5), _passed)
    yield Scenario("zero of J2 drifts by 0.1°", "drift 2", "drift", drifting)
    yield Scenario("PSD drifts by 2 mm", "drift", "moved", drift)
    yield Scenario("link 2 grows by 0.5 mm", "", "arm", growing)
    yield Scenario("joints read 0.1 % of the way early", "lag", "reading", readings=early)
    for mm in (1.0, 5.0):
        yield Scenario(f"one spot {mm:g} mm off", "measurements", "reading", readings=off(mm))
    yield Scenario("one joint reading 0.5° off", "measurements", "reading", readings=slipped)


def _of_size() -> Iterator[Scenario]:
    """What is larger than stated."""

    def loose(degrees: float) -> Callable[[Course], Course]:
        return lambda course: replace(course, backlash=np.full(course.robot.n, np.radians(degrees)))

    def noisy(times: float) -> Callable[[Course], Course]:
        return lambda course: replace(course, noise=times)

    def three(name: str) -> Callable[[Course], Course]:
        return lambda course: replace(course, **{name: 3 * getattr(course, name)})

    def tilted(course: Course) -> Course:
        return replace(course, up=np.array([np.sin(np.radians(5)), 0.0, np.cos(np.radians(5))]))

    for by in (0.03, 0.05, 0.1):
        yield Scenario(f"backlash {by:g}°", "backlash", "backlash", loose(by))
    for by in (2.0, 3.0, 5.0):
        yield Scenario(f"noise {by:g} times the stated", "noise", "noise", noisy(by))
    for name, named in (
        ("gravity", "gravity, geometry"),
        ("harmonics", "harmonics, geometry"),
        ("links", "geometry"),
    ):
        yield Scenario(f"{name} 3 times typical", named, "arm", three(name))
    yield Scenario("gain of J2 0.1 % off", "gain 2", "arm", _more("gain", _joint(2, np.degrees(1e-3))))
    yield Scenario("second harmonic of J2 0.02°", "", "arm", _more("second", _joint(2, 0.02)))
    yield Scenario("arm tilted by 5° against gravity", "", "arm", tilted)


def _of_spots() -> Iterator[Scenario]:
    """What is wrong with the axes of the spots."""

    def axes(matrix: list[list[float]]) -> Callable[[Matrix, Matrix], Readings]:
        turned = np.array(matrix).T
        return lambda q, spots: (q, spots @ turned)

    for name, named, matrix in (
        ("spot axes exchanged", "spot", [[0.0, 1.0], [1.0, 0.0]]),
        ("spot axes rotated by 90°", "spot", [[0.0, -1.0], [1.0, 0.0]]),
        ("spot in place of the target", "spot", [[-1.0, 0.0], [0.0, -1.0]]),
        ("first spot axis reversed", "spot", [[-1.0, 0.0], [0.0, 1.0]]),
        ("spots 10 % too large", "", [[1.1, 0.0], [0.0, 1.1]]),
    ):
        yield Scenario(name, named, "reading", readings=axes(matrix))


def _more(
    name: str,
    by: Matrix | Callable[[Course], Matrix],
    when: Callable[[Course], Matrix | float] = lambda _: 1.0,
) -> Callable[[Course], Course]:
    """A course of which something is so much larger, at each measurement by that share."""

    def course(course: Course) -> Course:
        more = when(course) * (by(course) if callable(by) else by)
        return replace(course, **{name: getattr(course, name) + more})

    return course


def _late(course: Course) -> Matrix:
    """(N, 1) 1 in the second half."""
    return np.asarray((np.arange(course.measurements) >= course.measurements // 2) * 1.0)[:, None]


def _passed(course: Course) -> Matrix:
    """(N, 1) 0 at the first measurement, 1 at the last."""
    return np.linspace(0.0, 1.0, course.measurements)[:, None]


def _only(values: Matrix, row: int) -> Matrix:
    """(N, 1) 1 in one row."""
    return np.asarray(np.arange(len(values)) == row)[:, None]


def _joint(joint: int, degrees: float) -> Matrix:
    """(6,) rad of one joint."""
    return np.asarray((np.arange(6) == joint - 1) * np.radians(degrees))


def _link(course: Course, of: str, axis: str, value: float) -> Matrix:
    names = [item for item in course.geometry.names if item[0].startswith("link")]
    return np.array([value if item == (of, axis) else 0.0 for item in names])
