"""The answer of an analysis, as a value: what is known, how well, and what cannot be known.

Units are those that people read (degrees, millimetres), as in `result.json`. Whatever has no
answer is None, and every None has one stated meaning.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from .diagnostics.budget import Budget
from .diagnostics.scene import Scene

if TYPE_CHECKING:
    from .diagnostics.accuracy import Accuracy  # which needs this module

Status = Literal["identified", "weak", "unidentifiable", "held"]
Verdict = Literal["pass", "weak", "degenerate"]
Group = Literal["offset", "target", "tool", "noise"]


def versions() -> dict[str, str]:
    """Versions of what a result was computed with, by the library's name."""
    names = ("zerobeam", "numpy", "scipy", "casadi", "emcee", "arviz-stats")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}


@dataclass(frozen=True)
class ParameterResult:
    """One row of the answer.

    `estimate`, `std`, `interval95` are None where status is `unidentifiable` (the data cannot tell);
    for a `held` one `estimate` is the value it is held at, `std` None and `reason` says why.
    `data_std` is None for an exact gauge (infinite) and for held ones. `midpoint` is the paper's
    eq. 8 estimate, None where unidentifiable, held or not part of that fit.
    """

    name: str
    unit: str
    group: Group
    status: Status
    held: bool
    estimate: float | None
    std: float | None
    data_std: float | None
    interval95: tuple[float, float] | None
    prior_std: float
    midpoint: float | None
    reason: str | None


@dataclass(frozen=True)
class NullDirection:
    """A combination of parameters that the data do not tell, weights in prior stds, the largest ±1.

    `data_std` is how well the data alone tell it, in prior stds along it; None for an exact gauge.
    """

    combination: dict[str, float]
    kind: Literal["exact", "noise"]
    reason: str
    remedy: str
    data_std: float | None = None


@dataclass(frozen=True)
class Identifiability:
    """Rank facts of the whitened, prior-scaled Jacobian (section 2 of the design).

    `condition` is None where the matrix is singular; the observability indices are 0 there.
    """

    rank: int
    size: int
    condition: float | None
    observability: dict[str, float | None]
    null_space: tuple[NullDirection, ...]


@dataclass(frozen=True)
class FitSummary:
    """One fit; `reason` says in words why it stopped, `message` what a reader must know about it.

    `available` is False where the cost is not defined for these data (parallel beams, say).
    """

    available: bool
    converged: bool
    reason: str
    iterations: int
    cost: float | None
    rms_mm: float | None
    rms_before_mm: float | None
    chi2: float | None
    dof: int | None
    p_value: float | None
    noise_scale: float | None
    other_basins: int
    message: str | None


@dataclass(frozen=True)
class PosteriorParameter:
    """Summary of one parameter's draws. Where `source` is `prior` (the data cannot tell it) mean, std and
    quantiles are those of its own prior and nothing else; only the diagnostics are the draws'."""

    name: str
    unit: str
    source: Literal["data", "prior"]
    mean: float
    std: float
    q2_5: float
    q50: float
    q97_5: float
    ess_bulk: float
    ess_tail: float
    rhat: float
    mcse_mean: float


@dataclass(frozen=True)
class PosteriorSummary:
    """Diagnostics of the sampling; `parameters` is None unless it converged."""

    converged: bool
    message: str
    draws: int
    ensembles: int
    walkers: int
    ess_min: float | None
    rhat_max: float | None
    acceptance: float | None
    seconds: float
    parameters: tuple[PosteriorParameter, ...] | None


@dataclass(frozen=True)
class ShotResult:
    """One shot at the fit: `miss_mm` its miss (2 across the beam, or x, y, z), `whitened` the length
    of the miss in its own standard deviations, `leave_one_out` the miss length in mm as predicted by
    the other shots (None where they cannot predict it), `cooks` Cook's distance."""

    shot: int
    target: str
    miss_mm: tuple[float, ...]
    whitened: float
    leave_one_out: float | None
    cooks: float | None


@dataclass(frozen=True)
class DistanceResult:
    """A stated distance between two targets next to what the fit makes of it."""

    between: tuple[str, str]
    mm: float
    sigma_mm: float
    estimate: float | None
    std: float | None


@dataclass(frozen=True)
class Intervals:
    """The 95 % intervals of one parameter by three ways, where they differ or the parameter is weak.

    `linear` by the curvature at the mode (as `interval95` of the parameter), `profile` by the profile
    likelihood (None where an end was not found), `posterior` between the 2.5 % and 97.5 % quantiles of the
    draws (None without a posterior). `differ` where an end is off by a tenth of the width or more.
    """

    name: str
    unit: str
    linear: tuple[float, float]
    profile: tuple[float, float] | None
    posterior: tuple[float, float] | None
    differ: bool


@dataclass(frozen=True)
class RobustParameter:
    """One parameter of a robust fit; `std` and `interval95` are None without a sandwich covariance, all
    three where the data cannot tell the parameter."""

    name: str
    unit: str
    estimate: float | None
    std: float | None
    interval95: tuple[float, float] | None


@dataclass(frozen=True)
class Robust:
    """A fit in which a far miss weighs less: `loss` with its `tuning` (Huber's bend in stds, Student's nu),
    `weights` of the shots in their order, `outliers` the numbers of the shots too far off for chance."""

    loss: Literal["huber", "student"]
    tuning: float
    converged: bool
    reason: str
    noise_scale: float | None
    parameters: tuple[RobustParameter, ...]
    weights: tuple[float, ...]
    outliers: tuple[int, ...]
    message: str


@dataclass(frozen=True)
class HoldOut:
    """How the offsets and tool of the other targets' shots do at targets that they have not seen.

    `rms_mm` of the misses once each held-out target is placed, `rms_before_mm` the same without any offset,
    `expected_mm` what `rms_mm` would be by the noise and what the fit leaves open;
    chi-squared of these misses against the noise and what the fit leaves open. None where there is none.
    """

    targets: tuple[str, ...]
    shots: int
    shots_fitted: int
    rms_mm: float | None
    rms_before_mm: float | None
    expected_mm: float | None
    chi2: float | None
    dof: int | None
    p_value: float | None
    message: str | None


@dataclass(frozen=True)
class Inputs:
    """What the result was made from: enough to make it again."""

    run: str
    sha256: str
    robot: str
    shots: int
    targets: tuple[str, ...]
    seed: int
    versions: dict[str, str]
    header: dict[str, object]


@dataclass(frozen=True)
class Result:
    """The whole answer. `notes` are plain sentences that a reader must not miss, the gravest first."""

    verdict: Verdict
    headline: str
    parameters: tuple[ParameterResult, ...]
    identifiability: Identifiability
    likelihood: FitSummary
    midpoint: FitSummary
    posterior: PosteriorSummary
    shots: tuple[ShotResult, ...]
    distances: tuple[DistanceResult, ...]
    intervals: tuple[Intervals, ...]
    accuracy: Accuracy | None
    budget: tuple[Budget, ...]
    robust: Robust | None
    hold_out: HoldOut | None
    scene: Scene | None
    notes: tuple[str, ...]
    inputs: Inputs


@dataclass(frozen=True, eq=False)
class Draws:
    """Posterior draws in display units, `values` (ensembles, walkers, steps, parameters).

    `from_prior` marks the parameters of which the data say nothing; `converged` gates every use.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    from_prior: tuple[bool, ...]
    values: NDArray[np.float64]
    converged: bool
