"""The likelihood fit: the posterior's mode (MAP), its covariance and effective degrees of freedom, and other
basins if there are any.

Fits are rows: the starts of one run, or one start of each of many runs, go up side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix, normal_half_width
from ...model.kernel import threads
from ...model.likelihood.density import Density, density_of
from ...model.likelihood.problem import Problem, Whitened
from .climb import MOST_STEPS, Climb
from .levenberg_marquardt import Minima, Minimised

_STEP = 0.1  # of the logarithms, for the differences
_LONGEST = 1.0
_ROUNDS = 30
_SETTLED = 1e-4


def marginal_noise(problem: Problem, start: Matrix) -> tuple[Matrix, Matrix, bool]:
    """x (p,) with the noise factors at their marginal mode and all else at its mode given them, its
    covariance (f, f) by the scaled parameters, and whether it settled; `start` (p,) is a fit near it."""
    parameters, density = problem.parameters, Density(problem)
    columns = np.flatnonzero(parameters.group("noise")[parameters.free])  # the noise among the free ones
    count = len(columns)
    units = np.eye(count)
    pairs = [units[i] + units[j] for i, j in zip(*np.tril_indices(count, -1), strict=True)]
    points = _STEP * np.array([np.zeros(count), *units, *-units, *pairs, *(-pair for pair in pairs)])
    held = np.zeros((len(points), density.size), dtype=bool)
    held[:, columns] = True
    climb = Climb(density, np.zeros(len(points), dtype=int), len(points), held)
    v = climb.coordinates.from_parameters(start[None])[0]
    settled = False
    for _ in range(_ROUNDS):
        near = np.tile(v, (len(points), 1))
        near[:, columns] += points
        minima = climb.up(near)
        # The held have a 1 in the information and no part in its determinant.
        log_det = np.linalg.slogdet(minima.curvature)[1]
        slope, curvature = _quadratic(-minima.cost - log_det / 2, count)
        values, vectors = np.linalg.eigh(curvature)
        step = vectors @ (vectors.T @ slope / np.maximum(np.abs(values), 1e-3))
        step *= min(1.0, _LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        by_noise = (minima.x[1 : 1 + count] - minima.x[1 + count : 1 + 2 * count]).T / (
            2 * _STEP
        )  # (f, count)
        v = minima.x[0] + by_noise @ step
        if np.abs(step).max(initial=0.0) < _SETTLED:
            settled = bool(minima.converged.all() and (values > 1e-3).all())
            break
    x = climb.coordinates.to_parameters(v[None])[0]
    rest = np.linalg.inv(minima.curvature[0])  # what is held has 1 there, and no part in the others
    rest[columns, columns] = 0.0
    covariance = rest + by_noise @ np.linalg.inv(curvature) @ by_noise.T
    by_v = climb.coordinates.jacobian(x[None])[0]
    return x, by_v @ covariance @ by_v.T, settled


def _quadratic(values: Matrix, count: int) -> tuple[Matrix, Matrix]:
    """Slope (count,) and negative curvature (count, count) of values at the points of `marginal_noise`."""
    centre, up, down = values[0], values[1 : 1 + count], values[1 + count : 1 + 2 * count]
    slope = (up - down) / (2 * _STEP)
    curvature = np.diag((2 * centre - up - down) / _STEP**2)
    rest = values[1 + 2 * count :].reshape(2, -1)
    for k, (i, j) in enumerate(zip(*np.tril_indices(count, -1), strict=True)):
        both = (2 * centre - rest[0, k] - rest[1, k]) / _STEP**2
        curvature[i, j] = curvature[j, i] = (both - curvature[i, i] - curvature[j, j]) / 2
    return slope, curvature


_SAME_TOP = 0.01  # posterior stds: the way up ends within a thousandth of the top
_SAME_BASIN = 0.5  # posterior stds: two modes nearer than this are one
CONTRADICTED = 1e-4  # a chance below which residuals and priors together are no chance
_NOISE_ROUNDS = 2
_TOGETHER = 250  # fits side by side in one thread: what a core keeps near
STARTS = 8  # random ones, besides zero offsets
MANY_STARTS = 64
_FEW_NUMBERS = 3.0  # to each unknown: below that a wrong basin can pass for a fit
_WORTH_TELLING = 12.0  # log-posterior units: a basin further down carries less than 1e-5 of the mass


@dataclass(frozen=True, eq=False)
class Fits(Minimised):
    """Modes and what surrounds them, one a row.

    `x` (W, p) internal units; `z` (W, f) the free parameters scaled by their priors; `covariance` (W, f, f)
    of z from the curvature of the log-posterior; `weight` (W,) 1 / noise scale^2; `gradient` (W,) the size
    of the log-posterior's gradient in posterior stds.
    """

    x: Matrix
    z: Matrix
    covariance: Matrix
    weight: Matrix
    log_posterior: Matrix
    gradient: Matrix

    @property
    def std(self) -> Matrix:
        """(W, f) of the free parameters, scaled by their priors."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


