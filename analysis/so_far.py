"""What the measurements so far determine, while more are being made: the offsets' standard uncertainties, and
whether all is consistent.

It follows from the measurements alone, so that a run that is resumed decides as one that was never
interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..model.arrays import Matrix
from ..model.files.header import Header
from ..model.likelihood.problem import Problem
from .answer.findings import Finding, moved_target
from .diagnostics.displacement import Displacement
from .estimation.fit import fit_likelihood
from .observability.geometry import GeometryResult, geometry_result
from .solution import Solution, judge


@dataclass(frozen=True, eq=False, kw_only=True)
class SoFar(Solution):
    """The solution of the measurements so far. It has not converged, and no offset is known, while there are
    too few numbers to estimate the noise from.

    `x` (p,) is the mode in the parameters of the problem as it was given, internal units, priors included.
    `displaced` is None unless significant.
    """

    x: Matrix
    displaced: Displacement | None

    def geometry(self, header: Header) -> GeometryResult:
        """What the offsets are worth if the geometry is not as it was taken."""
        fit = self.fit
        return geometry_result(header, fit.problem, fit.x, fit.covariance, self.status, weight=fit.weight)

    @property
    def p_value(self) -> float | None:
        """Of residuals as large by the stated noise; None where the noise is estimated or no degree of
        freedom is left to contradict it."""
        return self.against_noise.p_value if self.converged else None

    @property
    def offset_std(self) -> dict[str, float | None]:
        """Of each offset that is not held, by name."""
        return {offset.name: offset.std for offset in self.offsets if not offset.held}

    @property
    def worst(self) -> float | None:
        """The largest std of an offset, None while any is."""
        every = self.offset_std.values()
        stds = [value for value in every if value is not None]
        return max(stds) if stds and len(stds) == len(every) else None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings against the model."""
        criteria = () if self.misfit is None else self.misfit.criteria
        return criteria if self.displaced is None else (*criteria, self.displaced)

    @property
    def consistent(self) -> bool:
        """Nothing contradicts the model: no misfit, and no target has moved."""
        return not self.findings


def so_far(problem: Problem) -> SoFar:
    """What the measurements of `problem` (one at least) determine."""
    judged = problem
    if not problem.noise_estimable:
        # Nothing is known while the noise cannot be estimated; the stated one serves to aim the next posture.
        judged, _ = problem.with_noise_of(problem.nominal())
    solution = judge(fit_likelihood(judged), trusted=judged is problem)
    return SoFar(
        fit=solution.fit,
        identified=solution.identified,
        trusted=solution.trusted,
        x=problem.parameters.with_values(problem.nominal(), judged.parameters, solution.fit.x),
        displaced=moved_target(solution),
    )
