"""The scatter of runs against the predicted: the tests that `compare` makes of a sample of runs.

The mean of runs with covariances C_r is Aitken's, and the sum of squares about it, sum (x_r - m)' C_r^-1
(x_r - m), is chi-squared. What the geometry of the arm adds, K_r g with one unknown g ~ N(0, 1) for all runs,
is estimated with the mean: x_r - m - K_r g in place of x_r - m, and g'g added to the sum. Where the noise is
estimated, C_r is known up to one factor common to all runs, and what was chi-squared is F. Units are those
that people read: degrees, millimetres.

A prior pulls every estimate of a weakly observable offset to the same place, and so makes runs agree that do
not: the offsets of each run are taken without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import numpy as np
from scipy import special

from ...model.arrays import NORMAL_95, Mask, Matrix
from ...model.likelihood.density import Density
from ...model.records import it, record
from ..covariance import OffsetsWithoutPrior
from ..estimation.fit import LikelihoodFit
from ..observability.gauges import ROUNDING, information_root
from ..solution import Solution


class WithoutPrior(NamedTuple):
    """Parameters without any prior, internal units: `value` (m,), `covariance` (m, m) by the noise alone at
    noise scale 1, and `by_geometry` (m, g) what each geometry parameter adds, if it is one tolerance off."""

    value: Matrix
    covariance: Matrix
    by_geometry: Matrix


def without_prior(fit: LikelihoodFit, columns: Sequence[int]) -> WithoutPrior:
    """The parameters `columns` by measurements, distances and tolerances of the geometry, without any prior.
    They must be identifiable (or weakly so).

    At the mode the gradient of the log-likelihood is the negative of the log-prior's, which is z: one Newton
    step of the likelihood alone takes the prior out (exact for a linear problem). All other unknowns are
    eliminated (Schur complement), so that they may be unidentifiable. The rows of the least squares are those
    of the noise, then those of the tolerances: so are the columns of its pseudo-inverse.
    """
    problem, parameters = fit.problem, fit.problem.parameters
    _, root, _ = information_root(problem, fit.x, fit.weight)
    selected = parameters.among_free[list(columns)]
    rest = np.setdiff1d(np.arange(root.shape[1]), selected)
    length = np.linalg.norm(root[:, rest], axis=0)
    length[length == 0] = 1.0
    by_rest = np.linalg.lstsq(root[:, rest] / length, root[:, selected], rcond=ROUNDING)[0] / length[:, None]
    left = root[:, selected] - root[:, rest] @ by_rest
    covariance = np.linalg.inv(left.T @ left)
    by_row = covariance @ left.T
    by_noise, by_geometry = np.split(by_row, [len(left) - len(problem.tolerated)], axis=1)
    # A tolerance of the geometry is knowledge, which stays.
    pulled = np.where(parameters.tolerated[parameters.free], 0.0, fit.z)
    at_mode = float(Density(problem).noise_weight(fit.x[None])[0])
    step = covariance @ (pulled[selected] - by_rest.T @ pulled[rest]) * fit.weight / at_mode
    scale = parameters.prior_std[list(columns)]
    noise = fit.weight * np.asarray(by_noise @ by_noise.T)
    return WithoutPrior(
        fit.x[list(columns)] + step * scale, noise * np.outer(scale, scale), by_geometry * scale[:, None]
    )


def offsets_without_prior(solution: Solution) -> OffsetsWithoutPrior | None:
    """The offsets that the measurements determine, without any prior; None where there is none."""
    problem, parameters = solution.problem, solution.problem.parameters
    indices = range(*parameters.block("offset").indices(len(parameters)))
    columns = [column for column in indices if column in solution.known]
    if not columns:
        return None
    free_of_prior, display = without_prior(solution.fit, columns), parameters.display[columns]
    covariance = free_of_prior.covariance * np.outer(display, display) * solution.noise_scale**2
    return OffsetsWithoutPrior(
        names=tuple(parameters.names[column] for column in columns),
        units=tuple(parameters.items[column].unit for column in columns),
        status=tuple(solution.status[column] for column in columns),
        values=tuple((free_of_prior.value * display).tolist()),
        covariance=tuple(map(tuple, covariance.tolist())),
        geometry=tuple(parameters.names[column] for column in problem.tolerated),
        by_geometry=tuple(map(tuple, (free_of_prior.by_geometry * display[:, None]).tolist())),
        dof=None if problem.noise.known else max(solution.dof, 1),
    )


Interval = tuple[float, float]

LEVEL = 0.95
_EXACT = 1e-9  # a line that leaves less of the scatter than this share is one by rounding


def of_a_std(dof: int) -> Interval:
    """The ends of the 95 % interval of a std from `dof` degrees of freedom, over that std (chi-squared)."""
    low, high = np.sqrt(dof / (2 * special.gammaincinv(dof / 2, [(1 + LEVEL) / 2, (1 - LEVEL) / 2])))
    return float(low), float(high)


@record
class Consistency:
    """Observed against predicted scatter: the sum of squares `chi2` in what is predicted, `ratio` of the stds
    and its 95 % interval. `noise_dof` are the degrees of freedom of an estimated noise, None if it is known.

    Here and below `p_holm` is the p-value adjusted for the number of questions of one kind (Holm).
    """

    chi2: Annotated[float, it("of the test")]
    dof: Annotated[int, it("degrees of freedom")]
    noise_dof: Annotated[int | None, it("degrees of freedom of an estimated noise; null if known")]
    p_value: Annotated[float, it("of the test")]
    p_holm: Annotated[float, it("adjusted for the number of offsets")]
    ratio: Annotated[float, it("observed over predicted scatter")]
    ratio_interval95: Annotated[Interval, it("of the ratio")]


@record
class Scatter:
    """The std of a run by the scatter of the runs, with the 95 % interval of the true one."""

    std: Annotated[float, it("standard deviation of a run, by the scatter")]
    interval95: Annotated[Interval, it("of the true standard deviation (χ²)")]


@record
class Mean:
    """The mean over the runs; its 95 % interval is `by` the prediction or by the scatter."""

    value: Annotated[float, it("over the runs")]
    interval95: Annotated[Interval, it("95 % interval of the mean")]
    by: Annotated[Literal["prediction", "scatter"], it("the source of the mean's interval")]


@record
class RunDrift:
    """The slope over the runs (a unit of `at`) with its 95 % interval, and the p-value of one as large."""

    slope: float
    interval95: Interval
    dof: int
    p_value: float
    p_holm: float


@record
class AgainstOthers:
    """One run against all others; `chi2` and `dof` are None without covariances."""

    chi2: float | None
    dof: int | None
    p_value: float
    p_holm: float


@dataclass(frozen=True, eq=False)
class CommonMean:
    """The common `mean` (m,) of runs with its `covariance`; their scatter about it, in squares of what is
    predicted, with its degrees of freedom."""

    mean: Matrix
    covariance: Matrix
    chi2: float
    dof: int


@dataclass(frozen=True, eq=False)
class RunSample:
    """R runs of m offsets: `values` (R, m), nan where a run does not determine one; `at` (R,) hours or
    numbers.

    `covariances` (R, m, m) are what each run predicts by its noise, None where there is no prediction to rely
    on; their terms between offsets are known only if `joint`, and then every run determines every offset.
    `noise_dof` are the degrees of freedom of an estimated noise, None if it is known. `by_geometry` (R, m, g)
    is what deviations of the arm add to each run, all by the same g unit normal numbers.
    """

    values: Matrix
    covariances: Matrix | None
    joint: bool
    noise_dof: int | None
    at: Matrix
    by_geometry: Matrix

    @cached_property
    def determined(self) -> Mask:
        """(R, m) whether a run determines an offset."""
        return np.isfinite(self.values)

    def offset(self, i: int) -> RunSample:
        """One offset of those runs that determine it: then a variance is all there is to know."""
        rows = self.determined[:, i]
        covariances = None if self.covariances is None else self.covariances[rows][:, i : i + 1, i : i + 1]
        by_geometry = self.by_geometry[rows][:, i : i + 1]
        return RunSample(
            self.values[rows][:, i : i + 1], covariances, True, self.noise_dof, self.at[rows], by_geometry
        )

    def without(self, run: int) -> RunSample:
        """All runs but one, by its place."""
        rows = np.arange(len(self.values)) != run
        covariances = None if self.covariances is None else self.covariances[rows]
        by_geometry = self.by_geometry[rows]
        return RunSample(
            self.values[rows], covariances, self.joint, self.noise_dof, self.at[rows], by_geometry
        )

    @cached_property
    def common(self) -> CommonMean:
        """The mean weighted by the covariances (Aitken 1935), of runs that determine every offset."""
        assert self.covariances is not None
        count, size, deviations = self.by_geometry.shape
        design = np.concatenate([np.tile(np.eye(size), (count, 1, 1)), self.by_geometry], axis=2)
        precisions = np.linalg.inv(self.covariances)
        information = np.einsum("rik,rij,rjl->kl", design, precisions, design, optimize=True)
        information[size:, size:] += np.eye(deviations)
        covariance = np.linalg.inv(information)
        both = covariance @ np.einsum("rik,rij,rj->k", design, precisions, self.values, optimize=True)
        off = self.values - design @ both
        chi2 = float(np.einsum("ri,rij,rj->", off, precisions, off) + (both[size:] ** 2).sum())
        return CommonMean(both[:size], covariance[:size, :size], chi2, off.size - size)

    def p_value(self, chi2: float, dof: int) -> float:
        """The p-value of a sum of squares, if all runs scatter as predicted."""
        if self.noise_dof is None:
            return float(special.chdtrc(dof, chi2))
        return float(special.fdtrc(dof, self.noise_dof, chi2 / dof))

    @property
    def predicted_std(self) -> float:
        """Root mean square of the stds that are predicted of the scatter, of one offset or all."""
        assert self.covariances is not None
        return float(np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2).mean()))

    @property
    def quantile(self) -> float:
        """Coverage factor of an interval by the prediction."""
        return (
            NORMAL_95 if self.noise_dof is None else float(special.stdtrit(self.noise_dof, (1 + LEVEL) / 2))
        )


def consistency(sample: RunSample) -> Consistency | None:
    """All offsets of a sample against the prediction; None where there is no whole prediction."""
    if sample.covariances is None or not sample.joint:
        return None
    common, tails, dof = sample.common, [(1 + LEVEL) / 2, (1 - LEVEL) / 2], sample.common.dof
    if sample.noise_dof is None:
        expected = 2 * special.gammaincinv(dof / 2, tails) / dof
    else:
        expected = special.fdtri(dof, sample.noise_dof, tails)
    square = common.chi2 / dof
    low, high = np.sqrt(square / expected)
    p_value, ratio = sample.p_value(common.chi2, dof), float(np.sqrt(square))
    interval = (float(low), float(high))
    return Consistency(common.chi2, dof, sample.noise_dof, p_value, p_value, ratio, interval)


def scatter(sample: RunSample) -> Scatter | None:
    """How far one offset scatters; None for fewer than two runs."""
    values = sample.values[:, 0]
    if len(values) < 2:
        return None
    std, (low, high) = float(values.std(ddof=1)), of_a_std(len(values) - 1)
    return Scatter(std, (std * low, std * high))


def mean_of(sample: RunSample, i: int, as_predicted: bool) -> Mean | None:
    """The mean of offset i, None where it is not compared. Its interval is that of the prediction only where
    the runs scatter as predicted; else it is from their scatter (Student's t), about the plain mean."""
    of_offset = sample.offset(i)
    values = of_offset.values[:, 0]
    if len(values) < 2:
        return None
    if as_predicted:
        common = (sample if sample.joint else of_offset).common
        k = i if sample.joint else 0
        mean, half = float(common.mean[k]), float(sample.quantile * np.sqrt(common.covariance[k, k]))
        return Mean(mean, (mean - half, mean + half), "prediction")
    mean, count = float(values.mean()), len(values)
    half = float(special.stdtrit(count - 1, (1 + LEVEL) / 2) * values.std(ddof=1) / np.sqrt(count))
    # What the arm's deviations add to all runs alike is not in their scatter.
    shared = float(np.linalg.norm(of_offset.by_geometry[:, 0].mean(axis=0)))
    half = float(np.hypot(half, NORMAL_95 * shared))
    return Mean(mean, (mean - half, mean + half), "scatter")


def drift(sample: RunSample) -> RunDrift | None:
    """The slope over time of one offset, by weights where runs differ; its interval is from the scatter about
    the line (Student's t), so that it holds whatever was predicted. None for two runs, or without scatter."""
    values, weight, dof = sample.values[:, 0], np.ones(len(sample.values)), len(sample.values) - 2
    if dof < 1:
        return None
    if sample.covariances is not None:
        weight = 1 / sample.covariances[:, 0, 0]
    weight = weight / weight.sum()
    at = sample.at - weight @ sample.at
    spread = float(weight @ at**2)
    if spread == 0:
        return None
    off = values - weight @ values
    slope = float(weight @ (at * off)) / spread
    rest = float(weight @ (off - slope * at) ** 2)
    if rest <= _EXACT**2 * float(weight @ values**2):
        return None
    std = float(np.sqrt(rest / dof / spread))
    half = float(special.stdtrit(dof, (1 + LEVEL) / 2)) * std
    p_value = float(2 * special.stdtr(dof, -abs(slope) / std))
    return RunDrift(slope, (slope - half, slope + half), dof, p_value, p_value)


def against_others(sample: RunSample, run: int) -> AgainstOthers | None:
    """With all covariances: what the run adds to the sum of squares, which is its distance from the mean of
    the others in what is predicted of it. Else offset by offset, Bonferroni over them."""
    if len(sample.values) < 3:
        return None
    if sample.covariances is not None and sample.joint:
        rest = sample.without(run).common
        dof = sample.common.dof - rest.dof
        chi2 = max(sample.common.chi2 - rest.chi2, 0.0)
        p_value = sample.p_value(chi2, dof)
        return AgainstOthers(chi2, dof, p_value, p_value)
    p_values = []
    for i in np.flatnonzero(sample.determined[run]):
        of_offset = sample.offset(int(i))
        row = int(sample.determined[:run, i].sum())
        others = of_offset.without(row)
        if of_offset.covariances is not None:
            p_values.append(of_offset.p_value(max(of_offset.common.chi2 - others.common.chi2, 0.0), 1))
        elif len(others.values) >= 2 and (std := float(others.values.std(ddof=1))) > 0:
            off = float(of_offset.values[row, 0] - others.values.mean())
            t = abs(off) / (std * np.sqrt(1 + 1 / len(others.values)))
            p_values.append(float(2 * special.stdtr(len(others.values) - 1, -t)))
    if not p_values:
        return None
    p_value = min(1.0, len(p_values) * min(p_values))
    return AgainstOthers(None, None, p_value, p_value)
