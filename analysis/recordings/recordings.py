"""Which measurements belong together: placements and recordings.

A placement is the targets that stay together while the measurements of one setup are taken: a set of targets
tied by stated distances or angles (the sockets of one plate, the faces of one cube), or one target alone.
What is wrong with a model shows between placements: an arm that is not its drawing hits each place
consistently, and each a little differently.

Recordings: the consecutive measurements of one target, the correlation of their residuals at a fit, and
the effective number of measurements: how many independent ones would say as much.

The residuals r of a fit are no independent numbers even if the errors are: with whitened Jacobian A and
C = (A'A + I)^-1 their covariance is M = I - A C A'. With errors of covariance R it is M R M + A C^2 A', if
the parameters are as their priors say. With C^-1 = L L' and B = A L'^-1, the Jacobian in posterior stds, M is
I - B B', and the parts of one recording follow from its own rows of B and from B' R B. What is needed of a
long recording's covariance (its traces, its product with a vector, draws) follows from them without the
matrix, whose size grows with the square of the measurements.

Residuals that follow each other in a recording are alike where something drifts slowly: temperature, a socket
that settles, an arm whose errors change slowly along a row of postures. n measurements with lag-1 correlation
rho then say as much as n / kappa independent ones, kappa = (1 + rho) / (1 - rho) (Bayley & Hammersley 1946,
for an autoregressive process of order 1).

A short recording hardly says how large rho is: its estimate reaches 1 by chance. So a correlation counts only
where its evidence, the marginal likelihood over a prior of rho, is a hundred times that of independent
errors; and then by the mean of 1 / kappa over the posterior of rho, which is what is left of the
information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from os.path import commonprefix
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
import scipy
from numpy.polynomial import chebyshev

from ...model.arrays import NORMAL_95, Index, Mask, Matrix
from ...model.likelihood.problem import Problem
from ...model.records import it, key, record
from ..covariance import root_of
from ..estimation.fit import LikelihoodFit
from ..left_over import by_targets


@dataclass(frozen=True, eq=False)
class Placement:
    """One placement: what it is called, its targets, and the places of its measurements in the problem."""

    name: str
    targets: tuple[str, ...]
    rows: Index


def placements(problem: Problem) -> tuple[Placement, ...]:
    """All placements with measurements, in the order of their first target; none of a run with a station,
    whose frame belongs to all.

    A placement of several targets is called by what their names begin with alike (`front` of `front_0` and
    `front_1`), by all of their names where that is nothing or names two.
    """
    if problem.stations:
        return ()
    label = np.arange(len(problem.targets))
    for tie in problem.ties:
        label[label == label[tie.second]] = label[tie.first]
    groups = [np.flatnonzero(label == k) for k in dict.fromkeys(label.tolist())]
    members = [tuple(problem.targets[i] for i in group) for group in groups]
    # names, not paths
    short = [
        commonprefix(names).rstrip("_-. ") if len(names) > 1 else names[0]  # noqa: RUF071
        for names in members
    ]
    return tuple(
        Placement(
            shared if shared and short.count(shared) == 1 else ", ".join(names),
            names,
            np.flatnonzero(np.isin(problem.target_index, group)),
        )
        for shared, names, group in zip(short, members, groups, strict=True)
        if np.isin(problem.target_index, group).any()
    )


_NOTHING = 1e-18  # a correlation below rounding
SIGNIFICANCE = 0.01  # p-value below which a correlation is used
_FEWEST = 4  # measurements of a recording with a correlation of its own
_LIMIT, _SOLVED = 0.98, 1e-12  # of a correlation, either way; of its share of the limit
_ANGLES = (np.arange(20) + 0.5) * np.pi / 20
_NODES = np.tanh(np.arctanh(_LIMIT) * np.cos(_ANGLES))  # Chebyshev's, of artanh rho / artanh of the limit
_SERIES = np.cos(np.arange(20)[:, None] * _ANGLES) * np.where(np.arange(20) > 0, 2, 1)[:, None] / 20
_WIDEST = 0.5  # half a 95 % interval of a correlation, from which on it is not determined
LARGE = 600  # residuals of a recording whose covariance is no longer written out
_LEFT = 1e-3  # of the variance of an error: a recording with less left of all its errors is not tested
_HALVINGS = 60  # of an interval, to the last digit
_ODDS = 100.0  # of a correlation against none, from which on it counts
_RHO = np.linspace(0.0, 0.98, 50)  # the first is none
_PRIOR = 1 - _RHO[1:]  # of the others: large ones are rare


_Rho = TypeVar("_Rho", float, Matrix)


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording: its target, its rows in the problem (n,), in the order of the file, the whitened
    residuals (n, d), their Jacobian (n d, f) by what is fitted, in posterior stds (B), and (n, d, 3) by the
    target's coordinates in mm; `active` (n, d) 1 for each component that was read, else 0."""

    target: str
    rows: Index
    residual: Matrix
    jacobian: Matrix
    by_target: Matrix
    active: Matrix

    @property
    def shots(self) -> int:
        return len(self.rows)

    @property
    def size(self) -> int:
        """How many components were read."""
        return int(self.active.sum())