class Optimum(NamedTuple):
    """Another mode: z and std (f,) there, and by how much its log-posterior is `below` that of the best."""

    z: Matrix
    std: Matrix
    below: float


class AgainstNoise(NamedTuple):
    """Chi-squared of the residuals, its degrees of freedom, and the chance of one as large by the stated
    noise: None where the noise is estimated or no number is left to contradict it."""

    chi2: float
    dof: int
    p_value: float | None


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """The best mode of one run, a row of `Fits`."""

    problem: Problem

    x: Matrix
    z: Matrix
    covariance: Matrix
    weight: float
    log_posterior: float
    gradient: float
    iterations: int
    converged: bool
    reason: str
    others: tuple[Optimum, ...] = ()

    def __repr__(self) -> str:
        how = "converged" if self.converged else f"not converged ({self.reason})"
        return f"<LikelihoodFit: {how}, {len(self.z)} parameters estimated, {self.iterations} iterations>"

    @property
    def other_basins(self) -> int:
        """How many other modes are worth telling."""
        return len(self.others)

    @cached_property
    def whitened(self) -> Whitened:
        """Residuals and Jacobian at x."""
        return self.problem.whiten(self.x)

    @property
    def normalised_lengths(self) -> Matrix:
        """(N,) length of the normalised residual of each measurement."""
        count, d = self.problem.shots, self.problem.tool.residual_size
        residual = self.whitened.residual[: count * d].reshape(count, d) * np.sqrt(self.weight)
        return np.asarray(np.linalg.norm(residual, axis=1) / np.sqrt(self.problem.weights))

    @property
    def std(self) -> Matrix:
        """(f,) of the free parameters, scaled by their priors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def p_value(self) -> float | None:
        """That residuals and scaled parameters are as large together, where the noise is known: at the mode
        their squares have the chi-squared of as many degrees of freedom as there are numbers. Unlike
        `against_noise` it tells of a wrong basin even if no number is left over."""
        if not self.problem.noise.known:
            return None
        return fit_p_value(self.problem, self.whitened.residual, self.z)

    def against_noise(self, rank: int) -> AgainstNoise:
        """The residuals, and the geometry by its tolerances, against what is stated of both; `rank` numbers
        are taken up by the fit."""
        tolerated = self.z[self.problem.parameters.among_free[self.problem.tolerated]]
        chi2 = float(self.whitened.residual @ self.whitened.residual + tolerated @ tolerated)
        dof = max(self.problem.data_size - rank, 0)
        judged = dof > 0 and self.problem.noise.known
        return AgainstNoise(chi2, dof, float(scipy.special.chdtrc(dof, chi2)) if judged else None)


def fit_p_value(problem: Problem, residual: Matrix, z: Matrix) -> float:
    """That whitened residuals (M,) and scaled parameters (f,) are as large at a mode, their noise known."""
    return float(scipy.special.chdtrc(problem.measured_size, float(residual @ residual + z @ z)))


def fit_likelihood(problem: Problem, *, starts: int = STARTS, seed: int = 0) -> LikelihoodFit:
    """Fit from zero offsets and from `starts` further points drawn from the priors; the best mode wins.

    If that contradicts noise and priors, with few numbers, the best may be elsewhere: more starts are tried.
    """
    if problem.noise.separate:
        return _with_noise_factors(
            problem, problem.nominal(), lambda known, _: fit_likelihood(known, starts=starts, seed=seed)
        )
    density = density_of(problem)
    z = _start_points(density.size, starts, seed)
    start = start_at(problem, z)
    fits = fit_rows(density, start, np.zeros(len(z), dtype=np.int64))
    fit = _best_of(problem, fits)
    doubtful = 0 < starts < MANY_STARTS and _has_few_numbers(problem)
    if doubtful and fit.p_value is not None and fit.p_value < CONTRADICTED:
        return fit_likelihood(problem, starts=MANY_STARTS, seed=seed)
    return fit


def _best_of(problem: Problem, fits: Fits) -> LikelihoodFit:
    """The best of the rows, which are those of the starts of one run, with the other basins."""
    best = int(_best_start(fits.converged[None], fits.log_posterior[None])[0])
    basins = [best]
    for row in range(len(fits.converged)):
        if row == best:
            continue
        near = fits.log_posterior[row] >= fits.log_posterior[best] - _WORTH_TELLING
        if fits.converged[row] and near and all(_apart(fits, row, known) for known in basins):
            basins.append(row)
    return single(problem, fits, best, basins[1:])


def fit_from(problem: Problem, start: Matrix) -> LikelihoodFit:
    """The fit from one start x (p,) alone: for a mode that is known to be near."""
    if problem.noise.separate:
        return _with_noise_factors(problem, start, fit_from)
    return single(problem, fit_rows(Density(problem), start[None]), 0)


def _with_noise_factors(
    problem: Problem, start: Matrix, fitted: Callable[[Problem, Matrix], LikelihoodFit]
) -> LikelihoodFit:
    """The fit with separate noise factors at their marginal mode, from those of `start` (p,).

    `fitted` fits all else at known noise: at the factors of `start`, then at those that are found there. The
    common mode of factors and all else is no way to them: where uncertain links can explain every residual
    its noise is 0.
    """
    noise, density, x = problem.parameters.group("noise"), Density(problem), start
    for _ in range(_NOISE_ROUNDS):
        known, rest = problem.with_noise_of(x)
        fit = fitted(known, rest)
        x = x.copy()
        x[~noise] = fit.x
        if not fit.converged:
            size = density.size
            return replace(fit, problem=problem, x=x, z=density.scaled(x[None])[0], covariance=np.eye(size))
        x, covariance, settled = marginal_noise(problem, x)
    z, std = density.scaled(x[None])[0], np.sqrt(np.diag(covariance))
    others, of_rest = [], ~noise[problem.parameters.free]
    for other in fit.others:
        there, spread = z.copy(), std.copy()
        there[of_rest], spread[of_rest] = other.z, other.std
        others.append(Optimum(there, spread, other.below))
    return replace(
        fit,
        problem=problem,
        x=x,
        z=z,
        covariance=covariance,
        log_posterior=float(density.log_posterior(x[None])[0]),
        converged=settled,
        reason=fit.reason if settled else "the noise factors did not settle",
        others=tuple(others),
    )


def fit_each(problem: Problem, joints: Matrix, spots: Matrix) -> Fits:
    """The fit of `fit_likelihood` for each of W data sets of one problem, side by side.

    `joints` (W, M, n) and `spots` are what was recorded. Starts, choice among them and the further starts of
    a fit that contradicts noise and priors are the same; but the best start is chosen before Newton's steps,
    and only that one is polished. With separate noise factors each run is fitted by `fit_likelihood` itself.
    """
    density, count = Density(problem, joints, spots), len(joints)
    z = _start_points(density.size, STARTS, 0)
    of = np.repeat(np.arange(count), len(z))
    minima = modes(density, start_at(problem, np.tile(z, (count, 1)), joints[of]), of)
    best = _best_start(minima.converged.reshape(count, -1), -minima.cost.reshape(count, -1))
    fits = fit_rows(density, minima.x[np.arange(count) * len(z) + best])
    x, scaled, covariance = fits.x.copy(), fits.z.copy(), fits.covariance.copy()
    converged, log_posterior = fits.converged.copy(), fits.log_posterior.copy()
    doubtful = problem.noise.known and _has_few_numbers(problem)
    for row in range(count if doubtful or problem.noise.separate else 0):
        moved, starts = problem.moved(joints[row], spots[row]), STARTS
        if doubtful:
            if fit_p_value(moved, moved.whiten(x[row]).residual, scaled[row]) >= CONTRADICTED:
                continue
            starts = MANY_STARTS
        again = fit_likelihood(moved, starts=starts)
        x[row], scaled[row], covariance[row] = again.x, again.z, again.covariance
        converged[row], log_posterior[row] = again.converged, again.log_posterior
    return replace(
        fits, x=x, z=scaled, covariance=covariance, converged=converged, log_posterior=log_posterior
    )


def _start_points(size: int, starts: int, seed: int) -> Matrix:
    """(1 + starts, f) scaled parameters: zero offsets, then draws from the priors."""
    zero = np.zeros((1, size))
    return np.vstack([zero, np.random.default_rng(seed).normal(size=(starts, size))]) if starts else zero


def _best_start(converged: NDArray[np.bool_], log_posterior: Matrix) -> Index:
    """(W,) the best of the starts (W, S); the first, of zero offsets, where none is better."""
    best = np.argmax(np.where(converged, log_posterior, -np.inf), axis=1)
    every = np.arange(len(best))
    better = converged[every, best] & (log_posterior[every, best] > log_posterior[:, 0] + 1e-6)
    return np.where(better, best, 0)


def _has_few_numbers(problem: Problem) -> bool:
    """Whether there are so few numbers to each unknown that a wrong basin can pass for a fit."""
    return problem.data_size < _FEW_NUMBERS * int(problem.parameters.free.sum())


def single(problem: Problem, fits: Fits, row: int, others: Sequence[int] = ()) -> LikelihoodFit:
    """A row of fits, that of `problem`; `others` are those of other optima."""
    return LikelihoodFit(
        problem=problem,
        x=fits.x[row],
        z=fits.z[row],
        covariance=fits.covariance[row],
        weight=float(fits.weight[row]),
        log_posterior=float(fits.log_posterior[row]),
        gradient=float(fits.gradient[row]),
        iterations=int(fits.iterations[row]),
        converged=bool(fits.converged[row]),
        reason=fits.reason[row],
        others=tuple(
            Optimum(fits.z[k], fits.std[k], float(fits.log_posterior[row] - fits.log_posterior[k]))
            for k in others
        ),
    )


def start_at(problem: Problem, z: Matrix, joints: Matrix | None = None) -> Matrix:
    """x (W, p) with the free offsets and tool at z (W, f), and what is only guessed as the measurements say
    there.

    `joints` (W, N, n) are the recorded ones of each row, the problem's own by default.
    """
    parameters = problem.parameters
    x = np.tile(parameters.prior_mean, (len(z), 1))
    x[:, parameters.free] += z * parameters.prior_std[parameters.free]
    return problem.started(x, joints)


def fit_rows(density: Density, start: Matrix, of: Index | None = None) -> Fits:
    """Fit from each start x (W, p): `modes`, then Newton, and the curvature there. `of` (W,) names the data
    set of each row (default: one for each)."""
    of = np.arange(len(start)) if of is None else of
    if len(start) <= _TOGETHER:
        return _fit_together(density, start, of)
    parts = [slice(first, first + _TOGETHER) for first in range(0, len(start), _TOGETHER)]
    with ThreadPoolExecutor(threads()) as pool:
        fitted = list(pool.map(lambda part: _fit_together(density, start[part], of[part]), parts))
    joined = {
        item.name: np.concatenate([getattr(part, item.name) for part in fitted])
        for item in fields(Fits)
        if item.name != "reason"
    }
    return Fits(**joined, reason=tuple(reason for part in fitted for reason in part.reason))


def _fit_together(density: Density, start: Matrix, of: Index) -> Fits:
    climb = Climb(density, of, len(start))
    minima = climb.up(climb.coordinates.from_parameters(start, of))
    tops = _same_top(minima, of)
    first = np.flatnonzero(tops == np.arange(len(tops)))
    if len(first) < len(start):
        of, minima = of[first], minima.of_rows(first)
    top = Climb(density, of, len(first)).polished(minima)
    x, by_v = climb.coordinates.at(top.v, of)
    covariance = by_v @ top.covariance @ by_v.transpose(0, 2, 1)
    weight = unbiased_weight(density, x, of)
    fits = Fits(
        top.iterations,
        top.converged,
        top.reason,
        x,
        density.scaled(x),
        reweighted(density, x, covariance, weight / density.noise_weight(x, of)),
        weight,
        top.value,
        top.gradient,
    )
    return fits if len(first) == len(start) else fits.of_rows(np.searchsorted(first, tops))


def _same_top(minima: Minima, of: Index) -> Index:
    """(W,) the first row of the same data set that ended on the same top, by Fisher's information there."""
    same = np.arange(len(of))
    tops: dict[int, list[int]] = {}
    for row in np.flatnonzero(minima.converged).tolist():
        known = tops.setdefault(int(of[row]), [])
        if known:
            way = minima.x[known] - minima.x[row]
            apart = np.einsum("ki,kij,kj->k", way, minima.curvature[known], way)
            near = np.flatnonzero(apart < _SAME_TOP**2)
            if len(near):
                same[row] = known[near[0]]
                continue
        known.append(row)
    return same


