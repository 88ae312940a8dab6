"""The one owner of an answer: fit, identifiability, statuses, standard uncertainties, covariance.

    problem -> fit -> identified -> Solution

`analyse`, `so_far`, the exporters and `compare` ask it, and so do the studies that check them. Inside, values
are rad and mm; rows and covariances are in the units that people read. What the data do not determine has no
number here.

Several local optima may explain the data about as well. The curvature at one knows nothing of another: its
standard uncertainty would be that of one of several answers. What differs between them is unidentifiable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..model.arrays import Matrix
from ..model.errors import BadInput, UnsoundResult
from ..model.files.header import Header
from ..model.likelihood.parameters import Parameter
from ..model.likelihood.problem import Problem
from ..model.records import internal, it, record, worded
from .covariance import Covariance, Rows, ValuesByName, frame
from .estimation.fit import (
    AgainstNoise,
    LikelihoodFit,
    Optimum,
    effective_dof,
    fit_likelihood,
    student_half_width,
)
from .estimation.tolerance_factors import Factors
from .misfit import Criterion, Misfit, misfit_of
from .observability.causes import AtOptima, JudgedRow, LocalOptima, NullDirection, Unconverged
from .observability.changes import Displacement, displacement
from .observability.geometry_result import (
    GeometryResult,
    Rung,
    geometry_result,
    link_columns,
    tolerance_share,
)
from .observability.identifiability import Identifiability, Identified, identify, no_better_than
from .observability.power import DetectionPower, powers
from .observability.remedies import RemedySearch
from .recordings.recordings import Effective
from .recordings.steps import RecordingSteps, resting_columns, steps
from .row import ParameterRow
from .status import Status, Verdict, has_numbers, verdict_of, with_misfit

if TYPE_CHECKING:
    import pandas as pd


# If the other optimum is the true one, noise makes the best one a thousand times as probable with a chance of
# one in a thousand at most (the mean of a likelihood ratio is 1): the level of every test of a fit.
EQUALLY_GOOD = float(np.log(1000.0))


@record(needed=("name", "unit", "status", "estimate", "std", "interval95", "group"), repr=False, kw_only=True)
class ParameterResult(JudgedRow, ParameterRow):
    """One row of the answer; `dof` are the effective degrees of freedom of `std`, infinite of known noise."""

    claims = (*ParameterRow.claims, "midpoint", "tolerance_share")

    midpoint: Annotated[
        float | None,
        it("the paper's fit; null if unidentifiable or held, if that fit failed, and of a noise factor"),
    ]
    trusted: Annotated[
        str | None, worded("why the offset can be trusted or not, in a few words: of the first page")
    ] = None
    dof: Annotated[float, internal] = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_whole()
        if self.held and (self.estimate is None or (self.cause is None and self.reason is None)):
            raise UnsoundResult(f"{self.name!r} is held without the value that it is held at or the cause")

    @property
    def absent(self) -> tuple[str, ...]:
        """Keys that only the row of an offset has, `trusted` in a result."""
        words = () if self.trusted else ("trusted",)
        return words if self.group == "offset" else ("tolerance_share", *words)

    def interval(self, level: float = 0.95) -> tuple[float, float] | None:
        """The central interval that holds `level` of the probability, such as 0.68, by the curvature.

        None where the data do not determine the parameter. BadInput unless 0 < level < 1.
        """
        require_level(level)
        if self.estimate is None or self.std is None:
            return None
        half = float(student_half_width(np.array(self.dof), level)) * self.std
        if self.group == "noise":  # log-normal
            factor = math.exp(half / self.estimate)
            return self.estimate / factor, self.estimate * factor
        return self.estimate - half, self.estimate + half


def require_level(level: object) -> None:
    """BadInput where `level` is no probability between 0 and 1."""
    if isinstance(level, bool) or not isinstance(level, Real) or not 0 < float(level) < 1:
        raise BadInput(
            "this is no level of an interval",
            found=repr(level),
            allowed="a probability between 0 and 1, such as 0.68 or 0.95",
            argument="level",
        )


class ParameterTable(Rows[ParameterResult]):
    """Rows of an answer, by their order or by name, and as a pandas table."""

    __slots__ = ()

    def to_frame(self) -> pd.DataFrame:
        """A pandas DataFrame: a row for each parameter, by its name.

        Columns are unit, status, estimate, u (standard uncertainty), low95 and high95 (95 % interval), in the
        unit of the row; nan where the data determine nothing. BadInput without pandas.
        """
        rows = [
            {
                "name": row.name,
                "unit": row.unit,
                "status": row.status,
                "estimate": row.estimate,
                "u": row.std,
                "low95": row.interval95[0] if row.interval95 else None,
                "high95": row.interval95[1] if row.interval95 else None,
            }
            for row in self
        ]
        numbers = ["estimate", "u", "low95", "high95"]
        return frame(rows).set_index("name").astype(dict.fromkeys(numbers, float))


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit, judged: what the data determine, with its uncertainty, and what they do not.

    Attributes
    ----------
    fit : LikelihoodFit
        The mode and its curvature.
    identified : Identified
        What the data determine at the mode.
    trusted : bool
        False where the noise that the fit took as known is not (more measurements are needed to estimate it):
        nothing is then called known.
    effective : Effective or None
        The effective number of measurements by which it weighs them; None of a fit that was judged alone.
    ladder : tuple of Rung
        The models that were tried; none for nominal geometry.
    factors : Factors or None
        By what the data multiply the tolerances; None where they are known.

    Examples
    --------
    `zerobeam.analyse` gives one:

    >>> import zerobeam as zb
    >>> issubclass(zb.Analysed, zb.Solution)
    True
    """

    fit: LikelihoodFit
    identified: Identified
    trusted: bool = True
    effective: Effective | None = None
    ladder: tuple[Rung, ...] = ()
    factors: Factors | None = None

    @property
    def problem(self) -> Problem:
        """What was fitted: measurements, parameters and noise, in rad and mm."""
        return self.fit.problem

    @property
    def converged(self) -> bool:
        """Whether there is an answer at all."""
        return self.fit.converged and self.trusted

    @cached_property
    def misfit(self) -> Misfit | None:
        """Why the model does not describe the measurements; None where it does, or without an answer."""
        if not self.converged:
            return None
        steps = [step for step in self.recording_steps.rows if step.contradicts]
        # A target that was off for some measurements only has not moved: its step says so.
        moved = self.moved_target
        if moved is not None and moved.target in {step.target for step in steps}:
            moved = None
        return misfit_of(self.fit, self.identified, moved, steps)

    @cached_property
    def status(self) -> tuple[Status, ...]:
        """Of each parameter (p,): this is the only place where a status is decided for an answer."""
        if self.converged and self.misfit is not None:
            return tuple(map(with_misfit, self.identified.status))
        if self.converged:
            return self.identified.status
        return tuple("held" if item.held else "unidentifiable" for item in self.problem.parameters.items)

    @cached_property
    def moved_target(self) -> Displacement | None:
        """The displacement of a target, if there is a significant one that links within their tolerances do
        not explain as well."""
        moved = displacement(self.fit) if self.converged else None
        if moved is None or not moved.significant:
            return None
        rival = self._rivals
        moved = moved if rival is None else displacement(self.fit, rival)
        return moved if moved is not None and moved.significant else None

    @property
    def contradictions(self) -> tuple[Criterion, ...]:
        """What contradicts the model: the criteria of the misfit, if there is one."""
        return () if self.misfit is None else self.misfit.criteria

    @property
    def consistent(self) -> bool:
        """Nothing contradicts the model."""
        return self.misfit is None

    @cached_property
    def recording_steps(self) -> RecordingSteps:
        """The significant steps inside the recordings; none without an answer."""
        return steps(self.fit, self._rivals)

    @property
    def _rivals(self) -> Matrix | None:
        """(M, g) what may look like a target or instrument that was moved: links within their tolerances, and
        the common errors of joints that rested."""
        columns = [self.link_columns, resting_columns(self.fit)]
        rivals = [each for each in columns if each is not None]
        return np.hstack(rivals) if rivals else None

    @cached_property
    def power(self) -> tuple[DetectionPower, ...]:
        """Of the tests that the run has passed, against wrong models; none of a misfit."""
        if not self.converged or self.misfit is not None:
            return ()
        return powers(self.problem, self.fit.x, self.identified)

    @cached_property
    def null_space(self) -> tuple[NullDirection, ...]:
        """The null-space directions, each with its cause and the remedy that was tried; without remedies
        where the model does not describe the measurements."""
        directions = self.identified.facts.null_space
        if not directions or not self.converged or self.misfit is not None:
            return directions
        problem, fit = self.problem, self.fit
        search = RemedySearch(
            problem,
            fit.x,
            self.status,
            fit.std,
            problem.shot_numbers,
            weight=fit.weight,
            measured=True,
        )
        return search.with_remedies(directions)

    @property
    def facts(self) -> Identifiability:
        """What is identifiable, its null-space directions with their remedies."""
        return replace(self.identified.facts, null_space=self.null_space)

    @cached_property
    def known(self) -> tuple[int, ...]:
        """Places among the parameters of those that have numbers: the data determine them, if need be with
        what is assumed."""
        return tuple(i for i, status in enumerate(self.status) if has_numbers(status))

    @property
    def verdict(self) -> Verdict:
        """Over all offsets; misfit where the model does not describe the measurements, degenerate without a
        converged fit, no more than weak with angles of the robot that are rounded."""
        if self.misfit is not None:
            return "misfit"
        verdict = verdict_of(row.status for row in self.offsets) if self.converged else "degenerate"
        return "weak" if verdict == "pass" and self.problem.robot.rounded else verdict

    @cached_property
    def against_noise(self) -> AgainstNoise:
        """The residuals against the stated noise."""
        return self.fit.against_noise(self.identified.facts.rank)

    @property
    def p_value(self) -> float | None:
        """Of residuals as large by the stated noise; None where the noise is estimated, no degree of freedom
        is left to contradict it, or there is no answer."""
        return self.against_noise.p_value if self.converged else None

    def geometry(self, header: Header) -> GeometryResult:
        """Tolerances, models that were tried, and what the offsets are worth if the geometry is not as it was
        taken."""
        fit = self.fit
        return geometry_result(
            header,
            fit.problem,
            fit.x,
            fit.covariance,
            self.status,
            weight=fit.weight,
            ladder=self.ladder,
            factors=self.factors,
        )

    @cached_property
    def link_columns(self) -> Matrix | None:
        """(M, g) what links within their tolerances do to the residuals at the mode: a rival of other
        explanations. None where they are estimated."""
        return link_columns(self.problem, self.fit.x)

    @property
    def dof(self) -> int:
        """Degrees of freedom: numbers that the fit leaves over."""
        return self.against_noise.dof

    @property
    def noise_scale(self) -> float:
        """The noise as a multiple of the stated."""
        return float(1 / np.sqrt(self.fit.weight))

    @property
    def coverage_factor(self) -> float:
        """k of every expanded uncertainty U = k u (about 95 %): 2, or Student's factor where noise is
        estimated from so few degrees of freedom that it is larger (JCGM 100, 6.3.3 and G.3)."""
        offsets = self.problem.parameters.group("offset") & self.problem.parameters.free
        return float(self.quantiles[offsets].max(initial=2.0))

    @cached_property
    def quantiles(self) -> Matrix:
        """(p,) half widths of the 95 % intervals in stds: Student's t by the effective degrees of freedom
        where the noise is estimated; nan where held."""
        return np.where(np.isnan(self.effective_dof), np.nan, student_half_width(self.effective_dof))

    @cached_property
    def effective_dof(self) -> Matrix:
        """(p,) effective degrees of freedom of the stds; nan where held."""
        result = np.full(len(self.problem.parameters), np.nan)
        result[self.problem.parameters.free] = effective_dof(self.fit)
        return result

    @cached_property
    def std(self) -> Matrix:
        """(p,) internal units; nan where held or not determined."""
        std = self.problem.parameters.unscaled(self.fit.std)
        return np.where([has_numbers(status) for status in self.status], std, np.nan)

    @cached_property
    def parameters(self) -> ParameterTable:
        """A row for each parameter, in their order."""
        return ParameterTable(self._row(i, item) for i, item in enumerate(self.problem.parameters.items))

    @cached_property
    def offsets(self) -> ParameterTable:
        """The rows of the joint offsets."""
        return ParameterTable(row for row in self.parameters if row.group == "offset")

    @property
    def offset_std(self) -> dict[str, float | None]:
        """Standard uncertainty of each offset that is not held, degrees (mm), by name; None where it is not
        determined."""
        return self._by_offset({offset.name: offset.std for offset in self.offsets if not offset.held})

    def _by_offset(self, values: dict[str, float | None]) -> dict[str, float | None]:
        units = {offset.name: offset.unit for offset in self.offsets}
        return ValuesByName(values, units, self.status)

    @property
    def offset_expanded(self) -> dict[str, float | None]:
        """The same as expanded uncertainties U."""
        k = self.coverage_factor
        return self._by_offset(
            {name: None if std is None else k * std for name, std in self.offset_std.items()}
        )

    @property
    def offset_tolerance(self) -> dict[str, float]:
        """Of each offset that is not held, up to which std it counts as identified, deg (mm)."""
        items = self.problem.parameters.items
        return {
            item.name: item.tolerance * item.display
            for item in items
            if item.group == "offset" and not item.held
        }

    @property
    def normalised_residuals(self) -> dict[int, float]:
        """Length of the normalised residual of each measurement, by its number; empty without an answer."""
        if not self.converged:
            return {}
        lengths = self.fit.normalised_lengths.tolist()
        return dict(zip(self.problem.shot_numbers, lengths, strict=True))

    @property
    def worst(self) -> float | None:
        """The largest standard uncertainty of an offset, degrees (mm); None while one has none, and without
        offsets. Not of one that is as good as what is assumed, whatever is measured."""
        judged = [row.std for row in self.offsets if not row.held and row.status != "assumed"]
        stds = [std for std in judged if std is not None]
        return max(stds) if stds and len(stds) == len(judged) else None

    def __getitem__(self, name: str) -> ParameterResult:
        return self.parameters.named(name)

    def __contains__(self, name: object) -> bool:
        return name in self.parameters.names or name in self.parameters

    def __iter__(self) -> Iterator[ParameterResult]:
        return iter(self.parameters)

    @cached_property
    def covariance(self) -> Covariance:
        """Of all parameters that the data determine, in the units that people read."""
        parameters, known = self.problem.parameters, list(self.known)
        items = [parameters.items[i] for i in known]
        at = parameters.among_free[known]
        scale = np.array(
            [
                item.shown_std(float(self.fit.x[i]), item.prior_std)
                for i, item in zip(known, items, strict=True)
            ]
        )
        return Covariance(
            tuple(item.name for item in items),
            tuple(item.unit for item in items),
            tuple(self.status[i] for i in known),
            self.fit.covariance[np.ix_(at, at)] * np.outer(scale, scale),
        )

    def _row(self, i: int, item: Parameter) -> ParameterResult:
        status, value = self.status[i], float(self.fit.x[i])
        determined = has_numbers(status)
        data_std = item.shown_std(value, float(self.identified.data_std[i]))
        half = float(self.quantiles[i] * self.std[i])  # by the curvature at the mode
        by_tolerances = (
            float(self._tolerance_share[i]) if determined and len(self.problem.tolerated) else None
        )
        cause = self.identified.cause(item, status, by_tolerances)
        return ParameterResult(
            name=item.name,
            unit=item.unit,
            group=item.group,
            status=status,
            estimate=item.shown(value) if determined or item.held else None,
            std=item.shown_std(value, float(self.std[i])) if determined else None,
            data_std=data_std if np.isfinite(data_std) else None,
            interval95=(item.shown(value - half), item.shown(value + half)) if determined else None,
            prior_std=item.shown_prior[1],
            midpoint=None,
            cause=cause if self.converged or item.held else Unconverged(),
            tolerance_share=by_tolerances,
            tolerated=item.tolerated,
            dof=float(self.effective_dof[i]) if determined else math.inf,
        )

    @cached_property
    def _tolerance_share(self) -> Matrix:
        """(p,) of the free parameters, nan if held."""
        share = np.full(len(self.problem.parameters), np.nan)
        share[self.problem.parameters.free] = tolerance_share(self.problem, self.fit.covariance)
        return share


