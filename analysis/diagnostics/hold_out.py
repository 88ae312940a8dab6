"""Placements that the fit has not seen: held out by name, each left out in turn, and the jackknife.

The offsets, the tool and all else that is no target come from the other placements; only the positions of the
held-out targets are estimated from their own measurements and distances. The residuals there are judged
against the noise and the uncertainty of what was carried over. Leave-one-out and jackknife come from the same
fits, one without each placement, from the mode of the whole. They see what differs between placements, be it
noise or unmodelled error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Annotated

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.errors import BadInput
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, key, record
from ..estimation.fit import fit_likelihood, modes, unbiased_weight
from ..observability.gauges import ROUNDING, information_root
from ..prediction import (
    PredictedAgainstMeasured,
    Predictor,
    known_factors,
    noise_dof,
    settled,
    weighted_rows,
)
from ..recordings.recordings import Effective, Placement, placements
from ..recordings.steps import RecordingStep, RecordingSteps
from ..solution import Solution
from ..status import has_numbers

_SEPARATORS = "_-. "
_FEWEST = 3  # placements of a jackknife
_STEPS = 12
_SETTLED = (
    0.02  # size of the gradient, in posterior stds: what is left is along gauges, where only priors pull
)


@record(kw_only=True)
class HoldOut(PredictedAgainstMeasured):
    """The measurements at held-out placements, with offsets and tool from the others."""

    placements: Annotated[tuple[str, ...], it("names of the held-out placements")]

    @property
    @key("of a placement that was left out: its name")
    def placement(self) -> str:
        return ", ".join(self.placements)


def hold_out(problem: Problem, patterns: Sequence[str], seed: int = 0) -> HoldOut:
    """Fit without the placements that `patterns` name (`chosen`), then look at their measurements.

    Raises BadInput where nothing matches, or nothing would be left to fit.
    """
    every = placements(problem)
    held = {placement.name for pattern in patterns for placement in chosen(every, pattern)}
    groups = [placement for placement in every if placement.name in held]
    if len(groups) == len(every):
        raise BadInput(
            "all targets are held out: there is nothing left to fit",
            found=", ".join(patterns),
            allowed=f"some of {', '.join(placement.name for placement in every)}",
            remedy="leave at least one target in; a name takes a whole placement, with all targets that are"
            " tied to it by distances",
        )
    names = [name for placement in groups for name in placement.targets]
    rest = problem.without_targets(names)
    fit = fit_likelihood(rest, starts=0, seed=seed)
    calibration = Predictor(rest, fit.x, fit.covariance, fit.weight, noise_dof(rest))
    return judged(problem, groups, calibration, None if fit.converged else fit.reason)


def chosen(every: Sequence[Placement], pattern: str) -> list[Placement]:
    """The placements that a name or pattern means, always whole.

    The name of a placement means it alone, the name of a target its placement. NAME_* (or NAME-*, NAME.*)
    means the placement NAME alone if there is one. Any other pattern (* and ? as in file names) means every
    placement whose name, or the name of one of whose targets, matches. Raises BadInput where there is none.
    """
    stem = pattern.removesuffix("*").rstrip(_SEPARATORS)
    separated = pattern.endswith("*") and pattern[-2:-1] in set(_SEPARATORS)
    for matching in (
        [p for p in every if p.name == pattern],
        [p for p in every if pattern in p.targets],
        [p for p in every if separated and p.name == stem],
        [p for p in every if any(fnmatchcase(name, pattern) for name in (p.name, *p.targets))],
    ):
        if matching:
            return matching
    tied = [placement.name for placement in every if len(placement.targets) > 1]
    names = [*tied, *(name for placement in every for name in placement.targets)]
    raise BadInput(
        "no placement and no target of that name can be held out",
        found=pattern,
        allowed=", ".join(dict.fromkeys(names)) or "none: the run has neither targets nor placements",
    )


def judged(
    problem: Problem, groups: Sequence[Placement], calibration: Predictor, failure: str | None
) -> HoldOut:
    """The placements `groups` of `problem` by a calibration without them, unless that did not converge."""
    names = tuple(name for placement in groups for name in placement.targets)
    held_out = problem.without_targets(set(problem.targets) - set(names))
    facts = HoldOut(
        targets=names,
        placements=tuple(placement.name for placement in groups),
        shots=held_out.shots,
        shots_fitted=calibration.problem.shots,
        failure=failure,
    )
    if failure is not None:
        return facts
    moved = held_out.parameters.group("target") & held_out.parameters.free
    before = settled(held_out, held_out.nominal(), moved, weighted_rows(held_out, calibration.weight))
    after = calibration.predict(held_out)
    return replace(
        facts,
        rms_mm=after.rms_mm,
        rms_before_mm=held_out.rms_mm(held_out.linearise(before)[0]),
        expected_mm=after.expected_mm,
        chi2=after.chi2 if after.dof > 0 else None,
        dof=after.dof,
        p_value=after.p_value,
        rms_deg=after.rms_deg,
        expected_deg=after.expected_deg,
    )


@dataclass(frozen=True)
class LeaveOneOut:
    """Each placement as the others predict it.

    `rows` are hold-outs of one placement each, in their order. `rms_mm` of all residuals at placements that
    the fit had not seen, and `expected_mm` what it would be by noise and fits: None where a fit without a
    placement did not converge.
    """

    rows: tuple[HoldOut, ...]
    rms_mm: float | None
    expected_mm: float | None


@dataclass(frozen=True)
class JackknifeOffset:
    """An offset by the fits without one placement, in the `unit` that people read.

    `estimates` without each placement, None where the remaining data do not determine it: the placements in
    `needs`. `u` is the jackknife's standard uncertainty: None where one of the estimates is missing.
    """

    name: str
    unit: str
    estimates: tuple[float | None, ...]
    needs: tuple[str, ...]
    u: float | None


@dataclass(frozen=True)
class Jackknife:
    """The delete-one-placement jackknife of the offsets that all data together determine.

    `dof` is the number of placements less 1: so few values make up each u.
    """

    placements: tuple[str, ...]
    dof: int
    offsets: tuple[JackknifeOffset, ...]

    def u(self, name: str) -> float | None:
        """The jackknife's standard uncertainty of an offset; None where there is none."""
        return next((row.u for row in self.offsets if row.name == name), None)