@dataclass(frozen=True, eq=False)
class RecordingSet:
    """All recordings of a fit, and (f, f) the information of the priors, in posterior stds."""

    every: tuple[Recording, ...]
    prior: Matrix

    def shared(self, rho: float) -> Matrix:
        """(f, f) the covariance of B'r if errors within recordings have the correlation `rho`."""
        total = self.prior.copy()
        for recording in self.every:
            total += recording.jacobian.T @ times_errors(recording, rho)
        return total


def recording_rows(problem: Problem) -> list[Index]:
    """The places of the measurements of each recording, in the order of the file."""
    if not problem.shots:
        return []
    change = [i for i, (a, b) in enumerate(pairwise(problem.target_index.tolist()), start=1) if a != b]
    return [np.asarray(part) for part in np.split(np.arange(problem.shots), change)]


def recordings(fit: LikelihoodFit, rival: Matrix | None = None) -> RecordingSet:
    """The recordings of a fit, each measurement as it is (however often it counts), noise scale taken out.

    `rival` (M, g) are whitened columns of what the fit does not have but may explain the residuals too, times
    the prior stds of their parameters, such as link tolerances: they are fitted as well, by one linear step.
    """
    problem, d = fit.problem, fit.problem.tool.residual_size
    count = problem.shots * d
    scale, residual, columns, z = _linear_model(fit, rival)
    by_target = by_targets(problem, fit.whitened) * scale[:count].reshape(problem.shots, d, 1)
    # Not by the product columns' columns: with hardly any noise the unit prior would be lost in its rounding.
    inverse = np.linalg.inv(np.linalg.qr(np.vstack([columns, np.eye(len(z))]), mode="r")).T
    by_posterior = columns @ inverse.T
    if rival is not None:
        residual = residual - by_posterior @ (by_posterior.T @ residual + inverse @ z)
    residual = residual[:count].reshape(problem.shots, d)
    by_posterior = by_posterior[:count].reshape(problem.shots, d, -1)
    every = tuple(
        Recording(
            problem.targets[problem.target_index[rows[0]]],
            rows,
            residual[rows],
            by_posterior[rows].reshape(len(rows) * d, -1),
            by_target[rows],
            problem.active[rows],
        )
        for rows in recording_rows(problem)
    )
    return RecordingSet(every, inverse @ inverse.T)


def _linear_model(fit: LikelihoodFit, rival: Matrix | None) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """At the mode, each measurement as it is (however often it counts), noise scale taken out.

    The scale (M, 1) of rows that does so, residuals (M,), their columns (M, f) by the scaled parameters, and
    these (f,); those of `rival` with them, at 0.
    """
    problem = fit.problem
    count = problem.shots * problem.tool.residual_size
    scale = np.ones((len(fit.whitened.residual), 1))
    scale[:count, 0] = np.sqrt(np.repeat(fit.weight / problem.weights, problem.tool.residual_size))
    columns, z = (fit.whitened.jacobian * scale)[:, problem.parameters.free], fit.z
    if rival is not None:
        columns, z = np.hstack([columns, rival * scale]), np.append(z, np.zeros(rival.shape[1]))
    return scale, fit.whitened.residual * scale[:, 0], columns, z


