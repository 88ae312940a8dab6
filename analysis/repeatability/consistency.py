"""How far runs scatter, and how far they should: the tests that `compare` asks of a sample of runs.

The mean of runs with covariances C_r is Aitken's, and the sum of squares about it, sum (x_r - m)' C_r^-1
(x_r - m), is chi-squared. Where the noise is estimated, C_r is known up to one factor that all runs tell
together, and what was chi-squared is F. Units are those that people read: degrees, millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ...model.robot import Matrix

Json = dict[str, Any]

LEVEL = 0.95
_EXACT = 1e-9  # a line that leaves less of the scatter than this share is one by rounding


def of_a_std(dof: int) -> Matrix:
    """(2,) by how much the ends of the interval of a std from `dof` degrees of freedom differ from it."""
    return np.asarray(np.sqrt(dof / stats.chi2.ppf([(1 + LEVEL) / 2, (1 - LEVEL) / 2], dof)))


@dataclass(frozen=True, eq=False)
class Common:
    """What runs have in common: `mean` (m,) with its `covariance`; their scatter about it, in squares of what
    is predicted, with its degrees of freedom."""

    mean: Matrix
    covariance: Matrix
    chi2: float
    dof: int


@dataclass(frozen=True, eq=False)
class Sample:
    """R runs of m offsets: `values` (R, m), nan where a run does not tell one; `at` (R,) hours or numbers.

    `covariances` (R, m, m) are what each run predicts, None where there is no prediction to rely on; their
    terms between offsets are known only if `joint`, and then every run tells every offset. `noise_dof` are
    the numbers that the noise is estimated from, if it is.
    """

    values: Matrix
    covariances: Matrix | None
    joint: bool
    noise_dof: int | None
    at: Matrix

    @cached_property
    def told(self) -> NDArray[np.bool_]:
        """(R, m)"""
        return np.isfinite(self.values)

    def offset(self, i: int) -> Sample:
        """One offset of those runs that tell it: then a variance is all there is to know."""
        rows = self.told[:, i]
        own = None if self.covariances is None else self.covariances[rows][:, i : i + 1, i : i + 1]
        return Sample(self.values[rows][:, i : i + 1], own, True, self.noise_dof, self.at[rows])

    def without(self, run: int) -> Sample:
        rows = np.arange(len(self.values)) != run
        own = None if self.covariances is None else self.covariances[rows]
        return Sample(self.values[rows], own, self.joint, self.noise_dof, self.at[rows])

    @cached_property
    def common(self) -> Common:
        """The mean weighted by the covariances (Aitken 1935), of runs that tell every offset."""
        assert self.covariances is not None
        precisions = np.linalg.inv(self.covariances)
        covariance = np.linalg.inv(precisions.sum(axis=0))
        mean = covariance @ np.einsum("rij,rj->i", precisions, self.values)
        off = self.values - mean
        chi2 = float(np.einsum("ri,rij,rj->", off, precisions, off))
        return Common(mean, covariance, chi2, off.size - mean.size)

    def p_value(self, chi2: float, dof: int) -> float:
        """The chance of a sum of squares as large as that, if all runs scatter as predicted."""
        if self.noise_dof is None:
            return float(stats.chi2.sf(chi2, dof))
        return float(stats.f.sf(chi2 / dof, dof, self.noise_dof))

    def ratio(self, common: Common) -> tuple[float, list[float]]:
        """Observed over predicted scatter, as stds, and the interval of the true one."""
        tails, dof = [(1 + LEVEL) / 2, (1 - LEVEL) / 2], common.dof
        if self.noise_dof is None:
            by_chance = stats.chi2.ppf(tails, dof) / dof
        else:
            by_chance = stats.f.ppf(tails, dof, self.noise_dof)
        square = common.chi2 / dof
        return float(np.sqrt(square)), np.sqrt(square / by_chance).tolist()

    @property
    def quantile(self) -> float:
        """Half width of an interval by the prediction, in stds."""
        tail = (1 + LEVEL) / 2
        return float(stats.norm.ppf(tail) if self.noise_dof is None else stats.t.ppf(tail, self.noise_dof))


def consistency(sample: Sample) -> Json | None:
    """All offsets of all runs against the prediction; None where there is no whole prediction."""
    if sample.covariances is None or not sample.joint:
        return None
    common, (ratio, interval) = sample.common, sample.ratio(sample.common)
    p_value = sample.p_value(common.chi2, common.dof)
    return {
        "chi2": common.chi2,
        "dof": common.dof,
        "noise_dof": sample.noise_dof,
        "p_value": p_value,
        "p_holm": p_value,
        "ratio": ratio,
        "ratio_interval95": interval,
    }


def one_offset(own: Sample) -> Json:
    """One offset over the runs that tell it, but for its mean; all null where it is not compared."""
    values = own.values[:, 0]
    row: Json = {
        "runs": len(values),
        **dict.fromkeys(("std", "std_interval95", "predicted_std", "ratio", "ratio_interval95")),
        **dict.fromkeys(("chi2", "dof", "p_value", "p_holm", "drift")),
    }
    if len(values) < 2:
        return row
    dof, std = len(values) - 1, float(values.std(ddof=1))
    row.update(std=std, std_interval95=(std * of_a_std(dof)).tolist(), drift=drift(own))
    if own.covariances is not None:
        ratio, interval = own.ratio(own.common)
        row.update(
            predicted_std=float(np.sqrt(own.covariances.mean())),
            ratio=ratio,
            ratio_interval95=interval,
            chi2=own.common.chi2,
            dof=dof,
            p_value=own.p_value(own.common.chi2, dof),
        )
    return row


def mean_of(sample: Sample, i: int, as_predicted: bool) -> Json:
    """The mean of offset i. Its interval is that of the prediction only where the runs scatter as predicted;
    else it is from their scatter (Student's t), about the plain mean."""
    values = sample.offset(i).values[:, 0]
    if len(values) < 2:
        return dict.fromkeys(("mean", "mean_interval95", "mean_by"))
    if as_predicted:
        common = (sample if sample.joint else sample.offset(i)).common
        k = i if sample.joint else 0
        mean, half = common.mean[k], sample.quantile * np.sqrt(common.covariance[k, k])
    else:
        mean, count = values.mean(), len(values)
        half = stats.t.ppf((1 + LEVEL) / 2, count - 1) * values.std(ddof=1) / np.sqrt(count)
    return {
        "mean": float(mean),
        "mean_interval95": [float(mean - half), float(mean + half)],
        "mean_by": "prediction" if as_predicted else "scatter",
    }


def drift(own: Sample) -> Json | None:
    """The slope over time, by weights where runs differ; its interval is from the scatter about the line
    (Student's t), so that it holds whatever was predicted. None for two runs, or without any scatter."""
    values, weight = own.values[:, 0], np.ones(len(own.values))
    if own.covariances is not None:
        weight = 1 / own.covariances[:, 0, 0]
    weight = weight / weight.sum()
    dof = len(values) - 2
    at = own.at - weight @ own.at
    spread = float(weight @ at**2)
    if dof < 1 or spread == 0:
        return None
    off = values - weight @ values
    slope = float(weight @ (at * off)) / spread
    rest = float(weight @ (off - slope * at) ** 2)
    if rest <= _EXACT**2 * float(weight @ values**2):
        return None
    std = float(np.sqrt(rest / dof / spread))
    half = float(stats.t.ppf((1 + LEVEL) / 2, dof)) * std
    return {
        "slope": slope,
        "interval95": [slope - half, slope + half],
        "dof": dof,
        "p_value": float(2 * stats.t.sf(abs(slope) / std, dof)),
    }


def against_others(sample: Sample, run: int) -> Json | None:
    """With all covariances: what the run adds to the sum of squares, which is its distance from the mean of
    the others in what is predicted of it. Else offset by offset, Bonferroni over them."""
    if len(sample.values) < 3:
        return None
    if sample.covariances is not None and sample.joint:
        rest = sample.without(run).common
        dof = sample.common.dof - rest.dof
        chi2 = max(sample.common.chi2 - rest.chi2, 0.0)
        return {"chi2": chi2, "dof": dof, "p_value": sample.p_value(chi2, dof)}
    chances = []
    for i in np.flatnonzero(sample.told[run]):
        own = sample.offset(int(i))
        place = int(sample.told[:run, i].sum())
        others = own.without(place)
        if own.covariances is not None:
            chances.append(own.p_value(max(own.common.chi2 - others.common.chi2, 0.0), 1))
        elif len(others.values) >= 2 and (std := float(others.values.std(ddof=1))) > 0:
            off = float(own.values[place, 0] - others.values.mean())
            t = abs(off) / (std * np.sqrt(1 + 1 / len(others.values)))
            chances.append(float(2 * stats.t.sf(t, len(others.values) - 1)))
    if not chances:
        return None
    return {"chi2": None, "dof": None, "p_value": min(1.0, len(chances) * min(chances))}


def holm(rows: list[Json]) -> list[Json]:
    """The rows with `p_holm`: their p-values, raised for being the least of so many (Holm 1979)."""
    raised = 0.0
    for k, row in enumerate(sorted(rows, key=lambda row: float(row["p_value"]))):
        raised = max(raised, min(1.0, (len(rows) - k) * row["p_value"]))
        row["p_holm"] = raised
    return rows