@dataclass(frozen=True, eq=False)
class FitWithoutPlacement:
    """The calibration by all but one `placement`, its covariance by Fisher's information; `failure` is the
    reason where the fit did not converge."""

    placement: Placement
    calibration: Predictor
    failure: str | None

    @property
    def converged(self) -> bool:
        return self.failure is None


def fits_without(solution: Solution) -> tuple[FitWithoutPlacement, ...]:
    """A fit without each placement: scoring steps (exact gradient, Fisher's information) from the mode of the
    whole, until the gradient is below 0.02 standard uncertainties; where they do not get there, Levenberg and
    Marquardt's. Separate noise factors stay as all measurements together have them. Empty without an answer,
    or for one placement."""
    if not solution.converged:
        return ()
    problem, x = known_factors(solution.problem, solution.fit.x)
    every = placements(problem)
    return tuple(fit_without(problem, x, placement) for placement in every) if len(every) > 1 else ()


def fit_without(
    problem: Problem, x: Matrix, placement: Placement, settled: float = _SETTLED
) -> FitWithoutPlacement:
    """The fit of all but a placement from `x` (p,), until the gradient is below `settled`."""
    rest = problem.without_targets(placement.targets)
    start = x[[problem.parameters.index(name) for name in rest.parameters.names]]
    density = Density(rest)
    at, converged, reason = _scored(density, start, settled)
    if not converged:
        refitted = modes(density, start[None])
        at, converged, reason = refitted.x[0], bool(refitted.converged[0]), refitted.reason[0]
    weight = float(unbiased_weight(density, at[None])[0])
    information = density.slopes(at[None]).information[0]
    if rest.noise.estimated:
        prior = density.prior_information(at[None])[0]
        information = prior + (information - prior) * weight / float(density.noise_weight(at[None])[0])
    calibration = Predictor(rest, at, np.linalg.inv(information), weight, noise_dof(rest))
    return FitWithoutPlacement(placement, calibration, None if converged else reason)


