"""Outliers: what each measurement does to the answer (leave-one-out residuals, Cook's distances), long
residuals in a robust fit, the one that contradicts the others, values far from the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record, worded
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import LikelihoodFit, fit_likelihood, modes
from ..row import ParameterRow
from ..solution import ParameterResult, Solution

# What each measurement does to the answer: leave-one-out residuals and Cook's distances; and fits to which
# one that is far off does little.
#
# Up to 300 measurements they are exact, by a fit without each one. That takes time with the square of their
# number: of more, one Newton step from the mode is taken in place of a fit, but for those of high leverage.
# A single one of so many moves the answer by little, and the two differ by some 1e-3 of a residual's
# standard deviation. The tests hold both against the formulas of the linearised fit.
#
# Robust fits: Huber's or Student's loss on the residuals, with a sandwich covariance. A measurement that is
# far off (someone leaned on the bench) pulls the likelihood fit with the square of its residual. There its
# weight falls with the length of its residual. What is left is judged by the residuals as they are, not by
# the stated noise: the sandwich of White (1980), each residual divided by what its measurement leaves open
# (HC3 of MacKinnon & White 1985), for there are few measurements.

Loss = Literal["huber", "student"]

STUDENT_NU = 4.0
_HUBER_SHARE = 0.95  # of normal residuals are shorter than Huber's threshold
_ROUNDS = 200
_SETTLED = 1e-6  # change of the largest weight
_DETERMINES_ITSELF = 1.0 - 1e-4  # leverage from which on a measurement determines something alone


@dataclass(frozen=True, eq=False)
class RobustFit:
    """`x` internal units, without noise factors; `weights` (N,) of the shots, 1 for a residual of no length
    (Student: at most (nu + d) / nu); `whitened` (N,) their residuals in their own stds; `covariance` (f, f)
    of the scaled free parameters, None where a measurement has leverage 1; `scale` of the noise."""

    loss: Loss
    tuning: float
    x: Matrix
    weights: Matrix
    whitened: Matrix
    covariance: Matrix | None
    scale: float
    converged: bool
    reason: str


def fit_robust(problem: Problem, fit: LikelihoodFit, loss: Loss) -> RobustFit:
    """Iteratively reweighted from the likelihood fit; Student's starts from Huber's, which has one minimum,
    and keeps its scale (as the MM-estimators of Yohai 1987 keep that of their first stage).

    An estimated noise scale is taken from the median residual, which outliers hardly move; noise factors are
    kept as they were fitted, and x is without them.
    """
    d = problem.sizes
    known, x = problem.with_noise_of(fit.x)
    tuning = np.sqrt(scipy.special.chdtri(d, 1 - _HUBER_SHARE)) if loss == "huber" else STUDENT_NU
    density, weights = Density(known), np.ones(problem.shots)
    first = fit_robust(problem, fit, "huber") if loss == "student" else None
    x = x if first is None else first.x
    # The residuals are what the fit has left of the errors.
    left = max(1 - density.size / d.sum(), 1e-3)

    def scale_of(quads: Matrix) -> float:
        if not problem.noise.estimated:
            return 1.0
        return (
            float(np.sqrt(np.median(quads / scipy.special.chdtri(d, 0.5)) / left))
            if first is None
            else first.scale
        )

    converged, reason = False, f"the weights did not settle in {_ROUNDS} rounds"
    for _ in range(_ROUNDS):
        quads = density.quads(x)
        scale = scale_of(quads)
        new = _weights(np.sqrt(quads) / scale, d, loss, tuning)
        settled = float(np.abs(new - weights).max()) < _SETTLED
        weights = new
        if settled:
            converged, reason = True, "the weights settled"
            break
        minima = modes(density.weighted((weights / scale**2)[None]), x[None])
        if not minima.converged[0]:
            reason = minima.reason[0]
            break
        x = minima.x[0]
    length = np.sqrt(density.quads(x)) / scale
    return RobustFit(
        loss,
        float(np.max(tuning)),
        x,
        weights,
        length,
        _sandwich(known, x, weights, scale, loss, tuning),
        scale,
        converged,
        reason,
    )


def _weights(length: Matrix, d: Matrix, loss: Loss, tuning: float | Matrix) -> Matrix:
    """(N,) weights of residuals of these whitened lengths: rho'(r) / r of each loss."""
    if loss == "huber":
        return np.asarray(np.minimum(1.0, tuning / np.maximum(length, 1e-300)))
    return np.asarray((tuning + d) / (tuning + length**2))


