"""For a misfit: what it could be, and what explains it.

Each hypothesis is fitted with all else as it is, at the stated noise, and judged by what it leaves: it must
agree with the noise, or at least halve the residuals, and its evidence must be beyond chance after counting
all that was tried (docs/mathematics.md). Nothing is applied.

Of a measurement that is wrong: which joint's value may be, and what was probably meant. The error of one
joint's value is one parameter more. With a normal prior of the standard deviation s, an error whose estimate
is v and whose information is G changes the evidence by -(log(1 + s^2 G) + v^2 G / (1 + s^2 G)) / 2 beside
what it gains in the residuals. A laser's measurement has two numbers, and the errors of several joints may
leave the same: then none of them is named alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.constraint import shot_functions
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record, worded
from ..misfit import TightPrior
from ..observability.changes import RepeatsApart, RunChange
from ..solution import Solution
from .hypotheses import (
    SIGNIFICANCE,
    HypothesisFit,
    fits_at,
    fits_from,
    hypothesis_fits,
    of_readings,
    suspect_fit,
)
from .suspects import Cause, Linear, of_one_value

DECIDED = 20.0  # the ratio of the evidences from which one cause is named and not asked for
_SIZES = {"deg": (0.5, 5.0, 50.0), "mm": (1.0, 10.0, 100.0)}  # standard deviations of an error
_NEAR = 2.0  # standard uncertainties between what fits and what was probably meant
_CLEAR = 20.0  # standard uncertainties that a digit must be worth: chance would suit some digit more finely
_MOST_DECIMALS = 4  # more were calculated and not written by a person


@dataclass(frozen=True)
class Misreading:
    """One value that may be wrong: of `joint` (from 1), deg or mm by its `unit`.

    With `fitted`, whose standard uncertainty is `u`, in place of what was `recorded` the measurement agrees
    with the others. `meant` is the number that differs from what was recorded by one digit, two neighbouring
    digits exchanged or the sign, and that fits too; None where there is none, or it is not decided.
    """

    joint: int
    unit: str
    recorded: float
    fitted: float
    u: float
    meant: str | None = None


def misreadings(
    problem: Problem, x: Matrix, base: HypothesisFit, number: int, slack: float, scatter: float = 1.0
) -> tuple[Misreading, ...]:
    """The joints of one measurement of which one wrong value explains it, the likeliest first: those whose
    evidence is 20 : 1 over the values as recorded, and within 20 : 1 of the best. Arguments as of
    `hypothesis_fits`; `scatter` is how many times the noise the other measurements leave: no value can
    explain more than leaving its measurement out, and each is so much more uncertain."""
    scatter = max(scatter, 1.0)
    slack = max(slack, scatter)
    at, linear = problem.shot_numbers.index(number), Linear(problem, x)
    fits = []
    for i, joint in enumerate(problem.robot.joints):
        unit = "deg" if joint.kind == "revolute" else "mm"
        display = float(problem.robot.display[i])
        widest = _SIZES[unit][-1]
        suspect = replace(of_one_value(problem, i, at), size=widest / display, unit=display)
        left = suspect_fit(linear, suspect)
        if not left.agrees(slack) or left.u > widest / 2:  # by its prior alone
            continue
        information = 1 / left.u**2 - 1 / widest**2
        evidence = max(
            replace(left, occam=_occam(left.amount, information, size)).log_evidence(base, slack > 1)
            for size in _SIZES[unit]
        )
        if evidence < np.log(DECIDED):
            continue
        recorded = round(float(problem.joints[at, i]) * display, 9)
        one = Misreading(i + 1, unit, recorded, recorded + left.amount, left.u * scatter)
        fits.append((evidence, replace(one, meant=meant(one))))
    fits.sort(key=lambda row: -row[0])
    return tuple(one for evidence, one in fits if evidence > fits[0][0] - np.log(DECIDED))


def _scatter(without: Explanation) -> float:
    """How many times the noise the others leave where a measurement is left out: once where they agree."""
    return 1.0 if without.agrees else without.factor


def _occam(value: float, information: float, size: float) -> float:
    wider = 1 + size**2 * information
    return float(np.log(wider) + value**2 * information / wider) / 2


def meant(one: Misreading) -> str | None:
    """The one number with a slip of one digit (or two exchanged, or the sign) that fits."""
    text = f"{one.recorded:.{_MOST_DECIMALS + 2}f}".rstrip("0").rstrip(".")
    if len(text.partition(".")[2]) > _MOST_DECIMALS:
        return None
    near = {
        slip
        for slip, worth in _slips(text)
        if worth >= _CLEAR * one.u and abs(float(slip) - one.fitted) <= _NEAR * one.u
    }
    return near.pop() if len(near) == 1 else None


def _slips(text: str) -> Iterator[tuple[str, float]]:
    """What a text may have been, and the least that such a slip changes of the number."""
    places = [i for i, character in enumerate(text) if character.isdigit()]
    point = text.find(".") if "." in text else len(text)
    yield text.removeprefix("-") if text.startswith("-") else f"-{text}", 2 * abs(float(text))
    for k, i in enumerate(places):
        worth = 10.0 ** (point - i - 1 if i < point else point - i)
        yield from (
            (f"{text[:i]}{digit}{text[i + 1 :]}", worth) for digit in "0123456789" if digit != text[i]
        )
        if k and text[i] != text[places[k - 1]]:
            before = places[k - 1]
            swapped = list(text)
            swapped[before], swapped[i] = text[i], text[before]
            yield "".join(swapped), 9 * worth


_SLACK = 3.0  # an estimated noise may be so many times the stated
_MOST = 5  # explanations
# What the links of an exact arm, which deviate in every arm, have to be clearly less likely than.
_RIVALS_OF_LINKS: frozenset[Cause] = frozenset(
    {
        "placement",
        "measurements",
        "repeats",
        "moved_target",
        "jump",
        "drift",
        "lag",
        "backlash",
        "gain",
        "noise",
        "tool",
    }
)
# What can make two readings in one posture differ: nothing else that is wrong all along can. Of angles in
# radians that were taken for degrees, different postures seem to be one.
_MAKES_REPEATS_DIFFER: frozenset[Cause] = frozenset(
    {"measurements", "repeats", "moved_target", "jump", "drift", "lag", "backlash", "noise", "units"}
)

BEYOND_TOLERANCES: frozenset[Cause] = frozenset({"geometry", "gravity", "harmonics"})


@record
class Explanation:
    """What explains a misfit. `amount` is what is added to a zero (deg), the factor of units, how many times
    joint 2 is added to joint 3, the size of a jump, of a drift, of backlash, of what a tool or a length is
    off (deg, mm), the share of a motion or of an angle, or how many times noise or tolerances are as large;
    `of` names the arm, the axes, the convention, the part of the tool or the parameter.

    `before` is `factor` as recorded; `farthest` and `farthest_before` the largest distance of an estimate
    from its prior mean, in prior stds. `freed` is the effective number of parameters that it frees, `p_value`
    that of such evidence after all that was tried. `sources` has FILE:LINE of the measurements, by number.
    Of an exact arm its links come first where they are enough, unless another is 20 times as likely.
    """

    cause: Annotated[Cause, it("its name")]
    joints: Annotated[tuple[int, ...], it("from 1")]
    targets: Annotated[tuple[str, ...], it("names")]
    measurements: Annotated[
        tuple[int, ...], it("their numbers; of a moved target the last before and the first after")
    ]
    amount: Annotated[float, internal]
    factor: Annotated[float, it("the residual over the stated noise that it leaves")]
    before: Annotated[float, internal]
    farthest: Annotated[float, internal]
    farthest_before: Annotated[float, internal]
    freed: Annotated[float, internal]
    p_value: Annotated[float, internal]
    agrees: Annotated[bool, it("whether that agrees with the noise")]
    of: Annotated[str, internal] = ""
    odds: Annotated[float, it("its evidence over that of the best explanation: 1 of the first")] = 1.0
    sources: Annotated[tuple[tuple[int, str], ...], internal] = ()
    readings: Annotated[
        tuple[Misreading, ...],
        it(
            "of a single measurement: the values of which one alone, if it is wrong, explains it, the"
            " likeliest first, each within 20 : 1 of it. `joint` from 1; `fitted`, with the standard "
            "uncertainty `u`, agrees with the other measurements; `meant` differs from `recorded` by "
            "one slip, or null"
        ),
    ] = ()
    sentence: Annotated[str | None, worded("the same in words")] = field(default=None, kw_only=True)

    @property
    def links_of_an_exact_arm(self) -> bool:
        """Whether it is that the arm was taken as exact."""
        return self.cause == "geometry" and self.amount <= 1


def undecided(explanations: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """The best explanations between which the measurements do not decide: the evidence of none is 20 times
    that of another, all that was tried counted; where repeats that differ are one of them, the noise, which
    would explain anything, comes last; and so does an arm beyond its tolerances. Empty where the first one is
    decided."""
    if not explanations or explanations[0].links_of_an_exact_arm:
        return ()
    rivals = [one for one in explanations if one.odds > explanations[0].odds / DECIDED]
    last = {*BEYOND_TOLERANCES, *(["noise"] if any(one.cause == "repeats" for one in rivals) else [])}
    rivals.sort(key=lambda one: one.cause in last)
    return tuple(rivals) if len(rivals) > 1 else ()


def diagnose(solution: Solution) -> tuple[Explanation, ...]:
    """What explains that a solution contradicts its noise or priors, or did not converge, the best
    explanation first.

    Empty where nothing does, or where there is nothing to explain.
    """
    if not solution.converged:
        return _of_no_fit(solution)
    if solution.misfit is None:
        return ()
    problem, x = _at_stated_noise(solution)
    slack = 1.0 if solution.problem.noise.known else _SLACK
    density = Density(problem)
    (answer,) = fits_at(density, x[None])
    # What changed during the run may leave residuals that agree with the noise: the test for it does not. So
    # may what is wrong with a measurement, and only strain the tolerances.
    changed = any(isinstance(one, RunChange) for one in solution.misfit.criteria)
    strained = all(isinstance(one, TightPrior) for one in solution.misfit.criteria)
    if answer.agrees(slack) and not changed and not strained:  # and so does the best fit at the stated noise
        return ()
    ended, (base,) = fits_from(density, x[None])
    if base.agrees(slack) and not changed and not strained:
        return ()
    fits = list(hypothesis_fits(problem, ended[0], slack))
    if any(isinstance(one, RepeatsApart) for one in solution.misfit.criteria):
        fits = [fit for fit in fits if fit.cause in _MAKES_REPEATS_DIFFER]
    explained = tuple(
        replace(one, readings=misreadings(problem, ended[0], base, one.measurements[0], slack, _scatter(one)))
        if one.cause == "measurements" and len(one.measurements) == 1
        else one
        for one in _explanations(base, fits, slack, exact=not problem.geometry, decided=strained)
    )
    if strained and not any(one.cause not in BEYOND_TOLERANCES for one in explained):
        return ()  # the criterion itself says which tolerance, and how large it would have to be
    weighted = bool((solution.problem.weights != 1).any())
    if not solution.problem.noise.known or weighted or solution.dof == 0:
        return explained
    # As the answer itself has it: it judges what is determined at measurements that hit.
    before = float(np.sqrt(solution.against_noise.chi2 / solution.dof))
    return tuple(replace(explanation, before=before) for explanation in explained)


def _of_no_fit(solution: Solution) -> tuple[Explanation, ...]:
    """Of a fit that did not converge: readings that, taken in another way, agree with the noise."""
    if not solution.trusted or not np.isfinite(solution.fit.x).all():
        return ()
    problem, x = _at_stated_noise(solution)
    (base,) = fits_at(Density(problem), x[None])
    slack = 1.0 if solution.problem.noise.known else _SLACK
    fits = [fit for fit in of_readings(problem) if fit.agrees(slack)]
    return _explanations(base, fits, slack, exact=not problem.geometry) if base.dof > 0 else ()


def _at_stated_noise(solution: Solution) -> tuple[Problem, Matrix]:
    """The problem with the noise as stated and known, and the fit's x (p,) without noise factors."""
    problem, x = solution.problem, solution.fit.x
    # Each measurement counts once: it is the misfit's own errors that are correlated.
    problem = replace(problem, weights=np.ones(problem.shots))
    noise = replace(problem.noise, estimated=False, separate=False)
    if not problem.noise.separate:
        return replace(problem, noise=noise), x
    functions = shot_functions(problem.robot, problem.tool, geometry=problem.geometry)
    parameters = problem.parameters
    known = replace(problem, noise=noise, parameters=parameters.without("noise"), functions=functions)
    return known, x[~parameters.group("noise")]


