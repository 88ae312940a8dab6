"""What the shots so far tell, while more are being made: the offsets' stds, and whether all is consistent.

It follows from the shots alone, so that a run that is resumed decides as one that was never broken off.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import chdtrc

from ..model.problem import Problem
from ..model.robot import Matrix
from .displacement import Displacement, displacement
from .fit import fit_likelihood
from .identifiability import identify, no_better_than
from .notes import _LACK_OF_FIT as LACK_OF_FIT
from .result import Status


@dataclass(frozen=True, eq=False)
class SoFar:
    """The answer after `shots` shots.

    `x` (p,) is the mode, internal units, priors included. `std` (deg or mm) and `statuses` are of the offsets
    that are not held, by name. A std is None where the data cannot tell the offset, which is so of all where
    the fit did not converge, or while there are too few numbers to estimate the noise from. `worst` is the
    largest std, None while any is. `p_value` is the chance of misses as large as these by the stated noise,
    None where the noise is estimated or no numbers are left to contradict it. `displaced` is None unless a
    target seems to have moved.
    """

    shots: int
    x: Matrix
    std: dict[str, float | None]
    statuses: dict[str, Status]
    worst: float | None
    p_value: float | None
    displaced: Displacement | None

    @property
    def consistent(self) -> bool:
        """Nothing speaks against the model: no lack of fit, and no target has moved."""
        return (self.p_value is None or self.p_value >= LACK_OF_FIT) and self.displaced is None


def so_far(problem: Problem) -> SoFar:
    """What the shots of `problem` (one at least) tell."""
    parameters = problem.parameters
    judged = problem
    if not problem.noise.known and problem.data_size <= int(parameters.free.sum()):
        # Nothing is known while the noise cannot be estimated; the stated one serves to aim the next shot.
        judged, _ = problem.with_noise_of(problem.supposed())
    fit = fit_likelihood(judged, starts=0)
    told = fit.converged and judged is problem
    identified = identify(judged, fit.x, fit.weight)
    spread = judged.parameters.unscaled(fit.std)
    status = no_better_than(judged, identified, spread).status
    offsets = [i for i, item in enumerate(parameters.items) if item.group == "offset" and not item.held]
    statuses = {parameters.names[i]: status[i] if told else "unidentifiable" for i in offsets}
    std = {
        parameters.names[i]: float(spread[i] * parameters.display[i])
        if statuses[parameters.names[i]] != "unidentifiable"
        else None
        for i in offsets
    }
    known = [value for value in std.values() if value is not None]
    moved = displacement(fit) if told else None
    dof = problem.data_size - identified.facts.rank
    chi2 = float(fit.whitened.residual @ fit.whitened.residual)
    x = problem.supposed()
    x[: len(fit.x)] = fit.x
    return SoFar(
        shots=problem.shots,
        x=x,
        std=std,
        statuses=statuses,
        worst=max(known) if known and len(known) == len(std) else None,
        p_value=float(chdtrc(dof, chi2)) if told and dof > 0 and problem.noise.known else None,
        displaced=moved if moved is not None and moved.significant else None,
    )