def reweighted(density: Density, x: Matrix, covariance: Matrix, ratio: Matrix) -> Matrix:
    """(W, f, f) at x (W, p) with the shots' part of the information multiplied by `ratio` (W,); what is known
    besides, priors and distances, stays as it is."""
    if not density.problem.noise.estimated:
        return covariance
    rigid = density.prior_information(x)
    shots = np.linalg.inv(covariance) - rigid
    return np.asarray(np.linalg.inv(ratio[:, None, None] * shots + rigid), dtype=float)


def modes(
    density: Density, start: Matrix, of: Index | None = None, *, most_steps: int = MOST_STEPS
) -> Minima:
    """The modes alone, to some 1e-4 posterior stds: Levenberg-Marquardt on the exact log-posterior with
    Fisher's information, from each start x (W, p). The `x` of the minima are parameter vectors (W, p)."""
    climb = Climb(density, of, len(start))
    minima = climb.up(climb.coordinates.from_parameters(start, climb.of), most_steps)
    return replace(minima, x=climb.coordinates.to_parameters(minima.x, climb.of))


def _apart(fits: Fits, a: int, b: int) -> bool:
    std = np.maximum(fits.std[a], fits.std[b])
    return not bool((np.abs(fits.z[a] - fits.z[b]) <= _SAME_BASIN * std).all())