def times_errors(recording: Recording, rho: float) -> Matrix:
    """(n d, f) R B of a recording: errors of variance 1, with the correlation rho^k k measurements apart."""
    if rho == 0:
        return recording.jacobian
    blocks = recording.jacobian.reshape(recording.shots, -1)
    both = _decaying(blocks, rho) + _decaying(blocks[::-1], rho)[::-1] - blocks
    return np.asarray(both.reshape(recording.jacobian.shape) * recording.active.reshape(-1, 1))


def _decaying(values: Matrix, rho: float) -> Matrix:
    """(n, …) the sums of rho^k times what is k before, over all k: by doubling."""
    total, lag, factor = values.copy(), 1, rho
    while lag < len(values) and abs(factor) > _NOTHING:
        total[lag:] += factor * total[:-lag]
        lag, factor = 2 * lag, factor**2
    return total


def traces(recording: Recording, rho: float, shared: Matrix) -> tuple[float, float]:
    """The traces of the covariance of a recording's residuals: of measurements with themselves, and with
    those that follow them. `shared` is that of all recordings at `rho`."""
    d, jacobian = recording.residual.shape[1], recording.jacobian
    by_errors, by_shared = times_errors(recording, rho), jacobian @ shared
    plain = recording.size - 2 * (jacobian * by_errors).sum() + (by_shared * jacobian).sum()
    following = float((recording.active[1:] * recording.active[:-1]).sum()) * rho
    following -= (jacobian[:-d] * by_errors[d:]).sum() + (by_errors[:-d] * jacobian[d:]).sum()
    following += (by_shared[:-d] * jacobian[d:]).sum()
    return float(plain), float(following)


def white_times(recording: Recording, shared: Matrix, vector: Matrix) -> Matrix:
    """(n d,) the covariance of a recording's residuals without correlation times a vector (n d,)."""
    along = recording.jacobian.T @ vector
    return np.asarray(vector + recording.jacobian @ (shared @ along - 2 * along))


def covariance(recording: Recording, rho: float, shared: Matrix) -> Matrix:
    """(n d, n d) of the residuals of a recording if errors have the correlation `rho`."""
    d = recording.residual.shape[1]
    apart = np.abs(np.subtract.outer(np.arange(recording.shots), np.arange(recording.shots)))
    errors = np.kron(np.eye(recording.shots) if rho == 0 else rho ** apart.astype(float), np.eye(d))
    errors *= np.outer(recording.active, recording.active)
    cross = recording.jacobian @ times_errors(recording, rho).T
    return np.asarray(
        errors - cross - cross.T + recording.jacobian @ shared @ recording.jacobian.T, dtype=float
    )


def drawn(recording: Recording, rho: float, shared: Matrix, count: int, rng: np.random.Generator) -> Matrix:
    """(count, n, d) residuals of a recording with that covariance, at random."""
    n, d = recording.residual.shape
    errors = rng.normal(size=(n, count, d))
    errors[1:] *= np.sqrt(1 - rho**2)
    errors = _decaying(errors, rho).transpose(1, 0, 2) * recording.active
    others = root_of(shared - recording.jacobian.T @ times_errors(recording, rho))
    along = (
        rng.normal(size=(count, len(others))) @ others.T - errors.reshape(count, n * d) @ recording.jacobian
    )
    return errors + (along @ recording.jacobian.T).reshape(count, n, d)


@record
class RecordedPart:
    """Measurements of one recording that follow each other."""

    target: Annotated[str, it("its name")]
    first_shot: Annotated[int, it("number of the first measurement")]
    last_shot: Annotated[int, it("number of the last")]
    shots: Annotated[int, it("how many")]


@record
class RecordingCorrelation(RecordedPart):
    """The correlation of the residuals that follow each other in a recording.

    `rho` is without the bias that the fit's
    residuals have, `kappa` what it makes of the number of measurements; None where they do not determine it
    (to half a unit, or within -0.98 to 0.98). `p_value` is the probability of a correlation as large if there
    is none (one-sided), None where a recording is too short.
    """

    rho: Annotated[
        float | None,
        it(
            "lag-1 correlation of the normalised residuals, without bias; null where the measurements do not"
            " determine it to ±0.5 with 95 %, or it is beyond ±0.98"
        ),
    ]
    kappa: Annotated[float | None, it("(1 + ρ) / (1 - ρ)")]
    p_value: Annotated[float | None, it("one-sided; null with fewer than four measurements")]


