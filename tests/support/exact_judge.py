"""Random arms in fifty digits, for the tests of exact gauges: what is null of their Jacobians.

The judge shares nothing with the package but the cell and rough joint values: its arm is multiplied out of
Denavit-Hartenberg rows, its Jacobian is that of the joints' and links' screws, its measurements hit to forty
digits: mpmath.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
from cells import header
from hypothesis import strategies as st
from mpmath import mpf
from numpy.typing import NDArray

from zerobeam.analysis.observability.aim import aim
from zerobeam.analysis.observability.gauges import ROUNDING, information_root
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.geometry import NOMINAL
from zerobeam.model.likelihood.problem import Problem

Exact = NDArray[np.object_]  # of numbers in fifty digits

mpmath.mp.dps = 50
ZERO = mpf(10) ** -25  # of a pivot, columns of unit length: far from what is small and from what is rounding
UNRESOLVED = 1e-8  # of a singular value on columns of unit length, at most: see `unresolved`
EYE = np.array([[mpf(int(i == j)) for j in range(3)] for i in range(3)])
_HIT = mpf(10) ** -40  # metres
_RESOLVED = mpf(10) ** -8  # of a pivot: what breaks a gauge by less, double precision need not tell from none
_SPOT_MM = 0.05  # of a residual: the joints' noise comes on top
_STEP = 0.2  # mm, and hundredths of a degree: so small that measurements stay those they are, if they can


@dataclass(frozen=True)
class Cell:
    """An arm by its rows, its tool, and shots (N, n) that hit `target` (3,) mm at no offsets."""

    rows: tuple[DHRow, ...]
    kinds: str
    own: Header
    robot: Robot
    target: Matrix
    joints: Matrix
    moving: Matrix


@dataclass(frozen=True)
class Kind:
    """What Hypothesis chooses; the numbers come from the seed."""

    seed: int
    joints: int
    prismatic: bool
    laser: bool
    calibrated: bool
    on_axis: bool
    constant: int
    shots: int
    freed: bool


KINDS = st.builds(
    Kind,
    seed=st.integers(0, 10**6),
    joints=st.integers(3, 8),
    prismatic=st.booleans(),
    laser=st.booleans(),
    calibrated=st.booleans(),
    on_axis=st.sampled_from([False, False, False, True]),
    constant=st.integers(0, 2),
    shots=st.sampled_from([3, 5, 8, 12]),
    freed=st.booleans(),
)


def dh_row(rng: np.random.Generator) -> DHRow:
    a, d = (float(rng.choice([0.0, np.round(rng.uniform(100, 600), 3)])) for _ in range(2))
    alpha = float(
        rng.choice([0.0, np.pi / 2, -np.pi / 2, rng.uniform(-np.pi, np.pi)], p=[0.2, 0.3, 0.3, 0.2])
    )
    return DHRow(a, alpha, d, float(rng.choice([0.0, -np.pi / 2, rng.uniform(-np.pi, np.pi)])))


def robot_of(rows: Sequence[DHRow], kinds: str) -> Robot:
    """Of standard rows, its joints "r" or "p"."""
    fixed, flange = dh_chain(tuple(rows), "standard")
    joints = tuple(
        Joint(f"joint{i + 1}", "revolute", fixed[i], np.array([0.0, 0.0, 1.0]), -np.pi, np.pi)
        if kinds[i] == "r"
        else Joint(f"joint{i + 1}", "prismatic", fixed[i], np.array([0.0, 0.0, 1.0]), -500.0, 500.0)
        for i in range(len(kinds))
    )
    return Robot("random", joints, flange)


def random_cell(kind: Kind) -> Cell | None:
    """None where this arm cannot hit a target in so many ways."""
    rng = np.random.default_rng(kind.seed)
    n = kind.joints
    rows = tuple(dh_row(rng) for _ in range(n))
    if kind.on_axis:
        rows = (
            *rows[:-1],
            dataclasses.replace(rows[-1], alpha=float(rng.choice([0.0, np.pi / 2, -np.pi / 2]))),
        )
    kinds = "".join("p" if kind.prismatic and rng.random() < 0.3 else "r" for _ in range(n))
    robot = robot_of(rows, kinds)
    flange = robot.flange
    direction = [[1, 0, 0], [0, 0, 1], rng.normal(size=3).round(3).tolist()][rng.integers(3)]
    point = rng.uniform(-80, 80, 3).round(2).tolist()
    if kind.on_axis:
        # The axis of the last joint, as the flange sees it behind the last row: without any rounding.
        axis = np.round(np.linalg.inv(flange)[:3, 2])
        direction, point = axis.tolist(), [-rows[-1].a, 0.0, 0.0]
    tool: dict[str, Any] = {"kind": "laser" if kind.laser else "probe", "calibrated": kind.calibrated}
    tool |= {"point_mm": point, "direction": direction} if kind.laser else {"point_mm": point}
    noise = {"joint_mm": 0.02} if "p" in kinds else None
    own = header(tool, target=None, noise=noise, held=[] if kind.freed else None)

    lower, upper = robot.lower, robot.upper
    first = rng.uniform(0.6 * lower, 0.6 * upper)
    tries = 30 * kind.shots
    start = rng.uniform(0.6 * lower, 0.6 * upper, (tries, n))
    start[:, : kind.constant] = first[: kind.constant]
    start[0] = first
    moving = np.ones(n)
    moving[: kind.constant] = 0.0
    problem = Problem.build(own, robot, start, ["psd"] * tries)
    origin, along = problem.beams(problem.parameters.prior_mean) if kind.laser else (None, None)
    x = problem.parameters.prior_mean.copy()
    if origin is None or along is None:
        miss, _ = problem.linearise(x, start[:1], np.array([0]))
        _, jacobian = problem.linearise(x, start[:1], np.array([0]))
        # The miss is R'(P - t) - p: its Jacobian by the target is R'.
        target = -jacobian[0, :, n : n + 3].T @ miss[0]
    else:
        target = origin[0] + rng.uniform(300, 900) * along[0]
    x[n : n + 3] = target
    aimed = aim(problem, x, moving)
    good = np.flatnonzero(aimed.hit)
    if kind.laser:
        starts, ways = aimed.problem.beams(x)
        good = good[((target - starts) * ways).sum(axis=1)[good] > 50.0]
    if len(good) < kind.shots:
        return None
    # Where the target pins a joint down that was to vary, these are other shots than those near by.
    spread = np.ptp(aimed.problem.joints[good[: kind.shots]], axis=0) * robot.display
    if (spread[kind.constant :] < 1.0).any():
        return None
    guess = {"psd": {"guess_mm": target.tolist()}}
    return Cell(
        rows, kinds, header(tool, noise=noise, target=None, targets=guess, held=[] if kind.freed else None),
        robot, target, aimed.problem.joints[good[: kind.shots]], moving,
    )  # fmt: skip


def exact(values: Any) -> Exact:
    return np.array([mpf(float(value)) for value in values])


def cross(a: Exact, b: Exact) -> Exact:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def norm(a: Exact) -> mpf:
    return mpmath.sqrt(a @ a)


def unit(a: Exact) -> Exact:
    return np.asarray(a / norm(a))


def cos_sin(angle: float) -> tuple[mpf, mpf]:
    """Of an angle in double precision that means a multiple of a right angle where it looks like one."""
    quarter = angle / (np.pi / 2)
    if quarter == round(quarter):
        return [(mpf(1), mpf(0)), (mpf(0), mpf(1)), (mpf(-1), mpf(0)), (mpf(0), mpf(-1))][round(quarter) % 4]
    return mpmath.cos(mpf(angle)), mpmath.sin(mpf(angle))


@dataclass(frozen=True)
class Values:
    """One choice of all unknowns: rad and m, in fifty digits. `arm` are offsets and geometry, `tool` as the
    parameters have it."""

    arm: Exact
    target: Exact
    tool: Exact


def values_of(problem: Problem, x: Matrix) -> Values:
    metres = [mpf(1) if item.unit == "deg" else mpf(1) / 1000 for item in problem.parameters.items]
    values, arm = exact(x) * np.array(metres), problem.parameters.arm.stop
    return Values(values[:arm], values[arm : arm + 3], values[arm + 3 :])


def joints_of(cell: Cell, joints: Matrix) -> Exact:
    """Joint values (n,) in rad and m."""
    return exact(joints) * np.array([mpf(1) if kind == "r" else mpf(1) / 1000 for kind in cell.kinds])


class Chain:
    """The arm of Denavit-Hartenberg `rows` and `kinds` of joints, with what of its geometry is uncertain."""

    def __init__(self, rows: Sequence[DHRow], kinds: str, geometry: Any = NOMINAL) -> None:
        self.rows, self.kinds = rows, kinds
        self.names = geometry.names if geometry else ()
        self.gravity = geometry.gravity if geometry else None

    def chain(
        self, theta: Exact, links: dict[Any, mpf]
    ) -> tuple[Exact, Exact, list[Any], dict[Any, Any], list[Exact]]:
        """Flange R, t (m); each joint's axis and a point on it; of each link parameter the same (no point of
        a shift); the ends of the links."""
        rotation, place, screws, by_link, ends = EYE, EYE[0] * 0, [], {}, []
        zero, one = mpf(0), mpf(1)
        for i, row in enumerate(self.rows):
            link = f"link{i + 1}"
            screws.append((rotation[:, 2], place))
            revolute = self.kinds[i] == "r"
            c, s = cos_sin(row.theta)
            ct, st_ = (mpmath.cos(theta[i]), mpmath.sin(theta[i])) if revolute else (one, zero)
            c, s = c * ct - s * st_, s * ct + c * st_
            rotation = rotation @ np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])
            along = mpf(row.d) / 1000 + (0 if revolute else theta[i]) + links.get((link, "d"), zero)
            by_link |= {(link, axis): (rotation[:, k], None) for k, axis in enumerate(("a", "b", "d"))}
            a = mpf(row.a) / 1000 + links.get((link, "a"), zero)
            place = place + rotation @ np.array([a, links.get((link, "b"), zero), along])
            for axis, k in (("theta", 2), ("alpha", 0), ("beta", 1)):
                by_link[link, axis] = (rotation[:, k], place)
                if (link, axis) in links:
                    rotation = rotation @ turn(k, links[link, axis])
            ca, sa = cos_sin(row.alpha)
            rotation = rotation @ np.array([[one, zero, zero], [zero, ca, -sa], [zero, sa, ca]])
            ends.append(place)
        return rotation, place, screws, by_link, ends

    def bending(self, q: Exact) -> dict[Any, Any]:
        """By how much each joint is moved by one of its bending: torques of the nominal arm, cos q, sin q."""
        rates: dict[Any, Any] = {}
        if self.gravity is not None:
            _, _, screws, _, ends = self.chain(q, {})
            up, masses = exact(self.gravity.up), exact(self.gravity.masses)
            for i in self.gravity.joints:
                axis, origin = screws[i]
                torque = -sum(masses[k] * (axis @ cross(ends[k] - origin, up)) for k in range(i, len(ends)))
                rates[f"joint{i + 1}", "gravity"] = torque / mpf(float(self.gravity.largest[i])) * 1000
        for i in range(len(q)):
            rates[f"joint{i + 1}", "cos"] = mpmath.cos(q[i])
            rates[f"joint{i + 1}", "sin"] = mpmath.sin(q[i])
        return rates


class Judge(Chain):
    """Residuals and Jacobians of one cell in fifty digits: by offsets, geometry, target, tool."""

    def __init__(self, arm: Cell, geometry: Any = NOMINAL) -> None:
        super().__init__(arm.rows, arm.kinds, geometry)
        tool = arm.own.tool
        self.arm, self.laser, self.open = arm, tool.kind == "laser", not arm.own.exact_tool
        self.point = exact(tool.point_mm) / 1000
        if self.laser:
            self.nominal = unit(exact(tool.direction))
            self.b1, self.b2 = beam_axes(self.nominal)

    def shot(self, values: Values, q: Exact) -> tuple[Exact, Exact]:
        """Residual (d) and Jacobian (d, n + g + 3 + k); base frame, across the beam."""
        n = len(self.arm.rows)
        links = dict(zip(self.names, values.arm[n:], strict=True))
        rates, theta = self.bending(q) if links else {}, q + values.arm[:n]
        for (of, axis), value in links.items():
            if of.startswith("joint"):
                theta[int(of[5:]) - 1] += value * rates[of, axis]
        rotation, place, screws, by_link, _ = self.chain(theta, links)

        def moved(axis: Exact, origin: Exact | None) -> Exact:
            return -axis if origin is None else -cross(axis, values.target - origin)

        by_joint = [
            moved(axis, origin if kind == "r" else None)
            for (axis, origin), kind in zip(screws, self.arm.kinds, strict=True)
        ]
        columns = [
            *by_joint,
            *(
                moved(*by_link[of, axis])
                if of.startswith("link")
                else by_joint[int(of[5:]) - 1] * rates[of, axis]
                for of, axis in self.names
            ),
            *EYE,
        ]
        if not self.laser:
            point = values.tool if self.open else self.point
            miss = values.target - place - rotation @ point
            if self.open:
                columns += [-rotation[:, i] for i in range(3)]
            across = EYE
        else:
            way, point, tilts = self.nominal, self.point, []
            if self.open:
                t1, t2, s1, s2 = values.tool
                way = way + mpmath.tan(t1) * self.b1 + mpmath.tan(t2) * self.b2
                point = point + s1 * self.b1 + s2 * self.b2
                tilts = [b / mpmath.cos(t) ** 2 for b, t in ((self.b1, t1), (self.b2, t2))]
            beam = unit(rotation @ way)
            miss = values.target - place - rotation @ point
            length = miss @ beam
            if self.open:
                columns += [-length * (rotation @ b) / norm(way) for b in tilts]
                columns += [-(rotation @ b) for b in (self.b1, self.b2)]
            first = unit(cross(beam, EYE[int(np.argmin(np.abs(beam)))]))
            across = np.array([first, cross(beam, first)])
        jacobian = across @ np.array(columns).T
        assert jacobian.shape[1] == len(values.arm) + 3 + len(values.tool)
        return across @ miss, jacobian

    def aimed(self, values: Values, q: Exact) -> Exact | None:
        """The Jacobian with the joint values turned onto the target by the joints that move: Newton's least
        steps. Joints that bend do so by a little of what they are turned, which takes more steps."""
        moving = np.flatnonzero(self.arm.moving)
        for _ in range(25 if self.names else 8):
            miss, jacobian = self.shot(values, q)
            if norm(miss) < _HIT:
                return jacobian
            by_joints = jacobian[:, moving]
            try:
                part = mpmath.lu_solve(mpmath.matrix(by_joints @ by_joints.T), mpmath.matrix(miss))
            except ZeroDivisionError:
                return None
            q = q.copy()
            q[moving] -= by_joints.T @ np.array(list(part))
        return None


def beam_axes(nominal: Exact) -> tuple[Exact, Exact]:
    """b1, b2 of the conventions across a nominal beam (3,) of length 1."""
    axis = int(np.argmax(np.abs(nominal.astype(float))))
    e1, e2 = EYE[(axis + 1) % 3], EYE[(axis + 2) % 3]
    b1 = unit(e1 - (e1 @ nominal) * nominal)
    b2 = e2 - (e2 @ nominal) * nominal
    return b1, unit(b2 - (b2 @ b1) * b1)


def turn(k: int, angle: mpf) -> Exact:
    """The rotation (3, 3) about the axis k."""
    rotation, a, b = EYE.copy(), (k + 1) % 3, (k + 2) % 3
    rotation[a, a] = rotation[b, b] = mpmath.cos(angle)
    rotation[b, a] = mpmath.sin(angle)
    rotation[a, b] = -rotation[b, a]
    return rotation


def on_unit_columns(matrix: Exact, zero: mpf = ZERO) -> Exact:
    """The same, a column that is zero left as it is."""
    length = np.array([norm(column) for column in matrix.T])
    nothing = length <= zero
    return np.where(nothing, mpf(0), matrix / np.where(nothing, mpf(1), length))


def null_space(matrix: Exact, rank: int | None = None, zero: mpf = ZERO) -> tuple[int, list[bool]]:
    """Dimension of the null space and which columns have a part in it: elimination with full pivoting, in
    which what is below `zero` is 0. With a `rank`, what is left after so many pivots counts as zero, and so
    does a part up to `UNRESOLVED`."""
    size, least = matrix.shape[1], zero if rank is None else mpf(UNRESOLVED)
    rows = on_unit_columns(matrix, zero)
    pivots: list[int] = []
    for done in range(min(*rows.shape, size if rank is None else rank)):
        left = [j for j in range(size) if j not in pivots]
        largest = np.abs(rows[done:, left])
        i, k = np.unravel_index(int(np.argmax(largest)), largest.shape)
        if largest[i, k] < zero:
            break
        j = left[k]
        rows[[done, done + i]] = rows[[done + i, done]]
        rows[done] = rows[done] / rows[done, j]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, j], rows[done])
        pivots.append(j)
    open_columns = [j for j in range(size) if j not in pivots]
    part = [j in open_columns for j in range(size)]
    for row, j in enumerate(pivots):
        # Column j takes part if one of the open columns moves it.
        part[j] = any(abs(rows[row, k]) > least for k in open_columns)
    return len(open_columns), part


def unresolved(problem: Problem, matrix: Exact) -> int:
    """How many directions the data say next to nothing of: at most a hundredth of what the prior says.

    Singular values on columns of unit length: up to 1e-8, as a column is about a million standard deviations
    of a miss long for one of the prior, or less where it is longer. It is no mistake to call such a direction
    unidentifiable, whether double precision sees it (from about 1e-11 on) or not. Entries of fifty digits,
    rounded to double precision, have singular values that are right to 1e-15.
    """
    metres = np.array([1.0 if item.unit == "deg" else 0.001 for item in problem.parameters.items])
    prior = (problem.parameters.prior_std * metres)[problem.parameters.free]
    longest = float((np.linalg.norm(matrix.astype(float), axis=0) * prior).max()) / (_SPOT_MM / 1000)
    singular = np.linalg.svd(on_unit_columns(matrix).astype(float), compute_uv=False)
    return matrix.shape[1] - int((singular > min(UNRESOLVED, 0.01 / longest)).sum())


def special(arm: Cell, problem: Problem) -> bool:
    """Whether some measurement, at nominal values, cannot be turned as the parameters change a little.

    The measurements that hit near by are then others, and tell less. Each comes to one of a few postures, as
    it happens: at some points near by they tell more than at others, and those that tell least count.
    """
    moving = np.flatnonzero(arm.moving)
    by_joints = [jacobian[:, moving].astype(float) for jacobian in _at_nominal(arm, problem)]
    return any(np.linalg.matrix_rank(own, rtol=1e-6) < len(own) for own in by_joints)


def values_near_by(problem: Problem, seed: int | None) -> Matrix:
    """Random values (p,) near by, nominal ones without a seed."""
    x = problem.nominal()
    if seed is None:
        return x
    size = np.where(problem.parameters.display == 1, _STEP, np.radians(0.1 * _STEP))
    if not problem.geometry:
        size[: problem.robot.n] *= np.where(problem.robot.display == 1, 0.2, 1.0)
    return x + np.where(problem.parameters.free, np.random.default_rng(seed).normal(size=len(size)) * size, 0)


def near_by(arm: Cell, problem: Problem, seed: int | None) -> Exact | None:
    """The Jacobian at random values near by (nominal ones without a seed), with the measurements turned onto
    the target there; None where they cannot be."""
    judge, x = Judge(arm, problem.geometry), values_near_by(problem, seed)
    near = aim(problem, x, arm.moving)
    if not near.hit.all():
        return None
    here = values_of(problem, x)
    stacked = [judge.aimed(here, joints_of(arm, joints)) for joints in near.problem.joints]
    return None if any(part is None for part in stacked) else np.vstack(stacked)


def at_nominal(arm: Cell, problem: Problem) -> Exact:
    """The Jacobian at the nominal values, where the measurements hit to double precision."""
    return np.vstack(_at_nominal(arm, problem))


def _at_nominal(arm: Cell, problem: Problem) -> list[Exact]:
    judge, here = Judge(arm, problem.geometry), values_of(problem, problem.nominal())
    return [judge.shot(here, joints_of(arm, joints))[1] for joints in problem.joints]


def spanned(matrix: Exact, others: Exact, zero: mpf) -> list[bool]:
    """Which of the columns `others` are combinations of those of the `matrix` that pivots above `zero` keep
    apart: elimination of its columns."""
    size = matrix.shape[1]

    def unit_columns(columns: Exact) -> Exact:
        lengths = [norm(column) for column in columns.T]
        return columns / np.array([own if own > ZERO else mpf(1) for own in lengths])

    rows = np.hstack([unit_columns(matrix), unit_columns(others)])
    used: list[int] = []
    for done in range(min(len(rows), size)):
        left = [j for j in range(size) if j not in used]
        largest = np.abs(rows[done:, left])
        i, k = np.unravel_index(int(np.argmax(largest)), largest.shape)
        if largest[i, k] < zero:
            break
        used.append(left[k])
        rows[[done, done + i]] = rows[[done + i, done]]
        below = np.arange(len(rows)) > done
        rows[below] -= np.outer(rows[below, left[k]] / rows[done, left[k]], rows[done])
    return [all(abs(value) < ZERO for value in column) for column in rows[len(used) :, size:].T]


def gauges_of(jacobian: Exact, problem: Problem) -> dict[mpf, tuple[int, list[bool]]]:
    """The dimension of the null space without what has a tolerance, and which free parameters are gauges.

    For two bounds of what is none: that of fifty digits, and that of double precision. With links that
    deviate, and joints that bend, a gauge of the nominal arm is often broken by some 1e-12.
    """
    parameters = problem.parameters
    known, free = parameters.tolerated, parameters.free
    plain, tolerated = jacobian[:, free & ~known], np.flatnonzero(known)
    answers = {}
    for zero in (ZERO, _RESOLVED):
        dimension, part = null_space(plain, zero=zero)
        result = np.zeros(len(parameters), dtype=bool)
        result[free & ~known] = part
        result[tolerated] = spanned(plain, jacobian[:, tolerated], zero)
        answers[zero] = (dimension, result[free].tolist())
    return answers


def faint_at(problem: Problem, x: Matrix) -> Matrix:
    """(f,) to what tolerance the data add too little at x to be stated: 1e-8 of its own information."""
    _, root, _ = information_root(problem, x, 1.0)
    length = np.maximum(np.linalg.norm(root, axis=0), 1e-300)
    std = np.linalg.norm(np.linalg.pinv(root / length, rcond=ROUNDING), axis=1) / length
    return problem.parameters.tolerated[problem.parameters.free] & (std > 1 - 0.5e-8)