def unbiased_weight(density: Density, x: Matrix, of: Index | None = None) -> Matrix:
    """(W,) 1 / noise scale^2 at x (W, p): 1 for known noise, else what of the residuals is free / chi^2."""
    if not density.problem.noise.estimated:
        return np.ones(len(x))
    information = density.slopes(x, of).information
    # What the shots determine is what the priors and distances do not: f - tr(C R).
    rigid = np.trace(np.linalg.solve(information, density.prior_information(x)), axis1=1, axis2=2)
    numbers = density.numbers(of)
    chi2 = numbers / density.noise_weight(x, of)
    return np.asarray(np.maximum(numbers - (density.size - rigid), 1e-3) / chi2)


# The effective degrees of freedom of standard uncertainties that come from an estimated noise, by Welch and
# Satterthwaite (GUM, G.4), and what each reading does to each estimate.
#
# Near the mode the estimate moves by -C A_i' S_i^-1 with the residual of measurement i, C the inverse of
# Fisher's information. So C is a sum of parts: of the joints' noise, of the spot's, and of what is stated
# besides.

_NOTHING_LEFT = 0.5  # of a residual: no size is expected of it


class Gains(NamedTuple):
    """`covariance` C (f, f) by Fisher's information, `besides` (f, f) the information of distances and
    priors; (N, f, n) and (N, f, d) the estimates by one joint's and one spot reading of each measurement."""

    covariance: Matrix
    besides: Matrix
    by_joint: Matrix
    by_spot: Matrix


