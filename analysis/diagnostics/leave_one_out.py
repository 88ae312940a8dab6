"""Each placement left out in turn: how well the others predict it, and how much the offsets depend on it.

Both come from the same fits: one for each placement, of all measurements but its own, from the mode of the
whole. What they see is what differs between placements, whether it is noise or a model that is not the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..estimation.fit import modes, unbiased_weight
from ..observability.gauges import information_root
from ..placements import Placement, placements
from ..solution import Solution
from ..status import known
from .hold_out import HoldOut, judged, not_fitted

_FEWEST = 3  # placements of a jackknife
_STEPS = 12
_SETTLED = (
    0.02  # size of the gradient, in posterior stds: what is left is along gauges, where only priors pull
)
_ROUNDING = 1e-11  # singular values below this share are rounding


@dataclass(frozen=True)
class LeaveOneOut:
    """Each placement as the others predict it.

    `rows` are hold-outs of one placement each, in their order. `rms_mm` of all residuals at placements that
    the fit had not seen, and `expected_mm` what it would be by noise and fits: None where a fit without a
    placement did not converge.
    """

    rows: tuple[HoldOut, ...]
    rms_mm: float | None
    expected_mm: float | None


@dataclass(frozen=True)
class JackknifeOffset:
    """An offset by the fits without one placement, in the `unit` that people read.

    `estimates` without each placement, None where the remaining data do not determine it: the placements in
    `needs`. `u` is the jackknife's standard uncertainty: None where one of the estimates is missing.
    """

    name: str
    unit: str
    estimates: tuple[float | None, ...]
    needs: tuple[str, ...]
    u: float | None


@dataclass(frozen=True)
class Jackknife:
    """The delete-one-placement jackknife of the offsets that all data together determine.

    `dof` is the number of placements less 1: so few values make up each u.
    """

    placements: tuple[str, ...]
    dof: int
    offsets: tuple[JackknifeOffset, ...]

    def u(self, name: str) -> float | None:
        """The jackknife's standard uncertainty of an offset; None where there is none."""
        return next((row.u for row in self.offsets if row.name == name), None)


@dataclass(frozen=True, eq=False)
class Without:
    """The fit `x` (p,) of the problem `seen`, which lacks one placement; `reason` of how it ended.

    `covariance` (f, f) is of its scaled free parameters, by Fisher's information."""

    placement: Placement
    seen: Problem
    x: Matrix
    covariance: Matrix
    weight: float
    converged: bool
    reason: str


def fits_without(solution: Solution) -> tuple[Without, ...]:
    """A fit without each placement: scoring steps (exact gradient, Fisher's information) from the mode of the
    whole, until the gradient is below 0.02 standard uncertainties; where they do not get there, Levenberg and
    Marquardt's. Separate noise factors stay as all measurements together have them. Empty without an answer,
    or for one placement."""
    if not solution.converged:
        return ()
    problem, x = known_factors(solution)
    every = placements(problem)
    return tuple(fit_without(problem, x, placement) for placement in every) if len(every) > 1 else ()


def known_factors(solution: Solution) -> tuple[Problem, Matrix]:
    """The problem and its mode, separate noise factors taken as known."""
    problem, x = solution.problem, solution.fit.x
    return problem.with_noise_of(x) if problem.noise.separate else (problem, x)


def fit_without(problem: Problem, x: Matrix, placement: Placement, settled: float = _SETTLED) -> Without:
    """The fit of all but a placement, begun at `x` (p,), until the gradient is below `settled`."""
    seen = problem.without_targets(placement.targets)
    start = x[[problem.parameters.index(name) for name in seen.parameters.names]]
    density = Density(seen)
    at, converged, reason = _scored(density, start, settled)
    if not converged:
        found = modes(density, start[None])
        at, converged, reason = found.x[0], bool(found.converged[0]), found.reason[0]
    weight = float(unbiased_weight(density, at[None])[0])
    information = density.slopes(at[None]).information[0]
    if seen.noise.estimated:
        prior = density.prior_information(at[None])[0]
        information = prior + (information - prior) * weight / float(density.noise_weight(at[None])[0])
    return Without(placement, seen, at, np.linalg.inv(information), weight, converged, reason)


def _scored(density: Density, start: Matrix, settled: float) -> tuple[Matrix, bool, str]:
    """x (p,) by Fisher scoring from `start`, whether it converged, and why."""
    parameters, x, size = density.problem.parameters, start.copy(), np.inf
    free = parameters.free
    for _ in range(_STEPS):
        slopes = density.slopes(x[None])
        gradient, information = slopes.gradient[0], slopes.information[0]
        step = np.linalg.solve(information, gradient)
        size = float(np.sqrt(max(gradient @ step, 0.0)))
        if not np.isfinite(size) or size < settled:
            break
        x[free] += step * parameters.prior_std[free]
    return x, size < settled, f"the gradient is {size:.1e} posterior standard deviations"