@record
class Effective:
    """The effective number of measurements, by the correlation of those that follow each other in a
    recording; of all together it is None as of one."""

    recordings: Annotated[tuple[RecordingCorrelation, ...], it("consecutive measurements of one target")]
    shots: Annotated[int, it("number of all measurements")]
    rho: Annotated[float | None, it("of all recordings together")]
    kappa: Annotated[float | None, it("likewise")]
    p_value: Annotated[float | None, it("likewise")]
    divisor: Annotated[float, it("1 without clear evidence of a correlation")]

    @property
    @key("`shots` / `divisor`: the effective number of measurements")
    def number(self) -> float:
        """How many independent measurements would say as much."""
        return self.shots / self.divisor


def effective(fit: LikelihoodFit, rival: Matrix | None = None) -> Effective:
    """The lag-1 correlations of the residuals at a mode, per recording and of all; `rival` as of
    `recordings`."""
    problem, numbers = fit.problem, fit.problem.shot_numbers
    every = recording_rows(problem)
    lags_of: dict[int, RecordingLag] = {}
    if fit.converged and any(len(rows_of) >= _FEWEST for rows_of in every):
        lags_of = lags(recordings(fit, rival))
    alone, rows = {i: correlation([lag]) for i, lag in lags_of.items()}, []
    for i, rows_of in enumerate(every):
        rho, p_value = alone.get(i, (None, None))
        kappa = None if rho is None else _kappa(rho)
        target, first, last = (
            problem.targets[problem.target_index[rows_of[0]]],
            numbers[rows_of[0]],
            numbers[rows_of[-1]],
        )
        rows.append(RecordingCorrelation(target, first, last, len(rows_of), rho, kappa, p_value))
    shots = problem.shots
    if not lags_of:
        return Effective(tuple(rows), shots, None, None, None, 1.0)
    if len(alone) == 1:
        ((rho, p_value),) = alone.values()
    else:
        rho, p_value = correlation(equalised(list(lags_of.values())))
    divisor = _divisor(fit, every, lags_of, rival) if p_value < SIGNIFICANCE else 1.0
    return Effective(tuple(rows), shots, rho, None if rho is None else _kappa(rho), p_value, divisor)


def _kappa(rho: _Rho) -> _Rho:
    return (1 + rho) / (1 - rho)


