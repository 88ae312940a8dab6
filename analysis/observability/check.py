"""The verdict on a plan before any measurement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Final, Literal, Self, cast

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.errors import BadInput
from ...model.files.plan import Plan
from ...model.kernel import one_blas_thread
from ...model.kinematics.pendant import beyond_limits, nearest_limit
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record, worded
from ..covariance import Rows, frame
from ..status import Status, Verdict, has_numbers, verdict_of, versions
from . import remedies
from .aim import Aimed, AimedPlan, aim_plan
from .causes import JudgedRow, Tried
from .geometry_result import GeometryResult, geometry_result, tolerance_share
from .identifiability import Identifiability, identify
from .outlook import Outlook, Prospect, Prospects
from .power import DetectionPower, powers
from .predictions import (
    CurvePoint,
    OverTarget,
    curve,
    mounted_spread,
    over_target,
    predicted_covariance,
    predicted_std,
    typical,
)
from .remedies import Allowed, RemedySearch

if TYPE_CHECKING:
    import pandas as pd

# "violated": the plan breaks its own constraints, whatever it would determine.
PlanVerdict = Verdict | Literal["violated"]
Planned = Literal["pass", "weak", "degenerate", "violated"]  # a plan has no misfit
CHECK_SCHEMA: Final = "zerobeam/check/1"
Condition = Literal[
    "limits", "behind", "beam_mm", "facing", "itself", "cell", "beam", "sight", "arm", "unfit"
]


@dataclass(frozen=True)
class Violation:
    """Posture `posture` (from 0) breaks `constraint`, a key of the plan's `constraints`, or is one in which
    its "instrument" cannot measure.

    `condition`: "limits" (a joint is nearer to a limit than the margin), "beam_mm", "facing", "itself" (the
    arm touches itself), "cell" (it touches the floor or a box), "beam" (a box is in the beam's way), "sight"
    (a box is in the line of sight), "arm" (a link of the arm is in the way of either), "unfit" (`why`, a
    clause). `at` is the value found, `lowest` to `highest` are allowed, in `unit`; None for what is touched.
    `joint` (from 1) is that of "limits", or moves the link of "arm" (0: the base); `via` (from 0) an
    intermediate posture on the way to the posture. `planned`: it is broken by the posture as written, and no
    longer once the wrist is turned onto the target. `assumed`: the radius of the links is nowhere stated.
    """

    posture: int
    constraint: Literal["acceptance_deg", "beam_mm", "margin_deg", "obstacles", "instrument"]
    condition: Condition
    at: float | None = None
    lowest: float | None = None
    highest: float | None = None
    unit: str | None = None
    joint: int | None = None
    via: int | None = None
    planned: bool = False
    why: str | None = None
    assumed: bool = False

    @property
    def unseen(self) -> bool:
        """Whether the posture gives no measurement: the beam does not come to the front of the target, or the
        instrument cannot measure."""
        return self.condition in ("behind", "facing", "beam", "sight", "arm", "unfit")


@record(repr=False, kw_only=True)
class CheckedParameter(JudgedRow):
    """One unknown before the shots."""

    std: Annotated[
        float | None,
        it(
            "of measurements and prior together; null for an unidentifiable parameter, where it would"
            " be the prior's, and for a held one"
        ),
    ]


class CheckedTable(Rows[CheckedParameter]):
    """Rows of a check, by their order or by name, and as a pandas table."""

    __slots__ = ()

    def to_frame(self) -> pd.DataFrame:
        """A pandas DataFrame: a row for each parameter, by its name.

        Columns are unit, status, u (predicted standard uncertainty; nan where the plan cannot determine the
        parameter) and prior_std, in the unit of the row. BadInput without pandas.
        """
        keys = ("name", "unit", "status", "u", "prior_std")
        rows = [{key: getattr(row, key) for key in keys} for row in self]
        return frame(rows).set_index("name").astype({"u": float, "prior_std": float})


@dataclass(frozen=True)
class CheckedPosture:
    """`off_mm`: how far the posture's beam is off its target before the wrist is turned; `violations`: what
    the posture breaks of the plan's constraints."""

    posture: int
    target: str
    off_mm: float
    hit: bool
    violations: tuple[Violation, ...] = ()


@dataclass(frozen=True)
class WithoutPosture:
    """What a plan determines without one of its postures: the verdict, and of each offset its status and
    `std` (deg or mm), None where the rest of the plan cannot determine it."""

    posture: int
    verdict: Verdict
    status: dict[str, Status]
    std: dict[str, float | None]


@dataclass(frozen=True)
class Unreachable:
    """From these postures the target cannot be hit."""

    postures: tuple[int, ...]


@dataclass(frozen=True)
class TargetBehind:
    """In these postures the target is behind the laser; in `every` one that hits."""

    postures: tuple[int, ...]
    every: bool


@dataclass(frozen=True)
class OutsideLimits:
    """Turned onto the target, `joint` (from 1) of `posture` is at `at`, outside `limits` (deg or mm), which
    are of what `counting` says (empty: of the joint)."""

    posture: int
    joint: int
    at: float
    unit: str
    limits: tuple[float, float]
    counting: str = ""


PlanFinding = Unreachable | TargetBehind | OutsideLimits


@dataclass(frozen=True)
class PlanInputs:
    """What a check was made from."""

    plan: str
    sha256: str
    robot: str
    versions: dict[str, str]


@record
class Check:
    """The answer to `zerobeam check`, in degrees and mm.

    Attributes
    ----------
    verdict : str
        "pass", "weak" or "degenerate", over all offsets; "violated" where a posture breaks a constraint of
        the plan.
    parameters : CheckedTable of CheckedParameter
        A row for each parameter: `name`, `unit`, `status`, `u` (predicted standard uncertainty, None where
        the plan cannot determine it), `data_std` (without prior), `prior_std`, `cause`.
    identifiability : Identifiability
        Rank, singular values, and the null-space directions with causes.
    power : tuple of DetectionPower
        With which probability a run of this plan notices a wrong model; empty where nothing is tested.
    geometry : GeometryResult
        Tolerances of the geometry, and what the offsets will be worth if it is taken as nominal.
    postures : tuple of CheckedPosture
        How far each posture's beam is off its target before the wrist is turned, mm, and what the posture
        breaks of the plan's constraints.
    curve, over_target
        The largest u by number of measurements; u over where the target may be.
    outlook : Outlook or None
        Remedies by their predicted gain; None where they were not asked for.
    advice : None
        The key stays for those who read it: the outlook has replaced it.
    findings, warnings : tuple
        Findings and warnings, to be read with the verdict.
    inputs : PlanInputs
        What the check was made from.
    aimed : AimedPlan
        The plan with the wrist turned onto the target, as it was judged.

    Examples
    --------
    `zerobeam.check` gives one:

    >>> import zerobeam as zb
    >>> issubclass(zb.CheckedPlan, zb.Check)
    True
    """

    schema: Annotated[Literal["zerobeam/check/1"], it("kind and version of the document")] = field(
        default=CHECK_SCHEMA, kw_only=True
    )
    verdict: Annotated[Planned, it("`violated` where a posture breaks a constraint of the plan")]
    parameters: Annotated[CheckedTable, it("a row each")]
    identifiability: Annotated[Identifiability, it("as in a result")]
    power: Annotated[
        tuple[DetectionPower, ...],
        it(
            "the power of the χ² of a run against wrong models, as in a result. Empty where the noise"
            " is estimated, or no degree of freedom is left"
        ),
    ]
    geometry: Annotated[
        GeometryResult,
        it("as in a result: what the offsets will be worth if the arm deviates from nominal geometry"),
    ]
    postures: Annotated[
        tuple[CheckedPosture, ...],
        it(
            "a list of `posture` (from 0), `target`, `off_mm` (distance from the target before the "
            "wrist was rotated), `hit` (whether the wrist can bring the beam onto the target), "
            "`violations`: a list of `posture` (from 0), `constraint` (`acceptance_deg`, `beam_mm`, "
            "`margin_deg`, `obstacles`, `instrument`: it cannot measure there), `condition` "
            "(`facing`, `beam_mm`, `limits`: too near to a joint limit, `itself`: the arm touches "
            "itself, `cell`: the floor or a box, `beam`: a box is in its way, `sight`: a box is in "
            "the line of sight, `arm`: a link of the arm is in the way of either: `at` from its axis,"
            " `lowest` its radius, which is `assumed` where nothing states it, `unfit`: `why`, a "
            "clause, is null else), the value `at`, `lowest` and `highest` allowed, in `unit` (null "
            "for what is touched), `joint` (from 1; of `arm` the link that it moves, 0 the base), "
            "`via` (from 0: an intermediate posture before the posture), `planned` (broken by the "
            "posture as written, not with the wrist rotated onto the target)"
        ),
    ]
    curve: Annotated[
        tuple[CurvePoint, ...],
        it(
            "a list of `shots` (2, 3, …, in the plan's order) and `worst_std` (the largest u of an "
            "offset with that many measurements, priors included)"
        ),
    ]
    over_target: Annotated[
        OverTarget | None,
        it(
            "the plan with its targets at random positions by their `sigma_mm`: `draws` (how many "
            "positions), `hit` (share of the postures that can be rotated onto them), `worst_std` (of"
            " each offset, the largest u over the positions), `mounts`: also with reflectors, mounts "
            "and tips at random places on the flange, by their sigma, of 50 mm and 30° where they are"
            " only guessed; null where no target has both `guess_mm` and `sigma_mm` and no such place"
            " is open. With `mounts` every predicted `std` is that at a typical place: the one whose "
            "u are nearest to the root mean squares over 256"
        ),
    ]
    findings: Annotated[tuple[PlanFinding, ...], internal]
    warnings: Annotated[tuple[str, ...], internal]
    inputs: Annotated[PlanInputs, it("`plan`, `sha256`, `robot`, `versions`")]
    aimed: Annotated[AimedPlan, internal] = field(compare=False, repr=False)
    outlook: Annotated[Outlook | None, it("what would make it better: remedies by their predicted gain")] = (
        field(default=None, kw_only=True)
    )
    advice: Annotated[None, it("null: `outlook` says more")] = field(default=None, kw_only=True)
    headline: Annotated[str | None, worded("the same in a sentence")] = field(default=None, kw_only=True)
    notes: Annotated[tuple[str, ...] | None, worded("findings in sentences, violations first")] = field(
        default=None, kw_only=True
    )

    @property
    def worst(self) -> float | None:
        """The largest predicted u of an offset, degrees (mm); None where the plan leaves one undetermined."""
        stds = [row.std for row in self.parameters if row.group == "offset" and not row.held]
        known_stds = [std for std in stds if std is not None]
        return max(known_stds) if known_stds and len(known_stds) == len(stds) else None

    @property
    def falls_short(self) -> bool:
        """Whether what is required of the robot is predicted not to be met."""
        return self.outlook is not None and self.outlook.falls_short

    @property
    def violations(self) -> tuple[Violation, ...]:
        """What the postures break of the plan's constraints, in their order."""
        return tuple(each for posture in self.postures for each in posture.violations)

    @classmethod
    def of(
        cls,
        turned: AimedPlan,
        violations: tuple[Violation, ...] = (),
        allowed: Allowed | None = None,
        prospects: Prospects | None = None,
    ) -> Self:
        """Judge a plan with the wrist turned onto the target, as the servo will turn it.

        `violations` are what the plan breaks of its constraints (`experiments.plans.constraints.violations`
        finds them), `allowed` says which other aimed shots keep to them. With `prospects` it has an outlook.
        Needs no compiler and no sampling: everything follows from the exact Jacobian at the nominal values
        before any shot.
        """
        plan, problem, x, aimed = turned.plan, turned.problem, turned.x, turned.aimed
        with one_blas_thread():
            shots = _shots(plan, aimed, violations)
            identified = identify(shots, x)
            mounted = mounted_spread(plan.header, problem)
            # Observable is what is so with everything as guessed; the u are those of where it may be.
            judged, at = typical(shots, x, mounted)
            covariance = predicted_covariance(judged, at)
            geometry = geometry_result(plan.header, judged, at, covariance, identified.status)
            promised = curve(judged, at)
            spread = _stated_spread(plan, problem) + mounted
            elsewhere = over_target(problem, x, spread, mounts=bool(mounted.any()))
            parameters = problem.parameters
            observable = verdict_of(identified.status[parameters.block("offset")])
            taken = np.flatnonzero(_taken(aimed, violations))  # postures that give a measurement
            search = RemedySearch(
                shots, x, identified.status, np.sqrt(np.diag(covariance)), taken.tolist(), allowed=allowed
            )
            null_space = search.with_remedies(identified.facts.null_space)
            identified = replace(identified, facts=replace(identified.facts, null_space=null_space))
            outlook = None
            if prospects is not None:
                outlook = Prospect(
                    header=plan.header,
                    problem=judged,
                    x=at,
                    status=identified.status,
                    rests_on=identified.rests_on,
                    covariance=covariance,
                    estimated=False,
                    prospects=prospects,
                ).outlook()
        std = parameters.unscaled(np.sqrt(np.diag(covariance)))
        share = parameters.unscaled(tolerance_share(judged, covariance)) / parameters.prior_std
        rows = []
        for i, item in enumerate(parameters.items):
            status, data_std = identified.status[i], float(identified.data_std[i])
            by_tolerances = float(share[i]) if has_numbers(status) and len(problem.tolerated) else None
            rows.append(
                CheckedParameter(
                    name=item.name,
                    unit=item.unit,
                    group=item.group,
                    status=status,
                    data_std=data_std * item.display if np.isfinite(data_std) else None,
                    std=float(std[i]) * item.display if has_numbers(status) else None,
                    prior_std=item.prior_std * item.display,
                    cause=identified.cause(item, status, by_tolerances),
                    tolerance_share=by_tolerances,
                    tolerated=item.tolerated,
                )
            )
        return cls(
            verdict=cast(Planned, "violated" if violations else observable),
            parameters=CheckedTable(rows),
            identifiability=identified.facts,
            power=powers(judged, at, identified),
            geometry=geometry,
            postures=tuple(
                CheckedPosture(
                    i,
                    plan.called[row],
                    float(aimed.off_mm[i]),
                    bool(aimed.hit[i]),
                    tuple(each for each in violations if each.posture == i),
                )
                for i, row in enumerate(problem.shot_numbers)
            ),
            curve=promised,
            over_target=elsewhere,
            outlook=outlook,
            findings=tuple(_findings(plan, aimed)),
            warnings=plan.warnings,
            inputs=PlanInputs(plan.path.name, plan.sha256, plan.robot.name, versions()),
            aimed=turned,
        )


def check(plan: Plan) -> Check:
    """Judge a plan without regard to its constraints."""
    return Check.of(aim_plan(plan))


def measured_shots(check: Check) -> tuple[Problem, list[int]]:
    """The aimed shots of a plan that give a measurement, and which of its postures they are."""
    taken = np.flatnonzero(_taken(check.aimed.aimed, check.violations))
    return check.aimed.aimed.problem.select(taken), taken.tolist()


def carried_out(check: Check, tried: Tried) -> tuple[Matrix, tuple[int, ...]]:
    """(M, n) rad or mm: the new postures of a remedy of a plan, aimed; and of each which posture of the plan
    it is like."""
    shots, numbers = measured_shots(check)
    return remedies.carried_out(shots, check.aimed.x, tried, numbers).joints, tried.postures


def without_posture(
    turned: AimedPlan, posture: int, violations: tuple[Violation, ...] = ()
) -> WithoutPosture | None:
    """What the plan determines without a posture, judged as a plan of the others would be.

    None where the posture gives no measurement (its target cannot be hit or seen), or the plan has no other.
    """
    kept = np.flatnonzero(_taken(turned.aimed, violations))
    if posture not in kept or len(kept) < 2:
        return None
    rest = turned.aimed.problem.select(kept[kept != posture])
    with one_blas_thread():
        identified = identify(rest, turned.x)
        spread = predicted_std(*typical(rest, turned.x, mounted_spread(turned.plan.header, turned.problem)))
    items, std = rest.parameters.items, rest.parameters.unscaled(spread)
    offsets = rest.parameters.block("offset")
    judged = list(zip(items, identified.status, std, strict=True))[offsets]
    return WithoutPosture(
        posture,
        verdict_of(identified.status[offsets]),
        {item.name: status for item, status, _ in judged},
        {
            item.name: float(value) * item.display if has_numbers(status) else None
            for item, status, value in judged
        },
    )


def _taken(aimed: Aimed, violations: tuple[Violation, ...]) -> Mask:
    """(N,) which postures give a measurement; all that hit where no beam comes to its target's face."""
    taken = aimed.hit & aimed.ahead
    taken[[each.posture for each in violations if each.unseen]] = False
    return taken if taken.any() else aimed.hit


def _shots(plan: Plan, aimed: Aimed, violations: tuple[Violation, ...]) -> Problem:
    """The shots that the plan will give: those of the postures that can be turned onto their targets.

    If every beam leaves away from its target, or comes from behind its face, it is the direction stated of
    tool or face that is in doubt: the lines are judged then, and a note says so.
    """
    if not aimed.hit.any():
        raise BadInput(
            "no posture of the plan can be rotated onto its target",
            found=f"the nearest is {aimed.off_mm.min():.0f} mm off",
            remedy="correct the target's guess_mm, the tool or the postures",
            file=plan.path,
        )
    return aimed.problem.select(np.flatnonzero(_taken(aimed, violations)))


def _stated_spread(plan: Plan, problem: Problem) -> Matrix:
    """(p,) std of each target's position, mm; 0 where the header does not state its sigma."""
    spread = np.zeros(len(problem.parameters))
    for k, name in enumerate(problem.targets):
        target = plan.header.targets.get(name)
        if target is not None and "sigma_mm" in target.model_fields_set and target.guess_mm is not None:
            spread[problem.parameters.block("target", k)] = target.sigma_mm
    return spread


def _findings(plan: Plan, aimed: Aimed) -> Iterator[PlanFinding]:
    missed = np.flatnonzero(~aimed.hit)
    if len(missed):
        yield Unreachable(tuple(int(i) for i in missed))
    behind = np.flatnonzero(aimed.hit & ~aimed.ahead)
    if len(behind):
        yield TargetBehind(tuple(int(i) for i in behind), every=len(behind) == int(aimed.hit.sum()))
    robot, turned = plan.robot, aimed.problem.joints
    for i, j in np.argwhere(beyond_limits(robot, turned)):
        limit = nearest_limit(robot, turned[i], int(j))
        ends = (limit.lower, limit.upper)
        unit = robot.joints[j].unit
        yield OutsideLimits(int(i), int(j) + 1, limit.value, unit, ends, limit.counting)
