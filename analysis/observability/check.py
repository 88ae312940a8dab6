"""Will this plan work? The verdict on a plan before any shot."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...model.errors import BadInput
from ...model.files.plan import Plan
from ...model.problem import Problem
from ...model.robot import Matrix
from ..result import Group, Identifiability, Status, Verdict, versions
from .aim import Aimed, AimedPlan, aim_plan
from .identifiability import identify
from .outlook import Advice, CurvePoint, OverTarget, advice, curve, over_target, predicted_std
from .verdict import listed, reason_for, verdict, verdict_sentence


@dataclass(frozen=True)
class CheckedParameter:
    """One unknown before the shots: `data_std` None for an exact gauge or a held one; `std` what the
    calibration will know it to, None where it cannot know it."""

    name: str
    unit: str
    group: Group
    status: Status
    held: bool
    data_std: float | None
    std: float | None
    prior_std: float
    reason: str | None


@dataclass(frozen=True)
class CheckedPosture:
    """`off_mm`: how far the posture's beam is off its target before the wrist is turned."""

    posture: int
    target: str
    off_mm: float
    hit: bool


@dataclass(frozen=True)
class Check:
    """The answer to `zerobeam check`, in units that people read."""

    verdict: Verdict
    headline: str
    parameters: tuple[CheckedParameter, ...]
    identifiability: Identifiability
    postures: tuple[CheckedPosture, ...]
    curve: tuple[CurvePoint, ...]
    over_target: OverTarget | None
    advice: Advice | None
    notes: tuple[str, ...]
    inputs: dict[str, Any]


def check(plan: Plan, turned: AimedPlan | None = None) -> Check:
    """Judge a plan with the wrist turned onto the target, as the servo will turn it (`turned`, once it was).

    Needs no compiler and no sampling: everything follows from the exact Jacobian at what is supposed
    before any shot.
    """
    turned = aim_plan(plan) if turned is None else turned
    problem, x, aimed = turned.problem, turned.x, turned.aimed
    with threadpool_limits(limits=1, user_api="blas"):
        shots = _shots(plan, aimed)
        identified = identify(shots, x)
        known = predicted_std(shots, x)
        promised = curve(shots, x)
        elsewhere = over_target(problem, x, _stated_spread(plan, problem))
        better = None if verdict(problem, identified) == "pass" else advice(shots, x)
    parameters = problem.parameters
    std = parameters.unscaled(known)
    rows = []
    for i, item in enumerate(parameters.items):
        status, data_std = identified.status[i], float(identified.data_std[i])
        rows.append(
            CheckedParameter(
                name=item.name,
                unit=item.unit,
                group=item.group,
                status=status,
                held=item.held,
                data_std=data_std * item.display if np.isfinite(data_std) else None,
                std=float(std[i]) * item.display if status in ("identified", "weak") else None,
                prior_std=item.prior_std * item.display,
                reason=reason_for(identified, item, status),
            )
        )
    return Check(
        verdict=verdict(problem, identified),
        headline=verdict_sentence(problem, identified),
        parameters=tuple(rows),
        identifiability=identified.facts,
        postures=tuple(
            CheckedPosture(i, plan.targets[i], float(aimed.off_mm[i]), bool(aimed.hit[i]))
            for i in range(problem.shots)
        ),
        curve=promised,
        over_target=elsewhere,
        advice=better,
        notes=_notes(plan, aimed),
        inputs={
            "plan": plan.path.name,
            "sha256": plan.sha256,
            "robot": plan.robot.name,
            "versions": versions(),
        },
    )


def check_json(answer: Check) -> dict[str, Any]:
    """`zerobeam/check/1`: plain JSON types, null where there is no number."""
    return {"schema": "zerobeam/check/1", **asdict(answer)}


def _shots(plan: Plan, aimed: Aimed) -> Problem:
    """The shots that the plan will give: those of the postures that can be turned onto their targets.

    If every beam leaves away from its target it is the tool's direction that is in doubt: the lines are
    judged then, and a note says so.
    """
    if not aimed.hit.any():
        raise BadInput(
            "no posture of the plan can be turned onto its target",
            found=f"the nearest is {aimed.off_mm.min():.0f} mm off",
            remedy="correct the target's guess_mm, the tool or the postures",
            file=plan.path,
        )
    taken = aimed.hit & aimed.ahead
    return aimed.problem.select(np.flatnonzero(taken if taken.any() else aimed.hit))


def _stated_spread(plan: Plan, problem: Problem) -> Matrix:
    """(p,) std of where each target may stand, mm; 0 where the header does not state its sigma."""
    spread = np.zeros(len(problem.parameters))
    for k, name in enumerate(problem.targets):
        stated = plan.header.targets.get(name)
        if stated is not None and "sigma_mm" in stated.model_fields_set and stated.guess_mm is not None:
            spread[problem.parameters.block("target", k)] = stated.sigma_mm
    return spread


def _notes(plan: Plan, aimed: Aimed) -> tuple[str, ...]:
    notes = []
    missed = np.flatnonzero(~aimed.hit)
    if len(missed):
        notes.append(
            f"From posture {listed([str(i) for i in missed])} the target cannot be hit:"
            " no shot is counted there"
        )
    behind = np.flatnonzero(aimed.hit & ~aimed.ahead)
    if len(behind) and len(behind) == int(aimed.hit.sum()):
        notes.append("Every target is behind the laser: is the sign of tool.direction right?")
    elif len(behind):
        notes.append(
            f"In posture {listed([str(i) for i in behind])} the target is behind the laser:"
            " no shot is counted there"
        )
    robot, turned = plan.robot, aimed.problem.joints
    slack = 1e-9
    for i, j in np.argwhere((turned < robot.lower - slack) | (turned > robot.upper + slack)):
        joint = robot.joints[j]
        notes.append(
            f"Turned onto the target, joint {j + 1} of posture {i} stands at"
            f" {turned[i, j] * joint.display:.1f} {joint.unit}, outside"
            f" {joint.lower * joint.display:.0f} to {joint.upper * joint.display:.0f}"
        )
    return (*notes, *plan.warnings)