def _divisor(
    fit: LikelihoodFit, every: Sequence[Index], lags: Mapping[int, RecordingLag], rival: Matrix | None
) -> float:
    """The divisor of the measurements' information for the correlation of their errors: 1 / (the posterior
    mean of 1 / kappa), or 1 without clear evidence of a correlation. `every` has the rows of each recording,
    `lags` the sums of those that are long enough; `rival` as of `recordings`.

    The marginal likelihood is that of the linear model at the mode with all parameters by their priors,
    y = A z + e, and errors e of unknown size that are correlated within recordings.
    """
    _, residual, columns, z = _linear_model(fit, rival)
    rows = np.hstack([columns, (residual - columns @ z)[:, None]])
    d, active = fit.problem.tool.residual_size, fit.problem.active > 0
    ends = [(rows_of[0] * d, (rows_of[-1] + 1) * d) for rows_of in every]
    for i, louder in zip(lags, _louder(list(lags.values())), strict=True):
        rows[slice(*ends[i])] /= np.sqrt(louder)
    follows = np.zeros(len(rows), dtype=bool)
    for first, last in ends:
        read = active[first // d : last // d]
        follows[first + d : last] = (read[1:] & read[:-1]).ravel()
    count = len(rows) - int((~active).sum())
    log_evidence = np.array([_log_evidence(rows, follows, d, count, float(rho)) for rho in _RHO])
    # A long recording has odds beyond the largest number: their logarithms are compared.
    log_odds = np.log(_PRIOR / _PRIOR.sum()) + log_evidence[1:] - log_evidence[0]
    largest = float(log_odds.max())
    odds = np.exp(log_odds - largest)
    if largest + float(np.log(odds.sum())) < np.log(_ODDS):
        return 1.0
    return float(odds.sum() / (odds / _kappa(_RHO[1:])).sum())


def _log_evidence(rows: Matrix, follows: Mask, d: int, count: int, rho: float) -> float:
    """Of errors with the correlation `rho` within recordings; `rows` (M, f + 1) are columns and residuals, of
    which `count` were read, and those that `follows` (M,) marks follow the row d before them."""
    white, after = rows.copy(), np.flatnonzero(follows)
    white[after] = (rows[after] - rho * rows[after - d]) / np.sqrt(1 - rho**2)
    log_det = len(after) * float(np.log(1 - rho**2))
    columns, residual = white[:, :-1], white[:, -1]
    root = np.linalg.cholesky(columns.T @ columns + np.eye(columns.shape[1]))
    along = scipy.linalg.solve_triangular(root, columns.T @ residual, lower=True)
    square = max(float(residual @ residual - along @ along), 1e-300)
    return -(log_det + 2 * float(np.log(np.diag(root)).sum()) + count * float(np.log(square))) / 2


class RecordingLag(NamedTuple):
    """Of a recording: `product` the sum over its neighbours of the products of their residuals, `square` the
    sum of squares; `products` and `squares` (nodes,) what they are expected to be for a correlation rho, as
    Chebyshev series in artanh rho; `size` how many components were read. Of the covariance of the residuals
    without correlation: its
    trace `left`, that of neighbours as a share of it `bias`, and `forms`: `square` as a sum of chi-squares by
    its weights (n d,), `product` in the same errors by its matrix (n d, n d); None of a long recording."""

    shots: int
    product: float
    square: float
    products: Matrix
    squares: Matrix
    size: int
    left: float
    bias: float
    forms: tuple[Matrix, Matrix] | None


def lags(recorded: RecordingSet) -> dict[int, RecordingLag]:
    """The sums of the recordings that are long enough, by their index."""
    by_rho = [(rho, recorded.shared(rho)) for rho in _NODES.tolist()]
    none = recorded.shared(0.0)
    result = {}
    for i, recording in enumerate(recorded.every):
        d, residual = recording.residual.shape[1], recording.residual
        left, neighbours = traces(recording, 0.0, none)
        # A fit that takes up all errors leaves rounding.
        if recording.shots < _FEWEST or left < _LEFT * recording.size:
            continue
        squares, products = (_SERIES @ np.array([traces(recording, *at) for at in by_rho])).T
        result[i] = RecordingLag(
            recording.shots,
            float((residual[1:] * residual[:-1]).sum()),
            float((residual**2).sum()),
            products,
            squares,
            recording.size,
            left,
            neighbours / left,
            _forms(covariance(recording, 0.0, none), d) if recording.shots * d <= LARGE else None,
        )
    return result


def _forms(white: Matrix, d: int) -> tuple[Matrix, Matrix]:
    """Sum of squares and sum of products of neighbours (d apart) of normal residuals with that covariance, in
    independent errors: the weights of their squares, and a matrix."""
    values, vectors = np.linalg.eigh(white)
    values = np.maximum(values, 0.0)
    root = vectors * np.sqrt(values)
    half = root[d:].T @ root[:-d] / 2
    return values, np.asarray(half + half.T)


def equalised(lags: Sequence[RecordingLag]) -> list[RecordingLag]:
    """The same, with residuals larger than in the middle one of the recordings scaled down to its.

    A target that slips while it is measured makes large residuals that are all alike: by the plain sums that
    one recording would speak for all.
    """
    return [
        lag._replace(product=lag.product / by, square=lag.square / by)
        for lag, by in zip(lags, _louder(lags).tolist(), strict=True)
    ]


def _louder(lags: Sequence[RecordingLag]) -> Matrix:
    """How many times the mean squares of recordings are that of the middle one; 1 of those below."""
    mean_square = np.array([lag.square / lag.left for lag in lags])
    return np.maximum(mean_square / max(float(np.median(mean_square)), 1e-300), 1.0)


def correlation(lags: Sequence[RecordingLag]) -> tuple[float | None, float]:
    """The lag-1 correlation of some recordings together, None where they do not determine it, and the
    one-sided p-value of one as large without any.

    The correlation is the one for which the ratio of the expected sums is the ratio that was found: so the
    bias of residuals of a fit (about -1 / n for a mean alone) is out. Its 95 % interval is that of the ratio
    of independent errors. The p-value is that of a ratio of
    quadratic forms of normal errors, by the saddle point (Kuonen, Biometrika 86, 1999, eq. 3), and does not
    depend on the size of the noise.
    """
    ratio = _ratio(lags)
    weights = np.concatenate([_values(lag, ratio) for lag in lags])
    half = NORMAL_95 * float(np.sqrt(2 * (weights**2).sum())) / sum(lag.left for lag in lags)
    low, rho, high = (_solved(lags, ratio + apart) for apart in (-half, 0.0, half))
    # An interval that reaches a limit is as wide as the part of it that is seen, or wider.
    determined = high - low < 2 * _WIDEST and abs(rho) < _LIMIT
    return (rho if determined else None), _above_zero(weights)


def rho_of(lags: Sequence[RecordingLag]) -> float:
    """`correlation` without its p-value, at the limit where it is beyond."""
    return _solved(lags, _ratio(lags))


def _solved(lags: Sequence[RecordingLag], ratio: float) -> float:
    """The correlation for which the ratio of the expected sums is this one; the limit if it is beyond."""
    series = np.sum([lag.products - ratio * lag.squares for lag in lags], axis=0)
    slopes = chebyshev.chebder(series)
    for end in (-1.0, 1.0):
        if end * float(chebyshev.chebval(end, series)) <= 0:
            return end * _LIMIT
    low, high, share, step = -1.0, 1.0, 0.0, 1.0
    while abs(step) > _SOLVED:  # Newton's steps; where one leaves the interval that the root is in, bisection
        value, slope = (float(chebyshev.chebval(share, each)) for each in (series, slopes))
        low, high = (share, high) if value < 0 else (low, share)
        step = -value / (slope or 1.0)
        if not low < share + step < high:
            step = (low + high) / 2 - share
        share += step
    return float(np.tanh(np.arctanh(_LIMIT) * share))


def _ratio(lags: Sequence[RecordingLag]) -> float:
    return sum(lag.product for lag in lags) / max(sum(lag.square for lag in lags), 1e-300)


def _values(lag: RecordingLag, ratio: float) -> Matrix:
    """Weights of the chi-squares of which product - ratio * square is the sum."""
    if lag.forms is None:
        # Of a long recording: those of independent errors, shifted by the bias.
        angles = np.pi * np.arange(1, lag.shots + 1) / (lag.shots + 1)
        return np.repeat(np.cos(angles) - (ratio - lag.bias), max(1, round(lag.size / lag.shots)))
    squares, products = lag.forms
    return np.asarray(np.linalg.eigvalsh(products - ratio * np.diag(squares)))


def _above_zero(weights: Matrix) -> float:
    """The probability that a sum of chi-squares of one degree of freedom each, times `weights`, is above
    0."""
    scale = float(np.abs(weights).max(initial=0.0))
    if scale == 0.0:
        return 1.0
    weights = weights[np.abs(weights) > 1e-10 * scale] / scale
    if weights.min() > 0 or weights.max() < 0:
        return float(weights.min() > 0)
    low, high = 0.5 / weights.min(), 0.5 / weights.max()
    for _ in range(_HALVINGS):  # to where the slope, which rises all the way, is 0
        t = (low + high) / 2
        if (weights / (1 - 2 * t * weights)).sum() < 0:
            low = t
        else:
            high = t
    open_part = 1 - 2 * t * weights
    bend = float((2 * (weights / open_part) ** 2).sum())
    height = max(float(np.log(open_part).sum()), 0.0)
    w, v = np.sign(t) * np.sqrt(height), t * np.sqrt(bend)
    if abs(w) < 1e-4:
        skew = float(8 * (weights**3).sum()) / float(2 * (weights**2).sum()) ** 1.5
        return float(0.5 - skew / (6 * np.sqrt(2 * np.pi)))
    return float(scipy.special.ndtr(-(w + np.log(v / w) / w)))
