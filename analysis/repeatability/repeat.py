"""One run as `compare` takes it: its offsets without any prior, wherever they are from.

Units are those that people read: degrees, millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ...model.arrays import Matrix
from ..answer.findings import FileWarning, OtherBasins
from ..misfit import Criterion
from ..status import RepeatStatus

WHEN = "when"  # the key of a header's provenance that says when a run was made
Kind = Literal["runs", "results", "table"]
# `prior`: a prior has a part in it. `stated`, `not stated`: of a table.


@dataclass(frozen=True)
class SharedDistances:
    """The run states distances or angles between targets, whose errors other runs may share."""


@dataclass(frozen=True)
class SharedTolerances:
    """The run frees the geometry, of which other runs of the arm have the same deviations."""


@dataclass(frozen=True)
class PriorInEstimate:
    """A prior has a part in an estimate of a result, which does not say how to take it out."""

    name: str


@dataclass(frozen=True)
class StatedMisfit:
    """A result file says that the model does not describe the run: its own sentence."""

    sentence: str


RunFinding = (
    Criterion
    | StatedMisfit
    | OtherBasins
    | SharedDistances
    | SharedTolerances
    | PriorInEstimate
    | FileWarning
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Repeat:
    """One run: what its measurements say of the free offsets `names` (m,).

    `value` (m,) and `covariance` (m, m) are nan where the run does not determine the offset; the covariance
    is by the noise at noise scale 1, None without a prediction, and has variances alone unless `joint`.
    `by_geometry` (m, g) is what each of the freed geometry parameters `geometry` adds to the offsets if it is
    one tolerance off: the same in all runs of the arm. `noise_dof`
    is None where the noise is known, else the degrees of freedom that `noise_scale` is estimated from. `held`
    are the other offsets. `failure` is why the fit did not converge, None if it did.
    """

    name: str
    sha256: str | None
    robot: str | None = None
    shots: int | None = None
    when: str | None = None
    names: tuple[str, ...]
    units: tuple[str, ...]
    held: tuple[str, ...] = ()
    status: tuple[RepeatStatus, ...]
    value: Matrix
    covariance: Matrix | None = None
    by_geometry: Matrix
    geometry: tuple[str, ...] = ()
    joint: bool
    noise_scale: float = 1.0
    noise_dof: int | None = None
    findings: tuple[RunFinding, ...] = ()
    failure: str | None = None

    @property
    def misfit(self) -> bool:
        """Whether the model does not describe the run."""
        return "unvalidated" in self.status or any(
            isinstance(finding, Criterion | StatedMisfit) for finding in self.findings
        )