def _weight_slope(length: Matrix, d: Matrix, loss: Loss, tuning: float | Matrix) -> Matrix:
    """(N,) w'(r) / r: how the weights fall, so that the pull w m has the slope w I + (w' / r) m m'."""
    if loss == "huber":
        return np.asarray(np.where(length > tuning, -tuning / np.maximum(length, tuning) ** 3, 0.0))
    return np.asarray(-2 * (tuning + d) / (tuning + length**2) ** 2)


def _sandwich(
    problem: Problem, x: Matrix, weights: Matrix, scale: float, loss: Loss, tuning: float | Matrix
) -> Matrix | None:
    """(f, f), or None where a measurement has leverage 1 or the loss has no minimum here.

    The bread is the curvature of the loss and not the weights': a far residual pulls less the farther it is,
    and Student's even less than before (Huber & Ronchetti 2009, section 7.6).
    """
    d, rows = problem.tool.residual_size, problem.shots * problem.tool.residual_size
    whitened = problem.whiten(x)
    jacobian = problem.roots(whitened) / scale
    residuals = whitened.residual[:rows].reshape(problem.shots, d) / scale
    prior = Density(problem).prior_information(x[None])[0]
    root = np.sqrt(weights)[:, None]
    blocks = jacobian * root[:, :, None]
    open_part, decides = leverages(blocks, np.linalg.inv(np.einsum("idf,idg->fg", blocks, blocks) + prior))
    weight_slope = _weight_slope(np.linalg.norm(residuals, axis=1), problem.sizes, loss, tuning)
    slope = (
        weights[:, None, None] * np.eye(d)
        + weight_slope[:, None, None] * residuals[:, :, None] * residuals[:, None, :]
    )
    curvature = np.einsum("iaf,iab,ibg->fg", jacobian, slope, jacobian) + prior
    if decides.any() or np.linalg.eigvalsh(curvature)[0] <= 0:
        return None
    pulls = (blocks.transpose(0, 2, 1) @ np.linalg.solve(open_part, (root * residuals)[:, :, None]))[:, :, 0]
    bread = np.linalg.inv(curvature)
    covariance: Matrix = bread @ (pulls.T @ pulls + prior) @ bread
    return covariance


def outlying(length: Matrix, d: Matrix | int, level: float, dof: int | None = None) -> Index:
    """Shots whose whitened residuals are longer than one of N normal residuals is with probability `chance`,
    the longest first. `d` (N,) components each; `dof` are those of an estimated noise scale: the squares are
    then F's."""
    share = level / max(len(length), 1)
    limit = np.sqrt(
        scipy.special.chdtri(d, share) if dof is None else d * scipy.special.fdtri(d, dof, 1 - share)
    )
    order = np.argsort(-length)
    return np.asarray(order[(length > limit)[order]])


def leverages(blocks: Matrix, covariance: Matrix) -> tuple[Matrix, NDArray[np.bool_]]:
    """(N, d, d) I - H_i of whitened Jacobians (N, d, f), and (N,) where a measurement has leverage 1
    (there I - H_i is singular, and I is returned)."""
    hat = blocks @ covariance @ blocks.transpose(0, 2, 1)
    decides = np.linalg.eigvalsh(hat).max(axis=1) > _DETERMINES_ITSELF
    return np.eye(blocks.shape[1]) - np.where(decides[:, None, None], 0.0, hat), decides


_REFITTED = 300  # measurements up to which each one is left out by a fit
_LEVERAGE = 0.5  # from which on it is in any case
_MOST_REFITTED = 100  # of these
_ROWS = 1000  # measurements of a block: their informations are (rows, f, f)