def gains(fit: LikelihoodFit) -> Gains:
    """Of a fit at its mode, by the scaled free parameters."""
    problem, whitened = fit.problem, fit.whitened
    rows = problem.shots * problem.tool.residual_size
    jacobian = whitened.jacobian[:, problem.parameters.free]
    by_residual, by_distance = jacobian[:rows], jacobian[rows:]
    besides = by_distance.T @ by_distance + np.eye(jacobian.shape[1])
    information = fit.weight * by_residual.T @ by_residual + besides
    covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=float)
    _, jacobian_mm = problem.linearise(fit.x)
    blocks = problem.roots(whitened).transpose(0, 2, 1)
    by_spot = fit.weight * (covariance @ blocks) @ np.linalg.inv(whitened.factor)
    return Gains(covariance, besides, by_spot @ problem.by_joints(jacobian_mm), by_spot)


def noise_dof(fit: LikelihoodFit) -> float:
    """Of an estimated common noise scale, the logarithm of which has the variance 1 / (2 dof).

    With the variances a_i + s^2 of independent combinations of the readings, of which the unknowns' priors
    make a_i, it is the sum of (s^2 / (a_i + s^2))^2: 1 for each number that no unknown explains, 0 for each
    that is taken up, and between for what tolerances may explain.
    """
    each = gains(fit)
    taken = np.eye(len(each.besides)) - each.besides @ each.covariance
    numbers = fit.problem.measured_size - len(fit.problem.ties)
    return max(float(numbers - 2 * np.trace(taken) + (taken * taken.T).sum()), 1e-3)


