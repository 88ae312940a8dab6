"""The accuracy of the TCP over the region of the header: before the calibration, and after it.

The TCP T(q) is a point of the flange, in the base frame **that joint 1's own encoder defines**: the
offset of joint 1 never enters it, so neither does the gauge of section 3.3, be delta1 held or free.

- *Before*: the error of the arm with nothing entered, |N(q; 0) - T(q; theta)| at the estimate of the whole
  arm (offsets, links, gravity, harmonics), with the std of it, and the radius that holds 95 % of it.
- *After*: with the values entered that `enter` computes for a controller with nominal geometry. What these
  leave at the estimate, T(q; theta) - N(q; c), is systematic; T is wrong by J times the error of the
  estimate, J exact, so that its covariance is J C J' (JCGM 102). Given are the radius that holds 95 % and the
  expected error, rms.

The place is the tool's stated point, as a point of the flange: the free tool parameters are not in it. Where
the last offset is not determined (held with a free laser, or unidentifiable with a free tip) a point off the
last axis would be anywhere on its circle. Then the place is the nearest point of that axis, which that offset
does not move.

If T depends on any other offset that the data do not determine (unidentifiable, or held), no accuracy is
claimed: there is no number, but the reason. (An offset moves a place of the flange nowhere or nearly
everywhere.) The arm's repeatability and its load are not in the numbers, nor is how well the TCP is known.

Here is the radius of the ball that holds 95 % of an error in three dimensions, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Annotated, Literal, Self

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebpts1, chebvander
from numpy.polynomial.legendre import leggauss

from ...model.arrays import NORMAL_95, Index, Matrix
from ...model.errors import UnsoundResult
from ...model.kinematics.pendant import spread_postures, within_limits
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record, worded
from ..observability.causes import Cause
from ..solution import Solution
from ..tcp_region import (
    TcpSource,
    arm_covariance,
    beside_first_axis,
    default_point,
    moving_by_nominal,
    moving_offsets,
    region_postures,
    tool_point,
    undetermined_offsets,
)
from .values_to_enter import controller_arm, values_to_enter

COVERAGE = 0.95
_NODES = 12  # of each ratio of stds
_LENGTHS = 80  # at which the law of a pooled length is worked out
_ONE_SIDED = 1.6448536269514722  # 95 % of a normal


def radius95(covariance: Matrix, dof: int | None = None) -> Matrix:
    """(P,) the radius of the ball that holds 95 % of a normal error of covariance (P, 3, 3), or of Student's
    t with `dof` and that matrix for a scale.

    In units of the largest principal std it depends on the ratios of the three alone, and smoothly: it is
    worked out at the Chebyshev points of two ratios, and interpolated: in a hundredth of the time of the
    integral for each. Good to 1e-4 of itself.
    """
    third, second, first = np.sqrt(np.maximum(_eigenvalues(covariance), 0.0))
    by_second = chebvander(2 * second / np.where(first > 0, first, 1.0) - 1, _NODES - 1)
    by_third = chebvander(2 * third / np.where(second > 0, second, 1.0) - 1, _NODES - 1)
    return np.asarray(first * (by_second @ _coefficients(dof) * by_third).sum(axis=1))


@dataclass(frozen=True, eq=False)
class LengthLaw:
    """The lengths of P normal errors in three dimensions with a mean, about, to 3 %.

    The square of a length is a weighted sum of noncentral chi-squared: a central one, shifted and scaled,
    with the same three moments (Pearson 1959): its mean is `first` (P,), its variance 2 `second`, `freedom`
    its degrees of freedom; by Wilson and Hilferty's cube."""

    first: Matrix
    second: Matrix
    freedom: Matrix

    @classmethod
    def about(cls, mean: Matrix, covariance: Matrix, dof: int | None = None) -> Self:
        """Of errors with the mean (P, 3) and covariance (P, 3, 3), or of Student's t with `dof`."""
        if dof is not None:
            covariance = covariance * (scipy.special.stdtrit(dof, 0.975) / NORMAL_95) ** 2
        once = np.einsum("pij,pj->pi", covariance, mean)
        twice = covariance @ covariance
        first = np.trace(covariance, axis1=1, axis2=2) + (mean**2).sum(axis=1)
        second = np.trace(twice, axis1=1, axis2=2) + 2 * (mean * once).sum(axis=1)
        third = np.einsum("pij,pji->p", twice, covariance) + 3 * (once**2).sum(axis=1)
        return cls(
            first, second, np.divide(second**3, third**2, out=np.full(len(first), np.inf), where=third > 0)
        )

    def of(self, rows: slice) -> LengthLaw:
        return LengthLaw(self.first[rows], self.second[rows], self.freedom[rows])

    def quantile(self) -> Matrix:
        """(P,) the radius of the ball that holds 95 %."""
        share = 2 / (9 * self.freedom)
        quantile = (1 - share + _ONE_SIDED * np.sqrt(share)) ** 3 - 1  # over its degrees of freedom, less 1
        at_infinity = np.where(
            np.isinf(self.freedom), 0.0, quantile * np.sqrt(np.minimum(self.freedom, 1e300))
        )
        return np.asarray(np.sqrt(self.first + np.sqrt(self.second) * at_infinity))

    def pooled_quantile(self, groups: Index) -> Matrix:
        """(G,) the length that 95 % of the errors of each group together stay below, `groups` (P,) from 0;
        nan of a group without any."""
        logs, inside = self._table
        count = np.bincount(groups)
        pooled = np.array([np.bincount(groups, row) for row in inside]) / np.maximum(count, 1)
        after = (pooled < COVERAGE).sum(axis=0).clip(1, _LENGTHS - 1)
        group = np.arange(len(count))
        low, high = pooled[after - 1, group], pooled[after, group]
        share = np.clip((COVERAGE - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        lengths = np.exp(logs[after - 1] + share * (logs[after] - logs[after - 1]))
        return np.where(count > 0, lengths, np.nan)

    @cached_property
    def _table(self) -> tuple[Matrix, Matrix]:
        """(L,) logarithms of lengths, and (L, P) the probability that each error is shorter."""
        radius = self.quantile()
        high = max(float(radius.max()), 1e-9) * (1 + 1e-9)
        logs = np.linspace(np.log(max(float(radius.min()) / 8, high * 1e-4)), np.log(high), _LENGTHS)
        squares = np.exp(2 * logs)[:, None]
        share = np.maximum(2 / (9 * self.freedom), 1e-12)
        scale = np.sqrt(np.maximum(self.second * np.minimum(self.freedom, 1e300), 1e-300))
        normal = (np.cbrt(1 + (squares - self.first) / scale) - 1 + share) / np.sqrt(share)
        return logs, np.where(np.isinf(self.freedom), squares >= self.first, scipy.special.ndtr(normal))


def _eigenvalues(matrix: Matrix) -> Matrix:
    """(3, P) of symmetric matrices (P, 3, 3), the least first, by the cosines of Cardano's formula (Smith
    1961): a fifth of the time of LAPACK, for thousands of them at once. Good to 1e-8 of the largest."""
    mean = np.trace(matrix, axis1=1, axis2=2) / 3
    a, b, c = (matrix[:, i, i] - mean for i in range(3))
    d, e, f = matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2]
    size = np.sqrt((a**2 + b**2 + c**2 + 2 * (d**2 + e**2 + f**2)) / 6)
    scale = np.where(size > 0, size, 1.0)
    a, b, c, d, e, f = (entry / scale for entry in (a, b, c, d, e, f))
    half = (a * (b * c - f**2) - d * (d * c - f * e) + e * (d * f - b * e)) / 2  # of the determinant
    angle = np.arccos(np.clip(half, -1.0, 1.0)) / 3
    most, least = 2 * np.cos(angle), 2 * np.cos(angle + 2 * np.pi / 3)
    middle = -most - least
    # Of two that are equal rounding may make the wrong one the less.
    in_order = (np.minimum(least, middle), np.maximum(least, middle), most)
    return np.stack([mean + size * root for root in in_order])


@lru_cache(maxsize=64)
def _coefficients(dof: int | None) -> Matrix:
    """(k, k) of the Chebyshev polynomials of the two ratios."""
    points = chebpts1(_NODES)
    ratio = (points + 1) / 2
    exact = _radius(np.repeat(ratio, _NODES), np.outer(ratio, ratio).reshape(-1), dof)
    from_values = np.linalg.inv(chebvander(points, _NODES - 1))
    return np.asarray(from_values @ exact.reshape(_NODES, _NODES) @ from_values.T)


def _radius(second: Matrix, third: Matrix, dof: int | None) -> Matrix:
    """(P,) the same for principal stds of 1, `second` and `third` (P,).

    An error is C^(1/2) u times a length s: u even over the sphere, s^2 chi-squared of 3 (of Student's t:
    s^2 / 3 is F of 3 and dof). So P(|e| < R) is the mean over u of P(s < R / w), w^2 = u' C u: over Gauss
    points in one octant. The root is found by Newton's method on the logarithm of what is outside.
    """
    z, weight = leggauss(24)
    z, weight = np.repeat((z + 1) / 2, 8), np.repeat(weight / 16, 8)
    # Midpoints: over the period of an angle they are as good as Gauss's.
    angle = np.tile((np.arange(8) + 0.5) * np.pi / 16, 24)
    across = [second[:, None] * np.cos(angle), third[:, None] * np.sin(angle)]
    w = np.sqrt(z**2 + (1 - z**2) * (across[0] ** 2 + across[1] ** 2))
    radius = np.full(len(w), 1.96)  # of a normal error along a line: all others need more
    for _ in range(60):
        inside, density = _length_law(radius[:, None] / w, dof)
        outside = np.maximum(1 - inside @ weight, 1e-12)
        step = outside / ((density / w) @ weight) * np.log(outside / (1 - COVERAGE))
        radius = radius + step
        if np.abs(step).max() < 1e-7:
            break
    return radius


def _length_law(s: Matrix, dof: int | None) -> tuple[Matrix, Matrix]:
    """Of the length s, in stds, of an error in three dimensions: distribution function and density."""
    if dof is None:
        density = np.sqrt(2 / np.pi) * np.exp(-(s**2) / 2)
        return scipy.special.erf(s / np.sqrt(2)) - s * density, s**2 * density
    scale = 2 * np.exp(-scipy.special.betaln(1.5, dof / 2)) / dof**1.5
    return scipy.special.fdtr(3, dof, s**2 / 3), scale * s**2 * (1 + s**2 / dof) ** (-(dof + 3) / 2)


Grid = tuple[tuple[float | None, ...], ...]
Counts = tuple[tuple[int, ...], ...]

_POSTURES = 4096  # of the region; of those within the shots' ranges a quarter
_CELLS = 20  # along the longer side of a map, at most


@dataclass(frozen=True)
class Level:
    """Over some postures, mm: the median (the lower of the two in the middle) and the worst."""

    median: float
    worst: float


@dataclass(frozen=True)
class RegionAccuracy:
    """Accuracy over so many `postures`.

    `before_mm` is the error without offsets, `before_std_mm` its std at those very two postures (the largest
    of several with that error), `before95_mm` the radius that holds it with 95 %; after the
    calibration, `after95_mm` is the radius that holds the error with 95 %, `after_rms_mm` the expected error.
    """

    postures: int
    before_mm: Level
    before_std_mm: Level
    after95_mm: Level
    after_rms_mm: Level
    before95_mm: Level | None = None  # earlier versions have none


@dataclass(frozen=True)
class LevelMap:
    """`Level` in every cell, rows from below; None where no posture falls."""

    median: Grid
    worst: Grid


@dataclass(frozen=True)
class Map:
    """The region in square cells of `cell_mm`, rows from below, the lowest corner at `corner_mm`.

    `vertical`: distance from axis 1 against height along it (of a prismatic joint 1: the base's z axis).
    `horizontal`: x against y of the base frame. `axes` names both, the one across first. `postures` and
    `shots` count those whose TCP is there. `before_p95_mm` and `after_p95_mm` are `TcpError.p95_mm` of the
    postures of a cell, with nothing and with the values entered.
    """

    plane: Literal["vertical", "horizontal"]
    axes: tuple[str, str]
    cell_mm: float
    corner_mm: tuple[float, float]
    postures: Counts
    shots: Counts
    before_mm: LevelMap
    after95_mm: LevelMap
    before95_mm: LevelMap | None = None  # earlier versions have none
    before_p95_mm: Grid | None = None
    after_p95_mm: Grid | None = None


@record
class TcpAccuracy:
    """The TCP's accuracy over the region; outside the ranges near the shots all is extrapolation. What it
    would depend on beside what is determined is in `undetermined`."""

    point_mm: Annotated[tuple[float, float, float], it("the TCP in the flange frame, millimetres")]
    source: Annotated[TcpSource, internal]
    workspace: Annotated[
        RegionAccuracy | None,
        it(
            "over the region (`region`): `postures`, and each as `median` and `worst` `before_mm` "
            "(error with nothing entered), `before_std_mm` (its u at those two postures), `before95_mm` "
            "(radius that contains it with 95 % probability), `after95_mm` (the same once the values of "
            "`enter` are entered), `after_rms_mm` (expected error); null where no accuracy is claimed"
        ),
    ]
    near_shots: Annotated[
        RegionAccuracy | None, it("the same over the ranges that the joints of the measurements span")
    ]
    maps: Annotated[
        tuple[Map, ...],
        it(
            "two of the region, none where no accuracy is claimed: `plane` (`vertical`, "
            "`horizontal`), `axes`, `cell_mm`, `corner_mm` (lowest corner), and grids, rows from "
            "below: `postures` and `shots` (counts), `before_mm`, `before95_mm` and `after95_mm` (each "
            "`median` and `worst`), `before_p95_mm` and `after_p95_mm` (the error that 95 % of posture and "
            "posterior together stay below); null where no posture falls"
        ),
    ]
    undetermined: Annotated[
        tuple[str, ...],
        it("offsets that the TCP depends on and that are unidentifiable or held; empty otherwise"),
    ]
    weak: Annotated[tuple[str, ...], it("offsets that enter with a large u")]
    held: Annotated[tuple[bool, ...], internal]
    causes: Annotated[tuple[Cause | None, ...], internal]
    joints: Annotated[int, internal]
    converged: Annotated[bool, internal]
    sensitivity_mm2: Annotated[
        Grid | None,
        it(
            "a matrix S, a row and a column for each joint: errors d of the offsets (in their units) "
            "move the stated TCP by √(d′ S d) mm, root mean square over the region; null where no "
            "accuracy is claimed"
        ),
    ] = None
    place: Annotated[str | None, worded("its description")] = field(default=None, kw_only=True)
    reason: Annotated[str | None, worded("why there is no number, else null")] = field(
        default=None, kw_only=True
    )

    def __post_init__(self) -> None:
        claimed = self.workspace is not None or self.near_shots is not None or bool(self.maps)
        if claimed and (self.undetermined or self.converged is False):
            raise UnsoundResult("accuracy is claimed although it depends on what the data do not determine")


def accuracy(
    solution: Solution, point: Matrix | None = None, values: Mapping[str, float] | None = None
) -> TcpAccuracy:
    """The accuracy of `point` (3,) mm in the flange frame, by default the tool's stated one, as above;
    `values` are those of `values_to_enter` if they are there already."""
    problem, fit = solution.problem, solution.fit
    parameters, offsets = problem.parameters, problem.parameters.block("offset")
    status = solution.status[offsets]
    open_offsets = undetermined_offsets(problem, solution.status)
    location: TcpSource = "stated point"
    if point is None:
        point, location = default_point(problem, solution.status)
    recorded_limits = (problem.joints.min(axis=0), problem.joints.max(axis=0))
    region = region_postures(problem, _POSTURES)
    near_these = within_limits(problem.robot, spread_postures(*recorded_limits, _POSTURES // 4))
    joints = np.concatenate([region, near_these, problem.joints])
    position, jacobian = tool_point(problem, fit.x, point, joints)
    names = parameters.names[offsets]
    enters = moving_offsets(problem, jacobian)
    undetermined = np.flatnonzero(moving_by_nominal(problem, point, joints) & open_offsets)
    workspace, near_shots, sensitivity = None, None, None
    maps: tuple[Map, ...] = ()
    weak: tuple[str, ...] = ()
    if not len(undetermined):
        values = values_to_enter(solution) if values is None else values
        levels, *laws = _errors(solution, point, joints, position, jacobian, values)
        whole, near = slice(len(region)), slice(len(region), len(joints) - problem.shots)
        workspace, near_shots = _region(levels[:, whole]), _region(levels[:, near])
        laws = [law.of(whole) for law in laws]
        maps = _maps(problem, position[whole], position[near.stop :], levels[:, whole], laws)
        # Of the stated TCP, which an offset that is not determined may move.
        at_tool = jacobian[whole]
        if location == "last axis":
            at_tool = tool_point(problem, fit.x, problem.tool.point, region)[1]
        shown = at_tool.transpose(1, 2, 0)[:, offsets] / parameters.display[offsets][:, None]
        sensitivity = tuple(
            map(tuple, ((shown @ shown.transpose(0, 2, 1)).sum(axis=0) / len(region)).tolist())
        )
        weak = tuple(names[i] for i in np.flatnonzero(enters & np.equal(status, "weak")))
    return TcpAccuracy(
        point_mm=(float(point[0]), float(point[1]), float(point[2])),
        source=location,
        workspace=workspace,
        near_shots=near_shots,
        maps=maps,
        undetermined=tuple(names[i] for i in undetermined),
        weak=weak,
        held=tuple(solution.parameters[i].held for i in undetermined),
        causes=tuple(solution.parameters[i].cause for i in undetermined),
        joints=problem.robot.n,
        converged=solution.converged,
        sensitivity_mm2=sensitivity,
    )


def _errors(
    solution: Solution,
    point: Matrix,
    joints: Matrix,
    position: Matrix,
    jacobian: Matrix,
    values: Mapping[str, float],
) -> tuple[Matrix, LengthLaw, LengthLaw]:
    """Of P postures (5, P) mm: the error before the calibration, the std of that, the 95 % radius after it,
    the rms, and the 95 % radius before it (see `RegionAccuracy`); the laws of the errors before and after."""
    problem, fit = solution.problem, solution.fit
    dof = max(solution.dof, 1) if problem.noise.estimated else None
    position_of = problem.functions.kernel("place")
    (nominal,) = position_of(joints, np.zeros(problem.parameters.arm.stop), point)
    of_point = _transferred(arm_covariance(problem, fit.covariance), jacobian)
    apart = np.asfortranarray(nominal) - position
    length = np.linalg.norm(apart, axis=1)
    along = sum(apart[:, i] * apart[:, j] * of_point[:, i, j] for i in range(3) for j in range(3))
    rms = np.sqrt(np.trace(of_point, axis1=1, axis2=2))
    # Of no length at all every direction is as good: the std of the worst is at most the rms.
    std = np.where(length > 0, np.sqrt(along) / np.where(length > 0, length, 1.0), rms)
    before = LengthLaw.about(apart, of_point, dof)
    before95 = before.quantile()
    if not problem.geometry:
        after = LengthLaw.about(np.zeros_like(apart), of_point, dof)
        return np.array([length, std, radius95(of_point, dof), rms, before95]), before, after
    arm = controller_arm(problem, values)
    arm[0] = 0.0
    (entered_at,) = position_of(joints, arm, point)
    left = np.asfortranarray(position - entered_at)
    rms = np.sqrt(rms**2 + (left**2).sum(axis=1))
    after = LengthLaw.about(left, of_point, dof)
    return np.array([length, std, after.quantile(), rms, before95]), before, after


def place_uncertainty(solution: Solution, applied: Collection[str], joints: Matrix, points: Matrix) -> Matrix:
    """(P,) mm, U (k = 2) of the places of `points` (P, 3) mm of the flange at recorded `joints` (P, n), rad
    or mm, once the offsets `applied`, by name, and the links are made up for: twice the root of the variances
    of all three coordinates, J C J' (JCGM 102), in the base frame that joint 1's encoder defines.

    NaN where an offset that moves the place is not determined by the data, or not among those applied.
    """
    problem = solution.problem
    block = problem.parameters.block("offset")
    _, jacobian = tool_point(problem, solution.fit.x, points, joints)
    of_place = _transferred(arm_covariance(problem, solution.fit.covariance), jacobian)
    uncorrected = undetermined_offsets(problem, solution.status)
    uncorrected[1:] |= ~np.isin(problem.parameters.names[block][1:], list(applied))
    nominal = tool_point(problem, problem.parameters.prior_mean, points, joints)[1]
    moving = [moving_offsets(problem, nominal[i : i + 1]) for i in range(len(joints))]
    known = ~(np.array(moving) & uncorrected).any(axis=1)
    return np.where(known, 2 * np.sqrt(np.trace(of_place, axis1=1, axis2=2)), np.nan)


def _transferred(covariance: Matrix, jacobian: Matrix) -> Matrix:
    """(P, 3, 3): J C J' of C (a, a) for each J of (P, 3, a)."""
    by_arm = jacobian.transpose(1, 2, 0)
    spread = covariance @ by_arm
    result = np.empty((3, 3, len(jacobian)))
    for i in range(3):
        for j in range(i + 1):
            result[i, j] = result[j, i] = (spread[i] * by_arm[j]).sum(axis=0)
    return result.transpose(2, 0, 1)


def _region(errors: Matrix) -> RegionAccuracy:
    before, before_std, after95, after_rms, before95 = errors
    count = len(before)
    middle = (count - 1) // 2

    def level(value: Matrix) -> Level:
        return Level(float(np.partition(value, middle)[middle]), float(value.max()))

    def std_where(error: float) -> float:
        return float(before_std[before == error].max())

    before_mm = level(before)
    return RegionAccuracy(
        postures=count,
        before_mm=before_mm,
        before_std_mm=Level(std_where(before_mm.median), std_where(before_mm.worst)),
        after95_mm=level(after95),
        after_rms_mm=level(after_rms),
        before95_mm=level(before95),
    )


def _maps(
    problem: Problem, position: Matrix, shots: Matrix, levels: Matrix, laws: Sequence[LengthLaw]
) -> tuple[Map, Map]:
    first = problem.robot.joints[0]
    name = "axis 1" if first.kind == "revolute" else "the base's z axis"
    across = (f"distance from {name}", "height")
    at, of_shots = (beside_first_axis(problem.robot, points) for points in (position, shots))
    return (
        _map("vertical", across, at, of_shots, levels, laws),
        _map("horizontal", ("x", "y"), position[:, :2], shots[:, :2], levels, laws),
    )


def _map(
    plane: Literal["vertical", "horizontal"],
    axes: tuple[str, str],
    at: Matrix,
    shots: Matrix,
    errors: Matrix,
    laws: Sequence[LengthLaw],
) -> Map:
    """Cells of a round size over all that is there, `at` (P, 2) and `shots` (N, 2) mm."""
    every = np.concatenate([at, shots])
    size = _round_up(float(np.ptp(every, axis=0).max()) / (_CELLS - 1))
    corner = np.floor(every.min(axis=0) / size)
    columns, rows = (np.floor(every.max(axis=0) / size) - corner).astype(int) + 1

    def cells(points: Matrix) -> Index:
        column, row = (np.floor(points / size) - corner).astype(np.int64).T
        return np.asarray(row * columns + column)

    def counted(points: Matrix) -> Counts:
        counts = np.bincount(cells(points), minlength=rows * columns).reshape(rows, columns)
        return tuple(tuple(row) for row in counts.tolist())

    where = cells(at).astype(np.uint16)  # that is sorted by counting
    count = np.bincount(where, minlength=rows * columns)
    filled = np.flatnonzero(count)
    end, count = np.cumsum(count)[filled], count[filled]

    def grid(of_filled: Matrix) -> Grid:
        numbers = np.full(rows * columns, None, dtype=object)
        numbers[filled] = of_filled
        return tuple(map(tuple, numbers.reshape(rows, columns).tolist()))

    def levels(values: Matrix) -> LevelMap:
        order = np.argsort(values)
        value = values[order][np.argsort(where[order], kind="stable")]
        return LevelMap(grid(value[end - 1 - count // 2]), grid(value[end - 1]))

    def p95(law: LengthLaw) -> Grid:
        return grid(law.pooled_quantile(where.astype(np.int64))[filled])

    return Map(
        plane=plane,
        axes=axes,
        cell_mm=size,
        corner_mm=(float(corner[0] * size), float(corner[1] * size)),
        postures=counted(at),
        shots=counted(shots),
        before_mm=levels(errors[0]),
        after95_mm=levels(errors[2]),
        before95_mm=levels(errors[4]),
        before_p95_mm=p95(laws[0]),
        after_p95_mm=p95(laws[1]),
    )


def _round_up(length: float) -> float:
    """The next round number; 1 mm for an arm that does not move its point at all."""
    power = 10.0 ** np.floor(np.log10(max(length, 1e-3)))
    return max(1.0, float(next(k * power for k in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if k * power >= length)))