def solve(problem: Problem, **how: Any) -> Solution:
    """Fit and judge; `how` goes to `fit_likelihood` (seed, starts)."""
    return judge(fit_likelihood(problem, **how))


def so_far(problem: Problem) -> Solution:
    """What the measurements of `problem` (one at least) determine, while more are being made.

    It follows from the measurements alone, so that a run that is resumed decides as one that was never
    interrupted. While there are too few numbers to estimate the noise from, the stated noise serves to aim
    the next posture, and nothing is known: the solution has not converged, and its `problem` has no noise
    factors.
    """
    if problem.noise_estimable:
        return solve(problem)
    return judge(fit_likelihood(problem.with_noise_of(problem.nominal())[0]), trusted=False)


def judge(
    fit: LikelihoodFit,
    *,
    trusted: bool = True,
    effective: Effective | None = None,
    ladder: tuple[Rung, ...] = (),
    factors: Factors | None = None,
) -> Solution:
    """The measurements of a fit judged at its mode. No parameter is better than the std found there, and none
    is known of which another optimum, about as good, says something else.

    Where a direction is nearly lost the residuals are far from linear, and the std at the mode can be larger
    than the one that the Jacobian promises.
    """
    problem = fit.problem
    identified = identify(problem, fit.x, fit.weight)
    identified = no_better_than(problem, identified, problem.parameters.unscaled(fit.std))
    solution = Solution(fit, identified, trusted, effective, ladder, factors)
    quantiles = solution.quantiles[problem.parameters.free]
    return replace(solution, identified=undecided(fit, identified, quantiles))