def leave_one_out(solution: Solution, fits: Sequence[Without]) -> LeaveOneOut | None:
    """Each placement as the fit without it predicts it; None for less than two placements."""
    if not fits:
        return None
    whole, _ = known_factors(solution)
    rows = tuple(
        judged(whole, [own.placement], own.seen, own.x, own.covariance, own.weight)
        if own.converged
        else not_fitted(whole, [own.placement], own.seen, own.reason)
        for own in fits
    )
    return LeaveOneOut(
        rows,
        _pooled([(row.shots, row.rms_mm) for row in rows]),
        _pooled([(row.shots, row.expected_mm) for row in rows]),
    )


def _pooled(rows: Sequence[tuple[int, float | None]]) -> float | None:
    """The rms over all measurements of the rms of each placement."""
    squares = [count * value**2 for count, value in rows if value is not None]
    if len(squares) < len(rows):
        return None
    return float(np.sqrt(sum(squares) / sum(count for count, _ in rows)))


def jackknife(solution: Solution, fits: Sequence[Without]) -> Jackknife | None:
    """The standard uncertainties of the offsets by the scatter of the fits without one placement.

    Placements differ in size: the delete-m_j jackknife (Busing, Meijer & van der Leeden, Statistics and
    Computing 9, 1999, eq. 3 to 7). Of an offset that the whole data do not determine there is none. None for
    less than three placements, or where a fit did not converge.
    """
    if len(fits) < _FEWEST or not all(own.converged for own in fits):
        return None
    determined_by = _determined(solution, fits)
    counts = np.array([len(own.placement.rows) for own in fits])
    names = tuple(own.placement.name for own in fits)
    problem, rows = solution.problem, []
    for i in np.flatnonzero(problem.parameters.group("offset")):
        item = problem.parameters.items[i]
        if item.held or not known(solution.status[i]):
            continue
        values = np.array([own.x[own.seen.parameters.index(item.name)] for own in fits])
        determined = determined_by[:, i]
        u = None
        if determined.all():
            u = item.shown_std(float(solution.fit.x[i]), delete_group_std(solution.fit.x[i], values, counts))
        rows.append(
            JackknifeOffset(
                item.name,
                item.unit,
                tuple(item.shown(float(v)) if ok else None for v, ok in zip(values, determined, strict=True)),
                tuple(name for name, ok in zip(names, determined, strict=True) if not ok),
                u,
            )
        )
    return Jackknife(names, len(fits) - 1, tuple(rows))


def delete_group_std(whole: float, without: Matrix, counts: Index | NDArray[np.int64]) -> float:
    """The delete-m_j jackknife's std of an estimate: `whole` by all data, `without` (g,) each group, of
    `counts` (g,) measurements. Equal groups: the root of (g - 1) / g times their sum of squares."""
    times = counts.sum() / counts
    pseudo = times * whole - (times - 1) * without
    centre = len(without) * whole - ((1 - 1 / times) * without).sum()
    return float(np.sqrt(((pseudo - centre) ** 2 / (times - 1)).mean()))


def _determined(solution: Solution, fits: Sequence[Without]) -> NDArray[np.bool_]:
    """(g, p) which parameters the data without each placement determine, by the rule of `identify`: the std
    without prior is below the prior's. From the Jacobian of all data less the rows and columns of each."""
    problem, free = solution.problem, solution.problem.parameters.free
    _, jacobian, _ = information_root(problem, solution.fit.x, solution.fit.weight)
    d, result = problem.tool.residual_size, np.zeros((len(fits), len(free)), dtype=bool)
    for row, own in enumerate(fits):
        stay = ~problem.parameters.targets(own.placement.targets)[free]
        rows = np.delete(
            np.arange(len(jacobian)),
            d * np.repeat(own.placement.rows, d) + np.tile(np.arange(d), len(own.placement.rows)),
        )
        _, singular, right = np.linalg.svd(np.linalg.qr(jacobian[np.ix_(rows, stay)], mode="r"))
        singular = np.append(singular, np.zeros(right.shape[1] - len(singular)))
        floor = _ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
        std = np.sqrt(((right.T / np.maximum(singular, floor)) ** 2).sum(axis=1))
        result[row, np.flatnonzero(free)[stay]] = std < 1.0
    return result