def _scored(density: Density, start: Matrix, settled: float) -> tuple[Matrix, bool, str]:
    """x (p,) by Fisher scoring from `start`, whether it converged, and why."""
    parameters, x, size = density.problem.parameters, start.copy(), np.inf
    free = parameters.free
    for _ in range(_STEPS):
        slopes = density.slopes(x[None])
        gradient, information = slopes.gradient[0], slopes.information[0]
        step = np.linalg.solve(information, gradient)
        size = float(np.sqrt(max(gradient @ step, 0.0)))
        if not np.isfinite(size) or size < settled:
            break
        x[free] += step * parameters.prior_std[free]
    return x, size < settled, f"the gradient is {size:.1e} posterior standard deviations"


def leave_one_out(solution: Solution, fits: Sequence[FitWithoutPlacement]) -> LeaveOneOut | None:
    """Each placement as the fit without it predicts it; None for less than two placements."""
    if not fits:
        return None
    whole, _ = known_factors(solution.problem, solution.fit.x)
    rows = tuple(judged(whole, [fit.placement], fit.calibration, fit.failure) for fit in fits)
    return LeaveOneOut(
        rows,
        pooled([(row.shots, row.rms_mm) for row in rows]),
        pooled([(row.shots, row.expected_mm) for row in rows]),
    )


def pooled(rows: Sequence[tuple[int, float | None]]) -> float | None:
    """The rms over all measurements of the rms of each placement; None where one or all are missing."""
    squares = [count * value**2 for count, value in rows if value is not None]
    if not rows or len(squares) < len(rows):
        return None
    return float(np.sqrt(sum(squares) / sum(count for count, _ in rows)))


def jackknife(solution: Solution, fits: Sequence[FitWithoutPlacement]) -> Jackknife | None:
    """The standard uncertainties of the offsets by the scatter of the fits without one placement.

    Placements differ in size: the delete-m_j jackknife (Busing, Meijer & van der Leeden, Statistics and
    Computing 9, 1999, eq. 3 to 7). Of an offset that the whole data do not determine there is none. None for
    less than three placements, or where a fit did not converge.
    """
    if len(fits) < _FEWEST or not all(fit.converged for fit in fits):
        return None
    determined_by = _determined(solution, fits)
    counts = np.array([len(fit.placement.rows) for fit in fits])
    names = tuple(fit.placement.name for fit in fits)
    problem, rows = solution.problem, []
    for i in np.flatnonzero(problem.parameters.group("offset")):
        item = problem.parameters.items[i]
        if item.held or not has_numbers(solution.status[i]):
            continue
        values = np.array([fit.calibration.value(item.name) for fit in fits])
        determined = determined_by[:, i]
        u = None
        if determined.all():
            u = item.shown_std(float(solution.fit.x[i]), delete_group_std(solution.fit.x[i], values, counts))
        rows.append(
            JackknifeOffset(
                item.name,
                item.unit,
                tuple(item.shown(float(v)) if ok else None for v, ok in zip(values, determined, strict=True)),
                tuple(name for name, ok in zip(names, determined, strict=True) if not ok),
                u,
            )
        )
    return Jackknife(names, len(fits) - 1, tuple(rows))


def delete_group_std(whole: float, without: Matrix, counts: Index) -> float:
    """The delete-m_j jackknife's std of an estimate: `whole` by all data, `without` (g,) each group, of
    `counts` (g,) measurements. Equal groups: the root of (g - 1) / g times their sum of squares."""
    times = counts.sum() / counts
    pseudo = times * whole - (times - 1) * without
    centre = len(without) * whole - ((1 - 1 / times) * without).sum()
    return float(np.sqrt(((pseudo - centre) ** 2 / (times - 1)).mean()))