def require_noise_data(problem: Problem) -> None:
    """Raise BadInput where the noise scale is to be estimated from no more numbers than unknowns."""
    if not problem.noise_estimable:
        raise too_few_for_noise(problem)


def too_few_for_noise(problem: Problem) -> BadInput:
    """The error that residuals have no degree of freedom by which the noise scale could be estimated."""
    numbers = f"{problem.measured_size:g} numbers from {problem.shots} measurements"
    links, free = len(problem.tolerated), int(problem.parameters.free.sum())
    within = f", and {links} parameters of geometry and tool deviate within their tolerances" if links else ""
    enough = math.floor(free * problem.shots / problem.measured_size) + 1
    bounded = problem.noise.estimated and problem.data_size > free + 2
    by_prior = ", or separate: its two factors have a prior" if bounded else ""
    return BadInput(
        "the noise scale cannot be estimated from so few measurements",
        found=f"{numbers} for {problem.parameters.without_tolerance} unknowns{within}",
        allowed=f"more numbers than unknowns{' and deviations' if links else ''}: {enough} measurements",
        remedy=f"record more measurements, or state noise.scale: known{by_prior}",
    )


def undecided(fit: LikelihoodFit, identified: Identified, quantiles: Matrix) -> Identified:
    """The same with `unidentifiable` for every parameter of which another optimum, about as good as the best,
    says something else: the best one's 95 % interval does not hold for it.

    `quantiles` (f,) are the half widths of such intervals in stds. Every such optimum is a null direction, of
    the kind `optima`: the way to it, of these parameters; not where it differs in what has a tolerance
    alone.
    """
    parameters = fit.problem.parameters
    status, data_std = list(identified.status), identified.data_std.copy()
    settled = np.array([has_numbers(identified.status[i]) for i in np.flatnonzero(parameters.free)])
    directions = []
    rivals = [other for other in fit.others if other.below < EQUALLY_GOOD]
    for other in rivals:
        elsewhere = settled & _leaves_out(fit, other, quantiles)
        if (elsewhere & ~parameters.tolerated[parameters.free]).any():
            directions.append(_direction(fit, other, elsewhere, 1 + len(rivals)))
        for i in np.flatnonzero(parameters.free)[elsewhere]:
            status[i], data_std[i] = "unidentifiable", np.inf
    facts = replace(identified.facts, null_space=(*identified.facts.null_space, *directions))
    decided: tuple[Status, ...] = tuple(status)
    return replace(identified, status=decided, data_std=data_std, facts=facts)


