"""What the shots so far tell, while more are being made: the offsets' stds, and whether all is consistent.

It follows from the shots alone, so that a run that is resumed decides as one that was never broken off.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..model.problem import Problem
from ..model.robot import Matrix
from .diagnostics.displacement import Displacement, displacement, displacement_sentence
from .diagnostics.notes import LACK_OF_FIT
from .estimation.fit import LikelihoodFit, fit_likelihood
from .observability.identifiability import Identified, identify_at
from .observability.verdict import verdict, verdict_sentence
from .result import Status, Verdict


@dataclass(frozen=True)
class OffsetSoFar:
    """What is known of an offset, deg or mm. A held one's `estimate` is the value it is held at; one that the
    data cannot tell has neither estimate nor std."""

    name: str
    unit: str
    status: Status
    estimate: float | None
    std: float | None


@dataclass(frozen=True, eq=False)
class SoFar:
    """The answer after `shots` shots.

    `x` (p,) is the mode, internal units, priors included. `offsets` are all of them: none is told where the
    fit did not converge, or while there are too few numbers to estimate the noise from. `dof` are the numbers
    to spare. `p_value` is the chance of misses as large as these by the stated noise, None where the noise is
    estimated or no numbers are left to contradict it. `displaced` is None unless a target seems to have
    moved. `headline` is the verdict in words.
    """

    shots: int
    x: Matrix
    verdict: Verdict
    headline: str
    offsets: tuple[OffsetSoFar, ...]
    dof: int
    p_value: float | None
    displaced: Displacement | None

    @property
    def std(self) -> dict[str, float | None]:
        """Of each offset that is not held, by name."""
        return {offset.name: offset.std for offset in self.offsets if offset.status != "held"}

    @property
    def worst(self) -> float | None:
        """The largest std, None while any is."""
        told = [value for value in self.std.values() if value is not None]
        return max(told) if told and len(told) == len(self.std) else None

    @property
    def consistent(self) -> bool:
        """Nothing speaks against the model: no lack of fit, and no target has moved."""
        return (self.p_value is None or self.p_value >= LACK_OF_FIT) and self.displaced is None

    @property
    def notes(self) -> tuple[str, ...]:
        """What speaks against the model, in sentences."""
        told = []
        if self.p_value is not None and self.p_value < LACK_OF_FIT:
            told.append(
                f"Lack of fit: by the stated noise misses are as large as these with a chance of"
                f" {self.p_value:.0e}. The arm is not quite as drawn, a shot or the target is off, or the"
                " noise is understated: no estimate or std can be relied on"
            )
        return (*told, *(() if self.displaced is None else (displacement_sentence(self.displaced),)))


def so_far(problem: Problem) -> SoFar:
    """What the shots of `problem` (one at least) tell."""
    judged = problem
    if not problem.tells_noise:
        # Nothing is known while the noise cannot be estimated; the stated one serves to aim the next shot.
        judged, _ = problem.with_noise_of(problem.supposed())
    fit = fit_likelihood(judged, starts=0)
    told = fit.converged and judged is problem
    identified = identify_at(fit)
    moved = displacement(fit) if told else None
    _, dof, p_value = fit.against_noise(identified.facts.rank)
    x = problem.parameters.with_values(problem.supposed(), judged.parameters, fit.x)
    return SoFar(
        shots=problem.shots,
        x=x,
        verdict=verdict(problem, identified) if told else "degenerate",
        headline=verdict_sentence(problem, identified) if told else "These shots tell no offset yet.",
        offsets=tuple(_offsets(judged, fit, identified, told)),
        dof=dof,
        p_value=p_value if told else None,
        displaced=moved if moved is not None and moved.significant else None,
    )


def _offsets(
    problem: Problem, fit: LikelihoodFit, identified: Identified, told: bool
) -> Iterator[OffsetSoFar]:
    parameters = problem.parameters
    spread = parameters.unscaled(fit.std) * parameters.display
    for i, item in enumerate(parameters.items):
        if item.group != "offset":
            continue
        # As in a result: a fit that did not converge leaves nothing that could be called identified.
        status: Status = identified.status[i] if told or item.held else "unidentifiable"
        known = status in ("identified", "weak")
        estimate = float(fit.x[i] * item.display) if known or item.held else None
        yield OffsetSoFar(item.name, item.unit, status, estimate, float(spread[i]) if known else None)
