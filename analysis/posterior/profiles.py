"""Profiles of the posterior: how far one or two parameters may go while all others keep the fit.

At each value of the profiled parameters all others are at their best. This follows the ridge (Venzon &
Moolgavkar 1988), where the residuals are far from linear and the curvature at the mode is not to be trusted.
The priors of all parameters take part.

A distance from the mode is the root of twice the drop of the log-posterior, in standard uncertainties. With
an estimated noise scale it is the t by which Student's distribution drops as much, of as many degrees of
freedom as the standard uncertainty has, with the curvature k of the log-posterior at the mode:
k dof log(1 + t^2 / dof) is twice the drop. For a linear fit the distance is that by the curvature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from ...model.arrays import ByValue, Index, Mask, Matrix
from ...model.errors import BadInput
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..estimation.climb import Climb
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import LikelihoodFit, student_half_width
from ..solution import Solution, require_level
from ..status import Status, has_numbers, require_no_more_than

_ROUNDS = 25
_REACHED = 1e-3  # stds: the root of the drop is as wanted
_LONGEST = 3.0  # how many times a step may lengthen the way
_NEAR = 0.2  # stds: the curvature at the mode is taken so far from it
_WITHIN = 2.0  # stds: the deviation of a curve from the normal is looked for so far from the mode


class Ridge:
    """The mode of a fit and the way along its ridge, in the coordinates of the fit: W rows, of which each has
    some coordinates `fixed` (W, f) at the mode plus a multiple of `direction` (W, f)."""

    def __init__(self, fit: LikelihoodFit, fixed: Mask, direction: Matrix) -> None:
        self.fit, self.fixed, self.direction = fit, fixed, direction
        self._density = Density(fit.problem)
        coordinates = FlangeCoordinates(self._density)
        self.mode = coordinates.from_parameters(fit.x[None])[0]
        self.covariance = coordinates.covariance(fit.x[None], fit.covariance[None])[0]

    def climbed(self, near: Matrix, rows: Index, way: Matrix) -> tuple[Matrix, Matrix, Mask]:
        """From `near` (R, f), the `rows` (R,) at their `way` (R,): where all else is best, the root of twice
        the drop there, and whether the climb converged."""
        at = np.where(self.fixed[rows], self.mode + way[:, None] * self.direction[rows], near)
        climb = Climb(self._density, np.zeros(len(rows), dtype=int), len(rows), self.fixed[rows])
        minima = climb.up(at)
        root = np.sqrt(np.maximum(2 * (self.fit.log_posterior + minima.cost), 0.0))
        return minima.x, root, minima.converged

    def curvature(self, along: Matrix, rows: Index) -> Matrix:
        """(R,) twice the drop of the log-posterior near the mode over the square of the way, of some rows: 1
        of known noise, where a way of 1 is one standard uncertainty. `along` (R, f) is how all move with it.
        """
        if not self.fit.problem.noise.estimated:
            return np.ones(len(rows))
        drops = []
        for way in (-_NEAR, _NEAR):
            _, root, converged = self.climbed(self.mode + way * along, rows, np.full(len(rows), way))
            drops.append(np.where(converged, root**2, np.nan))
        return np.asarray(np.mean(drops, axis=0) / _NEAR**2)

    def farthest(self, way: Matrix, along: Matrix, width: Matrix | float) -> Matrix:
        """(W,) how many times `direction` each row may go until the root of twice the drop is `width`, or
        (W,); nan where that was not reached. `way` (W,) is the first guess, `along` (W, f) how all move with
        it."""
        near, way = self.mode + way[:, None] * along, way.copy()
        every = np.broadcast_to(width, way.shape)
        shorter, longer = np.zeros_like(way), np.full_like(way, np.inf)
        active, ends = np.arange(len(way)), np.full(len(way), np.nan)
        for _ in range(_ROUNDS):
            near[active], root, converged = self.climbed(near[active], active, way[active])
            width = every[active]
            reached = (np.abs(root - width) < _REACHED * width) & converged
            ends[active[reached]] = way[active[reached]]
            below = root < width
            shorter[active[below]] = way[active[below]]
            longer[active[~below]] = way[active[~below]]
            # The root of the drop is nearly linear in the way; where that leads outside the bracket, halve.
            step = np.clip(width / np.maximum(root, 1e-12), 1 / _LONGEST, _LONGEST)
            proposed = way[active] * step
            outside = (proposed <= shorter[active]) | (proposed >= longer[active])
            middle = np.where(
                np.isfinite(longer[active]), (shorter[active] + longer[active]) / 2, _LONGEST * way[active]
            )
            way[active] = np.where(outside, middle, proposed)
            active = active[~reached]
            if len(active) == 0:
                break
        return ends


def _distance(root: Matrix, curvature: Matrix | float, dof: float) -> Matrix:
    """From the mode, by the root of twice the drop."""
    drop = root**2 / curvature
    return np.asarray(np.sqrt(drop if math.isinf(dof) else dof * np.expm1(drop / dof)))


def root_of_drop(distance: Matrix | float, curvature: Matrix, dof: Matrix | float) -> Matrix:
    """(n,) the way back: the root of twice the drop at a distance, by the curvature at the mode."""
    squared, dof = np.square(distance), np.asarray(dof, dtype=float)
    with np.errstate(invalid="ignore"):
        drop = np.where(np.isinf(dof), squared, dof * np.log1p(squared / dof))
    return np.asarray(np.sqrt(curvature * drop))


def profile_intervals(
    problem: Problem,
    fit: LikelihoodFit,
    which: Index,
    half_width: Matrix | float,
    dof: Matrix | float = math.inf,
) -> Matrix:
    """(len(which), 2) lower and upper ends, in internal units, of parameters `which` (by their index).

    How far each may go while all others do their best to keep the fit (`profiles`).

    The ends are at the distance `half_width` (n,) from the mode, in standard uncertainties of `dof` (n,)
    degrees of freedom: where twice the drop of the log-posterior, all others at their best, is its square
    (1.96 for 95 %), of an estimated noise that of Student's. For a linear fit they are those by the
    curvature. NaN where no end was found. Offsets, tool and noise only: a target's coordinate is no
    coordinate of the fit. Raises ValueError for another.
    """
    parameters = problem.parameters
    if (parameters.group("target") | ~parameters.free)[which].any():
        raise ValueError("profiles are of free offsets, tool and noise parameters")
    column = np.repeat(parameters.among_free[which], 2)
    sign = np.tile([-1.0, 1.0], len(which))
    fixed = np.arange(len(fit.z)) == column[:, None]
    ridge = Ridge(fit, fixed, np.zeros(fixed.shape))
    step = sign * np.sqrt(ridge.covariance[column, column])
    ridge.direction[:] = fixed * step[:, None]
    # How all move with the one, by the curvature.
    along = (ridge.covariance[:, column] / step).T
    half = np.repeat(np.broadcast_to(half_width, which.shape), 2)
    width = root_of_drop(
        half, ridge.curvature(along, np.arange(len(column))), np.repeat(np.broadcast_to(dof, which.shape), 2)
    )
    ends = ridge.mode[column] + step * ridge.farthest(half, along, width)
    prior = np.repeat(which, 2)
    return np.asarray((ends * parameters.prior_std[prior] + parameters.prior_mean[prior]).reshape(-1, 2))


def profile_ends(solution: Solution, which: Index) -> Matrix:
    """(len(which), 2) the 95 % intervals of a solution's parameters `which`, as of `profile_intervals`; NaN
    where there is none. With noise factors the fit is at their marginal mode: no profile starts from it."""
    if solution.problem.noise.separate:
        return np.full((len(which), 2), np.nan)
    halves, dof = solution.quantiles[which], solution.effective_dof[which]
    return profile_intervals(solution.problem, solution.fit, which, halves, dof)


@dataclass(frozen=True, eq=False)
class ProfileCurve(ByValue):
    """The profile of one parameter (`face.profiles.Profile` says what each array is); `dof` are the degrees
    of freedom of the distance, infinite of known noise. UnsoundResult where the data do not determine it."""

    name: str
    unit: str
    status: Status
    estimate: float
    u: float
    values: Matrix
    distance: Matrix
    normal: Matrix
    dof: float

    def __post_init__(self) -> None:
        require_no_more_than(self.name, self.status, profile=self.distance)

    @classmethod
    def of(cls, solution: Solution, name: str, *, size: int = 31, width: float = 3.0) -> Self:
        """From `width` standard uncertainties below the mode to as many above it, at `size` values.

        Raises BadInput where there is no profile of the parameter.
        """
        i = profiled(solution, name)
        row, item = solution.parameters[i], solution.problem.parameters.items[i]
        assert row.estimate is not None
        assert row.std is not None
        offsets = np.linspace(-width, width, size)
        fit, column = solution.fit, solution.problem.parameters.among_free[i]
        fixed = np.zeros((size, len(fit.z)), dtype=bool)
        fixed[:, column] = True
        ridge = Ridge(fit, fixed, np.zeros(fixed.shape))
        std = np.sqrt(ridge.covariance[column, column])
        ridge.direction[:, column] = std
        along = ridge.covariance[column] / std
        _, root, converged = ridge.climbed(ridge.mode + np.outer(offsets, along), np.arange(size), offsets)
        (curvature,) = ridge.curvature(along[None], np.zeros(1, dtype=int))
        distance = np.where(converged, np.sign(offsets) * _distance(root, curvature, row.dof), np.nan)
        values = item.display * (item.prior_mean + item.prior_std * (ridge.mode[column] + offsets * std))
        return cls(row.name, row.unit, row.status, row.estimate, row.std, values, distance, offsets, row.dof)

    @property
    def deviation(self) -> float:
        """The largest difference from the normal within two standard uncertainties of the mode, in standard
        uncertainties; infinite where the profile has a gap there."""
        within = np.abs(self.normal) <= _WITHIN
        off = np.abs(self.distance - self.normal)[within]
        return float(off.max()) if np.isfinite(off).all() else math.inf

    def interval(self, level: float = 0.95) -> tuple[float, float] | None:
        """The interval that holds `level` of the probability, by the profile; None where it does not reach so
        far. BadInput unless 0 < level < 1."""
        require_level(level)
        half = float(student_half_width(np.array(self.dof), level))
        low, high = self._value_at(-half), self._value_at(half)
        return None if low is None or high is None else (low, high)

    def _value_at(self, distance: float) -> float | None:
        """The value at this distance from the mode, between the two values next to it."""
        side = np.sign(self.normal) * np.sign(distance) >= 0
        order = np.argsort(np.abs(self.normal[side]))
        values, distances = self.values[side][order], np.abs(self.distance[side][order])
        beyond = np.flatnonzero(~(distances < abs(distance)))
        if len(beyond) == 0 or beyond[0] == 0 or not np.isfinite(distances[beyond[0]]):
            return None
        last = slice(beyond[0] - 1, beyond[0] + 1)
        return float(np.interp(abs(distance), distances[last], values[last]))


@dataclass(frozen=True, eq=False)
class ProfileContour(ByValue):
    """The profile of two parameters: the region that holds `level` of their joint probability
    (`face.profiles.Contour` says what each array is). `deviation` is infinite where there is a gap.
    UnsoundResult where the data do not determine both."""

    names: tuple[str, str]
    units: tuple[str, str]
    status: tuple[Status, Status]
    estimates: tuple[float, float]
    level: float
    points: Matrix
    ellipse: Matrix
    deviation: float

    def __post_init__(self) -> None:
        for name, status in zip(self.names, self.status, strict=True):
            require_no_more_than(name, status, profile=self.points)

    @classmethod
    def of(cls, solution: Solution, first: str, second: str, *, level: float = 0.95, size: int = 36) -> Self:
        """In `size` directions from the mode. Raises BadInput where there is no profile of a parameter, or
        both are the same."""
        require_level(level)
        pair = [profiled(solution, first), profiled(solution, second)]
        if pair[0] == pair[1]:
            raise BadInput("a contour is of two parameters", found=f"{first} twice", argument="second")
        rows = [solution.parameters[i] for i in pair]
        items = [solution.problem.parameters.items[i] for i in pair]
        both = solution.problem.parameters.among_free[pair]
        angles = np.linspace(0.0, 2 * np.pi, size + 1)[:-1]
        fit = solution.fit
        fixed = np.zeros((size, len(fit.z)), dtype=bool)
        fixed[:, both] = True
        ridge = Ridge(fit, fixed, np.zeros(fixed.shape))
        block = ridge.covariance[np.ix_(both, both)]
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ np.linalg.cholesky(block).T
        ridge.direction[:, both] = unit
        along = unit @ np.linalg.solve(block, ridge.covariance[both])
        dof = min(row.dof for row in rows)
        radius = _radius(level, dof)
        width = root_of_drop(radius, ridge.curvature(along, np.arange(size)), dof)
        way = ridge.farthest(np.full(size, radius), along, width)
        prior = np.array([[item.prior_mean * item.display, item.prior_std * item.display] for item in items])

        def shown(ways: Matrix) -> Matrix:
            boundary = prior[:, 0] + prior[:, 1] * (ridge.mode[both] + ways[:, None] * unit)
            return np.vstack([boundary, boundary[:1]])

        off = np.abs(way - radius)
        return cls(
            (rows[0].name, rows[1].name),
            (rows[0].unit, rows[1].unit),
            (rows[0].status, rows[1].status),
            (float(rows[0].estimate or 0.0), float(rows[1].estimate or 0.0)),
            level,
            shown(way),
            shown(np.full(size, radius)),
            float(off.max()) if np.isfinite(off).all() else math.inf,
        )


def _radius(level: float, dof: float) -> float:
    """How far from the mode of a linear fit the region of two parameters reaches, in standard uncertainties:
    the root of the quantile of chi-squared, or of twice that of F of finite degrees of freedom."""
    if math.isinf(dof):
        return math.sqrt(-2 * math.log(1 - level))
    return math.sqrt(2 * float(scipy.special.fdtri(2, dof, level)))


def profiled(solution: Solution, name: str) -> int:
    """Where among the parameters the one of this name is; BadInput where it has no profile."""
    row = solution.parameters.named(name)
    i = solution.problem.parameters.index(row.name)
    because = None
    if not solution.converged:
        because = "the fit did not converge"
    elif row.held:
        because = "the parameter is held, and not estimated"
    elif not has_numbers(row.status):
        because = "the data do not determine the parameter"
    elif row.group == "target":
        because = "a target's coordinate is no coordinate of the fit"
    elif solution.problem.noise.separate:
        because = "with separate noise factors there is no profile that starts from the fit"
    if because is not None:
        raise BadInput(
            f"there is no profile of {row.name}",
            found=f"{because} (status {row.status})",
            allowed="offsets, geometry and tool that the data determine",
        )
    return i