@dataclass(frozen=True)
class ShotResult:
    """One measurement at the fit: `miss_mm` its residual (2 across the beam, or x, y, z; of all that was
    read at the posture), `length_mm` the length of that (of several readings their root mean square),
    `whitened` its length in its own standard deviations, `leave_one_out` the length in mm of the residual as
    predicted by the other measurements (None where they cannot predict it), `cooks` Cook's distance;
    `miss_deg` the residual's rotation vector, where an orientation was read."""

    shot: int
    target: str
    miss_mm: tuple[float, ...]
    length_mm: float
    whitened: float
    leave_one_out: float | None
    cooks: float | None
    miss_deg: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """How many components the residual has."""
        return len(self.miss_mm) + len(self.miss_deg)


def shot_results(fit: LikelihoodFit) -> tuple[ShotResult, ...]:
    """One for each measurement, in their order."""
    problem, effect = fit.problem, influence(fit.problem, fit)
    residual = fit.whitened.residual_mm
    every = [problem.read_components(i, row) for i, row in enumerate(residual)]
    lengths = problem.length_mm(residual)

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return tuple(
        ShotResult(
            shot=number,
            target=problem.targets[problem.target_index[i]],
            miss_mm=every[i][0],
            length_mm=float(lengths[i]),
            whitened=float(effect.whitened[i]),
            leave_one_out=finite(effect.leave_one_out[i]),
            cooks=finite(effect.cooks[i]),
            miss_deg=every[i][1],
        )
        for i, number in enumerate(problem.shot_numbers)
    )


class Influence(NamedTuple):
    """Per measurement (N,): the length of its `whitened` residual, of its `leave_one_out` residual in mm, as
    the other measurements predict it (nan where they cannot), and Cook's distance (nan likewise)."""

    whitened: Matrix
    leave_one_out: Matrix
    cooks: Matrix


def influence(problem: Problem, fit: LikelihoodFit) -> Influence:
    """By N fits, each without one measurement, or by a step instead. Where one of them fails its measurement
    has nan."""
    count, root = problem.shots, np.sqrt(fit.weight)
    open_part, decides = leverages(problem.roots(fit.whitened) * root, fit.covariance)
    density, refitted = Density(problem), np.arange(count)
    x, unknown = np.tile(fit.x, (count, 1)), decides.copy()
    if count > _REFITTED:
        x = _stepped(problem, fit, decides)
        left = np.linalg.eigvalsh(open_part)[:, 0]
        highest = np.argsort(left, kind="stable")[:_MOST_REFITTED]
        refitted = highest[1 - left[highest] > _LEVERAGE]
    if len(refitted):
        weights = np.ones((len(refitted), count))
        weights[np.arange(len(refitted)), refitted] = 0.0
        without = modes(density.weighted(weights), np.tile(fit.x, (len(refitted), 1)))
        x[refitted], unknown[refitted] = without.x, decides[refitted] | ~without.converged
    move = density.scaled(x) - fit.z
    cooks = (move * np.linalg.solve(fit.covariance, move.T).T).sum(axis=1) / move.shape[1]
    left_out, _ = problem.linearise(x)
    return Influence(
        fit.normalised_lengths,
        np.where(unknown, np.nan, problem.length_mm(left_out)),
        np.where(unknown, np.nan, cooks),
    )


