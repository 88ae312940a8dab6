"""The uncertainty budget of each offset and tool parameter, by the GUM (JCGM 100:2008, clauses 4 to 7, G.4).

Near the mode the estimate moves in proportion to what it was made from: the recorded joints and spots, what
was stated of targets, tool, distances and angles, and the priors. With C the inverse of Fisher's information
(of the residuals, distances and angles, and the priors) its derivative by the residual of measurement i is
-C A_i' S_i^-1, and S_i is the sum of the joints' and the spot's parts. So C is exactly the sum of its parts
by source. The result's own covariance is the inverse of the Hessian, and with separate noise factors contains
what these leave open: both differences are rows of their own, so that a budget adds up to the variance that
the result reports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.parameters import Distance
from ...model.records import internal, it, record
from ..estimation.fit import effective_dof, gains, log_scales, noise_dof
from ..posterior.convergence import Ends
from ..posterior.posterior import PosteriorSummary
from ..solution import Solution
from ..status import Status, known, require_no_more_than

Kind = Literal["joint", "spot", "prior", "target", "distance", "angle", "noise factors", "curvature"]

_SURE = 2.0  # standard errors: what the draws determine no better is not stated (JCGM 101, 7.9.4)


@dataclass(frozen=True)
class BudgetRow:
    """What one source contributes to the uncertainty of one parameter.

    `of` names it: a joint by its number, a parameter, a target, the two targets of a distance or an angle.
    `type` is A (from this run's residuals) or B (stated), `std` and `unit` are of one reading or one stated
    number, `dof` its degrees of freedom (None: infinite). `sensitivity` is contribution over std (the root of
    the sum of squares over all readings), in the parameter's unit per `unit`. `contribution` is a std in the
    parameter's unit, negative where it lowers the variance (curvature alone can); `share` of the variance.
    `noise factors` is how they weigh the residuals, `curvature` that of the log-posterior beyond Fisher's
    information: no input quantities, so without type, std and sensitivity.
    """

    kind: Kind
    of: tuple[str, ...] = ()
    type: Literal["A", "B"] | None = None
    std: float | None = None
    unit: str | None = None
    dof: float | None = None
    sensitivity: float | None = None
    contribution: float = 0.0
    share: float = 0.0


@dataclass(frozen=True)
class LinearCheck:
    """The interval of the budget against the posterior's (JCGM 101:2008, clause 8).

    `d_low` and `d_high` are the distances of their ends, `tolerance` half a unit in the last of `digits`
    significant digits of the std: two, or one where the draws cannot decide by two. `ends_std` is how well
    they give the posterior's ends; `validated` is None where that is too poor to decide at all: `too_large`.
    """

    digits: int
    tolerance: float
    d_low: float
    d_high: float
    ends_std: float
    validated: bool | None

    @property
    def too_large(self) -> float:
        """How many times the Monte Carlo error is what decides; up to 1 it does."""
        left = abs(self.tolerance - max(self.d_low, self.d_high))
        return _SURE * self.ends_std / max(min(self.tolerance, left), 1e-300)


@record
class Budget:
    """The uncertainty budget of one parameter that the data determine."""

    name: Annotated[str, it("of an identifiable offset or tool parameter")]
    unit: Annotated[str, it("of its numbers")]
    status: Annotated[Status, internal]
    std: Annotated[float, it("combined standard uncertainty")]
    rows: Annotated[
        tuple[BudgetRow, ...],
        it(
            "the sources: the squares of `contribution` (with its sign) add up to `std` squared. "
            "`kind` and `of`: `joint` (its number), `spot`, `prior` (the parameter), `target` (its "
            "three coordinates), `distance` (the two targets), `noise factors` (their effect on the "
            "weights), `curvature` (of the log-posterior beyond Fisher's information). `type`: `A` "
            "(from the residuals of this run) or `B` (stated); `std`, the standard uncertainty of one "
            "reading or stated number, with its `unit` and `dof` (null: infinite); all null for the last two "
            "kinds. `sensitivity`: contribution over `std`, in the unit of the parameter per `unit`, all "
            "readings together; null where there is no `std`. `contribution`: a standard uncertainty in the "
            "unit of the parameter, negative where it lowers the variance. `share`: of the variance"
        ),
    ]
    dof: Annotated[float | None, it("effective degrees of freedom; null: infinite")]
    coverage_factor: Annotated[float, it("k for 95 %")]
    expanded: Annotated[float, it("k times `std`")]
    check: Annotated[
        LinearCheck | None,
        it(
            "against the posterior (JCGM 101, clause 8), null without one: `digits` (2, or 1 where "
            "the Monte Carlo error is too large for 2), `tolerance`, `d_low`, `d_high` (differences "
            "of the ends), `ends_std` (Monte Carlo standard error of the posterior's ends), "
            "`validated` (null: inconclusive, Monte Carlo error too large)"
        ),
    ]

    def __post_init__(self) -> None:
        require_no_more_than(self.name, self.status, budget=self.std)


def _determined(solution: Solution) -> list[int]:
    items = solution.problem.parameters.items
    return [i for i in solution.known if items[i].group in ("offset", "tool")]


def _interval(solution: Solution, i: int) -> tuple[float, float, float]:
    """The estimate of parameter `i`, its std and half its 95 % interval."""
    parameters, fit = solution.problem.parameters, solution.fit
    variance = float(fit.covariance.diagonal()[parameters.among_free[i]])
    std = math.sqrt(variance) * float(parameters.prior_std[i] * parameters.display[i])
    return parameters.items[i].shown(float(fit.x[i])), std, float(solution.quantiles[i]) * std


def more_draws(solution: Solution, ends: Mapping[str, Ends]) -> float:
    """By what factor more draws with these `ends` would decide all linear checks; 1 or less: they do."""
    names = solution.problem.parameters.names
    checks = [check_linear(*_interval(solution, i), ends[names[i]]) for i in _determined(solution)]
    return max((check.too_large**2 for check in checks), default=0.0)


def budget(
    solution: Solution, posterior: PosteriorSummary, ends: Mapping[str, Ends] | None = None
) -> tuple[Budget, ...]:
    """One for every offset and tool parameter that the data determine; `ends` by name are sharper ones of the
    posterior than those of its draws."""
    parameters = solution.problem.parameters
    determined = _determined(solution)
    if not determined:
        return ()
    index = np.array(determined)
    at = parameters.among_free[index]
    scale = parameters.prior_std[index] * parameters.display[index]
    sources, parts = _sources(solution, at)
    variances = np.diag(solution.fit.covariance)[at]
    dof = effective_dof(solution.fit)[at]
    sharper = ends or {}
    draws = {
        row.name: sharper.get(row.name, row.ends)
        for row in posterior.parameters or ()
        if row.source == "data"
    }
    budgets = []
    for j, i in enumerate(determined):
        item = parameters.items[i]
        value, std, half = _interval(solution, i)
        rows = []
        for source, part in zip(sources, parts[:, j].tolist(), strict=True):
            contribution = math.copysign(math.sqrt(abs(part)), part) * float(scale[j])
            sensitivity = contribution / source.std if source.std else None
            share = part / float(variances[j])
            rows.append(replace(source, sensitivity=sensitivity, contribution=contribution, share=share))
        budgets.append(
            Budget(
                name=item.name,
                unit=item.unit,
                status=solution.status[i],
                std=std,
                rows=tuple(rows),
                dof=float(dof[j]) if np.isfinite(dof[j]) else None,
                coverage_factor=float(solution.quantiles[i]),
                expanded=half,
                check=check_linear(value, std, half, draws[item.name]) if item.name in draws else None,
            )
        )
    return tuple(budgets)


def _sources(solution: Solution, at: Matrix) -> tuple[list[BudgetRow], Matrix]:
    """All sources, and (sources, t) their parts in the scaled variances of the free parameters `at` (t,)."""
    problem, fit = solution.problem, solution.fit
    parameters, whitened = problem.parameters, fit.whitened
    noise = parameters.group("noise")[parameters.free]
    by_tie = whitened.jacobian[problem.shots * problem.tool.residual_size :, parameters.free][:, ~noise]
    # Of every reading: the residual's derivative by a joint is that by its offset, by the spot -1.
    every = gains(fit)
    kept, gain = (np.cumsum(~noise) - 1)[at], every.covariance[at][:, ~noise]
    by_joint, by_spot = every.by_joint[:, at], every.by_spot[:, at]
    variances = problem.variances(fit.x) / fit.weight
    parts = [
        (by_joint**2).sum(axis=0).T * variances[: problem.robot.n, None],
        np.einsum("nfd,ind->if", by_spot**2, problem.of_sources(variances)),
    ]
    sources = _noise_sources(solution, np.sqrt(variances))

    squares = gain.T**2  # (f, t): the priors' variances are 1
    items = [item for item in parameters.items if not item.held and item.group != "noise"]
    groups: dict[tuple[Kind, str], list[int]] = {}
    for i, item in enumerate(items):
        # The three coordinates of a target are one source.
        source: tuple[Kind, str] = ("target", item.of) if item.group == "target" else ("prior", item.name)
        groups.setdefault(source, []).append(i)
    for (kind, name), rows_of in groups.items():
        first = items[rows_of[0]]
        sources.append(BudgetRow(kind, (name,), "B", first.shown_prior[1], first.unit))
        parts.append(squares[rows_of].sum(axis=0)[None])
    for tie in problem.ties:
        between = (problem.targets[tie.first], problem.targets[tie.second])
        if isinstance(tie, Distance):
            sources.append(BudgetRow("distance", between, "B", tie.sigma, "mm"))
        else:
            sources.append(BudgetRow("angle", between, "B", float(np.degrees(tie.sigma)), "deg"))
    parts.append((by_tie @ gain.T) ** 2)

    left = np.diag(fit.covariance)[at] - np.diag(gain[:, kept])
    if noise.any():
        cross = fit.covariance[at][:, noise]
        factors = (cross * np.linalg.solve(fit.covariance[np.ix_(noise, noise)], cross.T).T).sum(axis=1)
        sources.append(BudgetRow("noise factors"))
        parts.append(factors[None])
        left = left - factors
    sources.append(BudgetRow("curvature"))
    parts.append(left[None])
    return sources, np.concatenate(parts)


def _noise_sources(solution: Solution, std: Matrix) -> list[BudgetRow]:
    """The joints, then the readings, with the `std` (n + I,) of one as it was found or stated."""
    problem, robot = solution.problem, solution.problem.robot
    noises = problem.tool.noises
    sources = len(noises)
    kinds: list[tuple[Literal["A", "B"], float | None]] = [("B", None)] * (robot.n + sources)
    if problem.noise.estimated:
        kinds = [("A", noise_dof(solution.fit))] * (robot.n + sources)
    elif problem.noise.separate:
        status = dict(zip(problem.parameters.names, solution.status, strict=True))
        variance = np.diag(log_scales(solution.fit))
        factors = problem.noise.factors
        of_factors = [
            _of_factor(status[f"noise.{name}"], float(value))
            for name, value in zip(factors, variance, strict=True)
        ]
        joint_kind, *reading_kinds = (of_factors[k] for k in problem.noise.of_factor)
        kinds = [joint_kind] * robot.n + reading_kinds
    angles = [each.unit == "deg" for each in noises]
    display = np.append(robot.display, np.where(angles, np.degrees(1.0), 1.0))
    units = ["deg" if joint.kind == "revolute" else "mm" for joint in robot.joints]
    units += [each.unit for each in noises]
    several = [each.label for each in noises] if sources > 1 else []
    return [
        BudgetRow(
            "spot" if i >= robot.n else "joint",
            tuple(several[i - robot.n : i - robot.n + 1]) if i >= robot.n else (str(i + 1),),
            kind,
            value,
            units[i],
            dof,
        )
        for i, ((kind, dof), value) in enumerate(zip(kinds, (std * display).tolist(), strict=True))
    ]


def _of_factor(status: Status, variance: float) -> tuple[Literal["A", "B"], float | None]:
    """Type and degrees of freedom (G.3) of a noise whose factor has the logarithm of this variance."""
    kind: Literal["A", "B"] = "A" if known(status) else "B"
    return kind, 1 / (2 * variance) if variance > 0 else None


def check_linear(value: float, std: float, half: float, ends: Ends) -> LinearCheck:
    """`value` ± `half` with the standard uncertainty `std` against the quantiles of the draws.

    It is decided where twice the standard error of the draws' ends is within the tolerance (JCGM 101, 7.9.4)
    and leaves no doubt.
    """
    d_low, d_high = abs(value - half - ends.q2_5), abs(value + half - ends.q97_5)
    ends_std = ends.error

    def at(digits: int) -> LinearCheck:
        last = int(f"{std:.{digits - 1}e}".split("e")[1]) - (digits - 1)
        check = LinearCheck(digits, 0.5 * 10.0**last, d_low, d_high, ends_std, None)
        validated = max(d_low, d_high) < check.tolerance if check.too_large <= 1 else None
        return replace(check, validated=validated)

    two = at(2)
    return two if two.validated is not None else at(1)