def _determined(solution: Solution, fits: Sequence[FitWithoutPlacement]) -> Mask:
    """(g, p) which parameters the data without each placement determine, by the rule of `identify`: the std
    without prior is below the prior's. From the Jacobian of all data less the rows and columns of each."""
    problem, free = solution.problem, solution.problem.parameters.free
    _, jacobian, _ = information_root(problem, solution.fit.x, solution.fit.weight)
    d, result = problem.tool.residual_size, np.zeros((len(fits), len(free)), dtype=bool)
    for row, fit in enumerate(fits):
        stay = ~problem.parameters.targets(fit.placement.targets)[free]
        rows = np.delete(
            np.arange(len(jacobian)),
            d * np.repeat(fit.placement.rows, d) + np.tile(np.arange(d), len(fit.placement.rows)),
        )
        _, singular, right = np.linalg.svd(np.linalg.qr(jacobian[np.ix_(rows, stay)], mode="r"))
        singular = np.append(singular, np.zeros(right.shape[1] - len(singular)))
        floor = ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
        std = np.sqrt(((right.T / np.maximum(singular, floor)) ** 2).sum(axis=1))
        result[row, np.flatnonzero(free)[stay]] = std < 1.0
    return result


@record
class PlacementResult:
    """Placements by `names`; each left out in turn (None for one placement, or without an answer), the
    jackknife (None for less than three); correlation of the recordings, by which the measurements count, and
    their steps."""

    names: Annotated[tuple[str, ...], it("of the placements")]
    leave_one_out: Annotated[LeaveOneOut | None, internal]
    jackknife: Annotated[Jackknife | None, internal]
    effective: Annotated[Effective, it("correlation of the measurements")]
    steps: Annotated[RecordingSteps, internal]

    @property
    @key("each placement by the fit without it; empty with one placement", name="leave_one_out")
    def left_out(self) -> tuple[HoldOut, ...]:
        return () if self.leave_one_out is None else self.leave_one_out.rows

    @property
    @key("over the measurements of all placements, millimetres")
    def leave_one_out_rms_mm(self) -> float | None:
        return None if self.leave_one_out is None else self.leave_one_out.rms_mm

    @property
    @key("likewise, millimetres")
    def leave_one_out_expected_mm(self) -> float | None:
        return None if self.leave_one_out is None else self.leave_one_out.expected_mm

    @property
    @key(
        "by offset name, the standard uncertainty by the delete-one-placement jackknife, in the "
        "unit of the offset; null where the offset is unidentifiable without one of the "
        "placements. No unidentifiable or held offset is in it. Null with fewer than three "
        "placements",
        name="jackknife",
    )
    def jackknife_u(self) -> dict[str, float | None] | None:
        return None if self.jackknife is None else {row.name: row.u for row in self.jackknife.offsets}

    @property
    @key("the number of placements less 1")
    def jackknife_dof(self) -> int | None:
        return None if self.jackknife is None else self.jackknife.dof

    @property
    @key("by offset name, the placements without which it is unidentifiable")
    def jackknife_needs(self) -> dict[str, tuple[str, ...]] | None:
        return (
            None
            if self.jackknife is None
            else {row.name: row.needs for row in self.jackknife.offsets if row.needs}
        )

    @property
    @key(
        "significant steps inside recordings, the clearest first",
        name="steps",
    )
    def significant_steps(self) -> tuple[RecordingStep, ...]:
        return self.steps.rows

    @property
    @key("number of recordings that are long enough to be tested")
    def steps_tested(self) -> int:
        return self.steps.tested


def placement_result(solution: Solution, effective: Effective) -> PlacementResult:
    """Of a solution's measurements at their `effective` number."""
    fits = fits_without(solution)
    return PlacementResult(
        tuple(placement.name for placement in placements(solution.problem)),
        leave_one_out(solution, fits),
        jackknife(solution, fits),
        effective,
        solution.recording_steps,
    )
