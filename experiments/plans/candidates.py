"""Candidate postures for a plan: reachable, in limits, fit for the instrument, hitting nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...analysis.observability.aim import ahead, brought_to_targets, one_turn
from ...analysis.observability.check import Condition
from ...analysis.observability.clearance import Clearance
from ...model.arrays import Mask, Matrix
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.files.plan import Obstacles
from ...model.instruments.kind import Measurement
from ...model.kinematics.robot import Robot
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.problem import Problem
from .constraints import Broken, Conditions, View

_BATCH = 20_000
_MOST_DRAWN_PER_CANDIDATE = 60
_LEAST_DRAWN = 60_000
_SAMPLE = 2000  # postures by which the conditions are judged one by one, where too few satisfy all


# What is counted of the postures that break a condition.
_REASONS: dict[Condition, str] = {
    "limits": "come too near to a joint limit",
    "behind": "have the target behind the laser",
    "beam_mm": "have too short or too long a beam",
    "facing": "meet the target's face from behind or at too flat an angle",
    "itself": "make the arm hit itself",
    "cell": "make the arm hit the floor or a box",
    "beam": "have a box in the beam's way",
    "sight": "have a box in the line of sight",
    "arm": "have the arm itself in the way of the beam or the line of sight",
}


def reason_of(broken: Broken) -> str:
    """What is said of the postures that break a condition."""
    return _REASONS[broken.condition] if broken.why is None else f"in which {broken.why}"


class Planned(NamedTuple):
    """What is measured in a posture: by the instrument of a label and its variant, of a target, if it has
    one."""

    instrument: str
    variant: str = ""
    target: str | None = None

    def in_words(self) -> str:
        return " ".join(filter(None, [self.instrument, self.variant, self.target]))


@dataclass(frozen=True, eq=False)
class CandidatePostures:
    """`postures` (C, n) rad or mm, all aimed, in which `planned` is measured; `drawn` how many were
    tried, `removed` how many each constraint took, in the order in which they were judged: together they are
    all that were drawn. Where fewer than asked for are left, `alone` says what each constraint does by
    itself."""

    postures: Matrix
    planned: Planned
    drawn: int
    removed: dict[str, int]
    alone: ConditionsAlone | None = None

    def in_words(self) -> str:
        """The number that each constraint removed, in words."""
        parts = [f"{count} {reason}" for reason, count in self.removed.items() if count]
        return f"{len(self.postures)} of {self.drawn} postures are left; " + ", ".join(
            parts or ["none removed"]
        )

    def reasons(self) -> str:
        """`in_words`, and where too few are left the decisive constraint first."""
        return self.in_words() if self.alone is None else f"{self.in_words()}. {self.alone.in_words()}"


def pools_in_words(pools: Sequence[CandidatePostures]) -> str:
    """What became of the candidates, of each instrument, target and reflector if there are several."""
    if len(pools) == 1:
        return pools[0].in_words()
    return "; ".join(f"{pool.planned.in_words()}: {pool.in_words()}" for pool in pools)


@dataclass(frozen=True)
class ConditionsAlone:
    """Of `aimed` postures that can be turned onto the target: how many each constraint `removes`, and how
    many would be left `without` it, if all others stay."""

    aimed: int
    removes: dict[str, int]
    without: dict[str, int]

    def in_words(self) -> str:
        """The constraint first without which most would be left; of the others that which removes most."""
        if not self.aimed:
            return "No posture can be rotated onto the target: it is out of reach or out of sight"
        order = sorted(self.removes, key=lambda reason: (-self.without[reason], -self.removes[reason]))
        parts = [
            f"{self.removes[reason]} {reason} ({self.without[reason]} would be left without this condition)"
            for reason in order
            if self.removes[reason]
        ]
        return (
            f"Of {self.aimed} postures rotated onto the target, judged by one condition alone: "
            + ", ".join(parts or ["none is removed"])
        )


def candidates(
    header: Header,
    robot: Robot,
    target: Matrix | None,
    count: int,
    *,
    view: View | None = None,
    obstacles: Obstacles | None = None,
    seed: int = 0,
    planned: Planned | None = None,
    progress: Callable[[float], None] | None = None,
) -> CandidatePostures:
    """Draw postures evenly over the joint ranges, turn the arm to the target, keep what is fit.

    By default what the only instrument measures of its target is `planned`; `target` (3,) are the numbers of
    the target, None where the header says enough of it or there is none. A beam is turned by the wrist, and
    only from postures drawn with the target before the laser; a tip is brought there by all joints; what
    reads wherever the arm stands stays where it was drawn. Fewer than `count` may come back: drawing stops
    after a bounded number of tries. Raises BadInput for contradictory constraints.
    """
    view = view or View()
    _check(view, count)
    if planned is None:
        kind = header.instrument
        planned = Planned(header.labels[0], target=header.only_target if kind.target_kinds() else None)
    lower, upper = view.limits(robot)
    lowest, highest = one_turn(robot, lower, upper)
    rng = np.random.default_rng(seed)
    measured = [[Measurement(*planned, {})]] * _BATCH
    untied = header.model_copy(update={"distances": (), "angles": ()})  # the others are not measured here
    problem = Problem.of_measured(untied, robot, np.zeros((_BATCH, robot.n)), measured, planned=True)
    problem = problem.with_geometry(NOMINAL)  # nominal: so the Jacobians are small
    x = problem.nominal()
    if target is not None:
        x[problem.parameters.group("target")] = target
    clearance = Clearance(problem, obstacles)
    removed: Counter[str] = Counter()
    kept: list[Matrix] = []
    sample: Conditions | None = None  # on postures of the first draw that can be turned onto the target
    drawn = left_count = 0
    most = max(_LEAST_DRAWN, _MOST_DRAWN_PER_CANDIDATE * count)
    while left_count < count and drawn < most:
        joints = rng.uniform(lowest, highest, size=(_BATCH, robot.n))
        drawn += _BATCH
        turnable = problem.moved(joints)
        if problem.tool.beam:
            before = ahead(turnable, x)
            turnable = turnable.select(np.flatnonzero(before))
            removed[_REASONS["behind"]] += int((~before).sum())
        aimed, reached = brought_to_targets(turnable, x, header.targets, rng)
        conditions = Conditions(aimed, x, view, clearance, header.targets)
        if sample is None:
            some = aimed.select(np.flatnonzero(reached)[:_SAMPLE])
            sample = Conditions(some, x, view, clearance, header.targets)
        left = _fit(conditions, reached, removed)
        kept.append(left)
        left_count += len(left)
        if progress is not None:
            progress(min(left_count / count, 1.0))
        if left_count == 0 and drawn >= _LEAST_DRAWN:
            break
    if left_count > count:
        removed["are more than asked for"] = left_count - count
    alone = None if left_count >= count or sample is None else _alone(sample)
    return CandidatePostures(np.concatenate(kept)[:count], planned, drawn, removed, alone)


def _fit(conditions: Conditions, hit: Mask, removed: Counter[str]) -> Matrix:
    """The joints of the measurements that satisfy everything; `removed` counts the others by their first
    fault."""
    left = hit.copy()
    removed["cannot be rotated onto the target (out of reach or out of sight)"] += int((~hit).sum())
    for condition, breaks in conditions.in_order():
        rows = np.flatnonzero(left)
        broken = rows[breaks(rows)] if len(rows) else rows
        removed[reason_of(condition)] += len(broken)
        left[broken] = False
    return conditions.joints[left]


def _alone(conditions: Conditions) -> ConditionsAlone:
    """The effect of each condition alone on postures that are all turned onto the target."""
    rows = np.arange(len(conditions.joints))
    broken = {
        reason_of(condition): breaks(rows) if len(rows) else np.zeros(0, dtype=bool)
        for condition, breaks in conditions.in_order()
    }
    faults = np.sum(list(broken.values()), axis=0)
    return ConditionsAlone(
        len(rows),
        {reason: int(mask.sum()) for reason, mask in broken.items()},
        {reason: int((faults - mask == 0).sum()) for reason, mask in broken.items()},
    )


def _check(view: View, count: int) -> None:
    if count < 1:
        raise BadInput("no candidates are asked for", found=count, allowed="1 or more")
    shortest, longest = view.beam or (0.0, np.inf)
    if not 0 <= shortest < longest:
        raise BadInput(
            "no beam is within the stated lengths",
            found=f"{shortest:g} to {longest:g} mm",
            allowed="a shortest beam of 0 or more and below the longest",
        )
    if view.facing is not None and not np.linalg.norm(view.facing) > 0:
        raise BadInput("the target's face has no direction", found=list(view.facing), allowed="not all 0")
    if not 0 < view.acceptance <= np.pi / 2:
        raise BadInput(
            "the target's acceptance angle cannot be used",
            found=f"{np.degrees(view.acceptance):g} deg",
            allowed="above 0 and up to 90 deg",
        )