# Judgement


def _explanations(
    base: HypothesisFit,
    fits: Sequence[HypothesisFit],
    slack: float,
    *,
    exact: bool,
    decided: bool = False,
) -> tuple[Explanation, ...]:
    """The hypotheses that explain, by their evidence. Where it is `decided` that something is wrong, although
    the residuals agree with the noise, those that nothing decides between are enough."""
    agreeing = {i for i, left in enumerate(fits) if left.agrees(slack)}
    explaining = agreeing or {i for i, left in enumerate(fits) if left.explains(base, slack)}
    # What is left gives the noise its scale where it is more than the stated, or that is not certain.
    free_scale = not agreeing or slack > 1
    evidence = {i: fits[i].log_evidence(base, free_scale) for i in explaining}
    margin = -float(np.log(SIGNIFICANCE))
    least, behind = (0.0, float(np.log(DECIDED))) if decided else (margin, margin)
    if exact:
        # Links within tolerances are no fault of the data: what blames the data has to be likelier by far.
        links = max((evidence[i] for i in explaining if fits[i].cause == "geometry"), default=-np.inf)
        evidence = {
            i: value
            for i, value in evidence.items()
            if fits[i].cause not in _RIVALS_OF_LINKS or value > links + margin
        }
    rows = _once(sorted(((value, i) for i, value in evidence.items() if value > least), reverse=True), fits)
    best = rows[0][0] if rows else 0.0
    if exact:  # what no arm is without comes first, where it is enough, and nothing is clearly likelier
        enough = best - float(np.log(DECIDED))
        rows.sort(
            key=lambda row: row[1] not in agreeing or fits[row[1]].cause != "geometry" or row[0] <= enough
        )
    return tuple(
        Explanation(
            cause=left.cause,
            joints=left.joints,
            targets=left.targets,
            measurements=left.measurements,
            amount=left.amount,
            factor=left.factor,
            before=base.factor,
            farthest=left.farthest,
            farthest_before=base.farthest,
            freed=left.freed,
            p_value=float(np.exp(-value)),  # of a ratio of likelihoods, by Markov's inequality
            agrees=i in agreeing,
            of=left.of,
            odds=float(np.exp(value - best)),
        )
        for value, i in rows[:_MOST]
        if (left := fits[i]).cause is not None and value > best - behind
    )


def _once(rows: list[tuple[float, int]], fits: Sequence[HypothesisFit]) -> list[tuple[float, int]]:
    """Evidence and place, the best first, without those that say the same."""
    kept: dict[tuple[object, ...], tuple[float, int]] = {}
    for value, i in rows:
        left = fits[i]
        kept.setdefault((left.cause, left.joints, left.targets, left.measurements, left.of), (value, i))
    return list(kept.values())