def as_small(fit: LikelihoodFit) -> float | None:
    """The probability of residuals as small as those of a fit, the noise being as stated; None where it is
    not known.

    Of an arm and a tool that have no deviation at all: one that deviates within its tolerances leaves more. A
    residual that the priors take up by the share 1 - w has w^2 of its square left, so that the sum has the
    mean of the w^2 and twice that of the w^4 as its variance (Satterthwaite).
    """
    problem = fit.problem
    if not problem.noise.known:
        return None
    jacobian = fit.whitened.jacobian[:, problem.parameters.free]
    left = 1 / (1 + np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0))
    mean, half_variance = (
        max(float(problem.measured_size) - float((1 - left**power).sum()), 0.0) for power in (2, 4)
    )
    scale = half_variance / max(mean, _NOTHING_LEFT)
    if mean <= _NOTHING_LEFT or scale <= _NOTHING_LEFT:
        return None
    square = float(fit.whitened.residual @ fit.whitened.residual)
    return float(scipy.special.chdtr(mean / scale, square / scale))


def log_scales(fit: LikelihoodFit) -> Matrix:
    """(g, g) covariance of the logarithms of the noise scales: that of all, or the joints' and the spot's;
    (0, 0) where the noise is known."""
    noise = fit.problem.noise
    if noise.estimated:
        return np.array([[1 / (2 * noise_dof(fit))]])
    parameters = fit.problem.parameters
    chosen = np.flatnonzero(parameters.group("noise") & parameters.free)
    at = parameters.among_free[chosen]
    std = parameters.prior_std[chosen]
    return np.asarray(fit.covariance[np.ix_(at, at)] * np.outer(std, std))


def student_half_width(dof: Matrix, level: float = 0.95) -> Matrix:
    """Half widths of central intervals that hold `level`, in standard uncertainties of so many degrees of
    freedom; a normal's of infinitely many."""
    finite, upper = np.isfinite(dof), (1 + level) / 2
    return np.where(
        finite, scipy.special.stdtrit(np.where(finite, dof, 1.0), upper), normal_half_width(level)
    )


def effective_dof(fit: LikelihoodFit) -> Matrix:
    """(f,) u^4 over half the variance of u^2, u^2 being a sum of parts that each have a scale (G.2b); inf of
    known noise."""
    problem, variances = fit.problem, np.diag(fit.covariance)
    if problem.noise.known:
        return np.full(len(variances), np.inf)
    each = gains(fit)
    if problem.noise.estimated:
        # All that was not stated has the one scale, curvature too.
        of_data = (each.covariance @ each.besides * each.covariance).sum(axis=1)
        parts = (variances - of_data)[:, None]
    else:
        of_noise = problem.variances(fit.x)
        joints = ((each.by_joint**2).sum(axis=0) * of_noise[: problem.robot.n]).sum(axis=1)
        readings = np.einsum("nfd,ind->fi", each.by_spot**2, problem.of_sources(of_noise))
        by_noise = np.hstack([joints[:, None], readings])
        noise = problem.noise
        parts = by_noise @ np.equal(np.arange(len(noise.factors)), np.array(noise.of_factor)[:, None])
    with np.errstate(divide="ignore"):
        return np.asarray(variances**2 / (2 * ((parts @ log_scales(fit)) * parts).sum(axis=1)))
