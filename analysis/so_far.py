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
from .misfit import Misfit
from .observability.causes import NullDirection
from .observability.geometry import GeometryResult, geometry_result
from .solution import ParameterTable, Solution, judge
from .status import Verdict


@dataclass(frozen=True, eq=False)
class SoFar:
    """The answer after `shots` measurements.

    `x` (p,) is the mode, internal units, priors included. `offsets` are all of them: none is known where the
    fit did not converge, or while there are too few numbers to estimate the noise from (`judged` is then
    False). `dof` are the numbers to spare. `p_value` is that of residuals as large by the stated noise, None
    where the noise is estimated or no numbers are left to contradict it. `misfit` and `displaced` are None
    unless significant. `solution` is what all this was read off.
    """

    shots: int
    x: Matrix
    judged: bool
    verdict: Verdict
    offsets: ParameterTable
    null_space: tuple[NullDirection, ...]
    dof: int
    p_value: float | None
    misfit: Misfit | None
    displaced: Displacement | None
    solution: Solution

    def geometry(self, header: Header) -> GeometryResult:
        """What the offsets are worth if the geometry is not as it was taken."""
        fit = self.solution.fit
        return geometry_result(
            header, fit.problem, fit.x, fit.covariance, self.solution.status, weight=fit.weight
        )

    @property
    def std(self) -> dict[str, float | None]:
        """Of each offset that is not held, by name."""
        return {offset.name: offset.std for offset in self.offsets if not offset.held}

    @property
    def worst(self) -> float | None:
        """The largest std, None while any is."""
        stds = [value for value in self.std.values() if value is not None]
        return max(stds) if stds and len(stds) == len(self.std) else None

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
    x = problem.parameters.with_values(problem.nominal(), judged.parameters, solution.fit.x)
    return SoFar(
        shots=problem.shots,
        x=x,
        judged=solution.converged,
        verdict=solution.verdict,
        offsets=solution.offsets,
        null_space=solution.null_space,
        dof=solution.dof,
        p_value=solution.against_noise.p_value if solution.converged else None,
        misfit=solution.misfit,
        displaced=moved_target(solution),
        solution=solution,
    )