def undecided_names(null_space: Sequence[NullDirection]) -> tuple[str, ...]:
    """The parameters that have no number because of other optima."""
    taking_part = (direction.combination for direction in null_space if direction.kind == "optima")
    return tuple(dict.fromkeys(name for combination in taking_part for name in combination))


def _leaves_out(fit: LikelihoodFit, other: Optimum, quantiles: Matrix) -> NDArray[np.bool_]:
    """(f,) whether the best optimum's interval holds too little of the other's normal: less than if both had
    the same std and were one std apart."""
    half = quantiles * fit.std
    within = scipy.special.ndtr((fit.z + half - other.z) / other.std) - scipy.special.ndtr(
        (fit.z - half - other.z) / other.std
    )
    return np.asarray(within < scipy.special.ndtr(quantiles - 1.0) - scipy.special.ndtr(-quantiles - 1.0))


def _direction(fit: LikelihoodFit, other: Optimum, elsewhere: NDArray[np.bool_], count: int) -> NullDirection:
    """The way from the best optimum to the other, of the parameters that are `elsewhere` (f,) there."""
    parameters = fit.problem.parameters
    way = np.where(elsewhere, other.z - fit.z, 0.0)
    order = [int(row) for row in np.argsort(-np.abs(way)) if elsewhere[row]]
    places, weights = np.flatnonzero(parameters.free), way / way[order[0]]
    values = []
    for row in order:
        item = parameters.items[places[row]]
        here, there = (item.prior_mean + item.prior_std * float(z[row]) for z in (fit.z, other.z))
        std = item.shown_std(here, item.prior_std * float(min(fit.std[row], other.std[row])))
        values.append(AtOptima(item.name, item.unit, (item.shown(here), item.shown(there)), std))
    combination = {values[k].name: float(weights[row]) for k, row in enumerate(order)}
    return NullDirection(
        combination, "optima", LocalOptima(count, tuple(values)), float(np.linalg.norm(way[order]))
    )