def _stepped(problem: Problem, fit: LikelihoodFit, decides: Mask) -> Matrix:
    """x (N, p) after one Newton step from the mode without each measurement, in the coordinates of a fit:
    (H - H_i) step = -g_i with its own slope and information; nothing of use where it `decides` (N,) alone."""
    known, _ = problem.with_noise_of(fit.x) if problem.noise.estimated else (problem, fit.x)
    coordinates = FlangeCoordinates(Density(problem))
    v = coordinates.from_parameters(fit.x[None])
    local = coordinates.at(v)
    curvature = np.linalg.inv(coordinates.covariance(fit.x[None], fit.covariance[None]))
    x = np.empty((problem.shots, len(fit.x)))
    for k in range(len(problem.targets)):
        every = np.flatnonzero(problem.target_index == k)
        for mine in np.array_split(every, -(-len(every) // _ROWS)):
            # Data sets of one measurement each.
            one = replace(known.select(mine[:1]), ties=())
            parts = (known.joints, known.spots, known.weights, known.readings)
            singles = Density(one, *(part[mine][:, None] for part in parts))
            slopes = singles.slopes(np.tile(fit.x, (len(mine), 1)))
            gradient = (slopes.gradient + fit.z) * fit.weight
            information = (slopes.information - np.eye(singles.size)) * fit.weight
            information[decides[mine]] = 0.0
            left = curvature - local.information(information)
            step = -np.linalg.solve(left, local.gradient(gradient)[:, :, None])[:, :, 0]
            x[mine] = coordinates.to_parameters(v + step)
    return x


OUTLYING = 1e-3  # p-value, over all measurements together, of an outlying residual
FEWEST_VALUES = 15  # from here on the level of `outlying_values` holds (Rosner 1983, table 3)
_MOST_OUTLYING = 0.1  # of all values: more are no outliers but another population
_SIGNIFICANT = 1e-3  # of a single outlier, after Bonferroni's correction
_MEDIAN_WORTH = 0.48  # a scale from the median is as good as one from so large a share of the numbers


@record
class Robust:
    """A fit in which a large residual weighs less; outliers are beyond `OUTLYING`. `with_uncertainty` is
    False where a measurement has leverage 1, or there are no more numbers than unknowns."""

    loss: Annotated[Loss, it("the loss function")]
    tuning: Annotated[
        float,
        it(
            "of `huber` the normalised residual beyond which the weight falls; of `student` the "
            "degrees of freedom"
        ),
    ]
    converged: Annotated[bool, it("whether the weights converged; if not, no parameter has a number")]
    reason: Annotated[str, it("termination, in words")]
    noise_scale: Annotated[
        float | None,
        it(
            "the noise as a multiple of the stated one, from the median residual; null unless "
            "`noise.scale: estimated`"
        ),
    ]
    parameters: Annotated[
        tuple[ParameterRow, ...],
        it(
            "by the robust fit; `std` and `interval95` by a sandwich covariance, from the residuals as they"
            " are: null with a measurement of leverage 1"
        ),
    ]
    weights: Annotated[
        tuple[float, ...],
        it(
            "of the measurements, in the order of `shots`: with 1 a measurement counts as in the "
            "likelihood fit (Student: a little more than 1 for a small residual)"
        ),
    ]
    outliers: Annotated[
        tuple[int, ...], it("numbers of the outlying measurements, the largest residual first")
    ]
    with_uncertainty: Annotated[bool, internal]
    message: Annotated[str | None, worded("the same in words")] = field(default=None, kw_only=True)


def robust_result(solution: Solution, loss: Loss) -> Robust:
    """The robust fit of a solution's measurements."""
    problem, fit = solution.problem, solution.fit
    robust = fit_robust(problem, fit, loss)
    parameters = problem.with_noise_of(fit.x)[0].parameters
    std = np.full(len(parameters), np.nan)
    if robust.covariance is not None:
        std = parameters.unscaled(np.sqrt(np.diag(robust.covariance)))
    numbers = problem.data_size - int(parameters.free.sum())
    quantile = float(scipy.special.stdtrit(max(numbers, 1), 0.975))

    def row(parameter: ParameterResult, i: int) -> ParameterRow:
        item, value, spread = parameters.items[i], float(robust.x[i]), float(std[i])
        determined = parameter.estimate is not None and robust.converged
        with_std = determined and bool(np.isfinite(spread)) and numbers > 0
        ends = (item.shown(value - quantile * spread), item.shown(value + quantile * spread))
        return ParameterRow(
            name=parameter.name,
            unit=parameter.unit,
            status=parameter.status,
            estimate=item.shown(value) if determined else None,
            std=item.shown_std(value, spread) if with_std else None,
            interval95=ends if with_std else None,
        )

    dof = max(1, int(_MEDIAN_WORTH * numbers)) if problem.noise.estimated else None
    off = outlying(robust.whitened, problem.sizes, OUTLYING, dof)
    return Robust(
        loss=loss,
        tuning=robust.tuning,
        converged=robust.converged,
        reason=robust.reason,
        noise_scale=robust.scale if problem.noise.estimated else None,
        parameters=tuple(
            row(parameter, i)
            for i, parameter in enumerate(solution.parameters[: len(parameters)])
            if not parameter.held
        ),
        weights=tuple(float(weight) for weight in robust.weights),
        outliers=tuple(problem.shot_numbers[i] for i in off) if robust.converged else (),
        with_uncertainty=robust.covariance is not None and numbers > 0,
    )


@dataclass(frozen=True)
class SingleOutlier:
    """A measurement without which chi-squared falls by more than noise explains; its residual at the fit of
    the others is `residual_mm` long. `p_value` is corrected for the number of measurements."""

    shot: int
    p_value: float
    residual_mm: float


def single_outlier(fit: LikelihoodFit, dof: int) -> SingleOutlier | None:
    """The measurement that contradicts the others most, None where none does significantly.

    Only by a stated noise, and where the others leave numbers over (`dof` with it) to contradict it.
    """
    problem, sizes = fit.problem, fit.problem.sizes
    if not problem.noise.known or dof <= sizes.max():
        return None

    def cost(candidate: LikelihoodFit) -> float:
        residual = candidate.whitened.residual
        return float(residual @ residual + candidate.z @ candidate.z)

    rows = np.arange(problem.shots)
    others = [fit_likelihood(problem.select(np.delete(rows, i)), starts=0) for i in rows]
    i = int(np.argmin([cost(rest) for rest in others]))
    drop = max(cost(fit) - cost(others[i]), 0.0)
    p_value = min(1.0, problem.shots * float(scipy.special.chdtrc(sizes[i], drop)))
    residual_mm = problem.select(rows[[i]]).whiten(others[i].x).residual_mm[0]
    if p_value >= _SIGNIFICANT:
        return None
    length = problem.select(rows[[i]]).length_mm(residual_mm[None])[0]
    return SingleOutlier(problem.shot_numbers[i], p_value, float(length))


class OutlyingValue(NamedTuple):
    """The value with the index `row`; `deviation` from the mean of the others, in their standard
    deviations."""

    row: int
    deviation: float


def outlying_values(values: Sequence[float] | Matrix, level: float) -> list[OutlyingValue]:
    """The outliers among normal `values`, the furthest first; none among fewer than `FEWEST_VALUES`.

    The generalised extreme Studentised deviate test (Rosner, Technometrics 25, 1983), of a number of outliers
    that is not known beforehand. With no outlier it names one with a probability of `level` at most; several
    do not hide each other.
    """
    all_values = np.asarray(values, dtype=float)
    count, left = len(all_values), np.arange(len(all_values))
    if count < FEWEST_VALUES:
        return []
    removed: list[int] = []
    count_outlying = 0
    for k in range(1, max(1, int(_MOST_OUTLYING * count)) + 1):
        rest = all_values[left]
        off, std = np.abs(rest - rest.mean()), float(rest.std(ddof=1))
        if not std > 0:
            break
        furthest = int(np.argmax(off))
        removed.append(int(left[furthest]))
        left = np.delete(left, furthest)
        if off[furthest] / std > _critical(count, k, level):
            count_outlying = k
    others = np.setdiff1d(np.arange(count), removed[:count_outlying])
    mean, std = float(all_values[others].mean()), float(all_values[others].std(ddof=1))
    return [OutlyingValue(row, float((all_values[row] - mean) / std)) for row in removed[:count_outlying]]


def _critical(count: int, k: int, level: float) -> float:
    """Rosner's lambda of the k-th deviate of so many values."""
    dof = count - k - 1
    t = float(scipy.special.stdtrit(dof, 1 - level / (2 * (count - k + 1))))
    return (count - k) * t / float(np.sqrt((dof + t * t) * (count - k + 1)))
