"""Conditions on measurements: they choose the postures of a plan, and they judge a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ...analysis.observability.aim import AimedPlan, aim_plan
from ...analysis.observability.better_postures import usual_constraints
from ...analysis.observability.check import Check, Condition, Violation
from ...analysis.observability.clearance import Clearance, InTheWay, blocked_lines, ends_of_lines
from ...analysis.observability.outlook import Prospects
from ...analysis.observability.remedies import Allowed
from ...model.arrays import Index, Mask, Matrix
from ...model.errors import BadInput, located
from ...model.files.header import Header, StatedTarget
from ...model.files.plan import Plan, StatedConstraints
from ...model.files.run import Run
from ...model.instruments.kind import Measurement, Target
from ...model.kernel import one_blas_thread
from ...model.kinematics.pendant import beyond_limits
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem, by_posture

# A plan file has its postures to 1e-6 deg: what was chosen at a bound is still within it when read again.
_ROUNDED_RAD = 1e-6
_ROUNDED_MM = 1e-3


@dataclass(frozen=True)
class View:
    """Conditions on the view of the target. Lengths mm, angles rad; None: not judged.

    `facing` is the outward normal of the PSD's face in the base frame (None: any side); `acceptance` the
    largest angle between beam and normal; `beam` the shortest and longest beam; `margin` is kept to every
    joint limit (rad; for prismatic joints as a share of a metre).
    """

    facing: tuple[float, float, float] | None = (0.0, 0.0, 1.0)
    acceptance: float = float(np.radians(60.0))
    beam: tuple[float, float] | None = (200.0, 2000.0)
    margin: float = float(np.radians(5.0))

    @classmethod
    def of(cls, constraints: StatedConstraints) -> View:
        """The view that a plan file states."""
        return cls(
            facing=constraints.facing,
            acceptance=float(np.radians(constraints.acceptance)),
            beam=constraints.beam_mm,
            margin=float(np.radians(constraints.margin_deg or 0.0)),
        )

    def rounded(self) -> View:
        """A view that is wider by what a plan file rounds off its postures."""
        return replace(
            self,
            acceptance=self.acceptance + _ROUNDED_RAD,
            beam=None if self.beam is None else (self.beam[0] - _ROUNDED_MM, self.beam[1] + _ROUNDED_MM),
            margin=max(self.margin - _ROUNDED_RAD, 0.0),
        )

    def limits(self, robot: Robot) -> tuple[Matrix, Matrix]:
        """(n,) lower and upper limits with the margin kept; BadInput where that leaves nothing of a joint."""
        if not self.margin >= 0:
            raise BadInput("the margin to the joint limits is negative", found=f"{self.margin:g} rad")
        margin = np.array([self.margin * (1.0 if j.kind == "revolute" else 1000.0) for j in robot.joints])
        lower, upper = robot.lower + margin, robot.upper - margin
        for number, (joint, low, high) in enumerate(zip(robot.joints, lower, upper, strict=True), start=1):
            if low >= high:
                raise BadInput(
                    f"the margin leaves nothing of the range of joint {number} ({joint.name})",
                    found=f"{joint.lower * joint.display:.1f} to {joint.upper * joint.display:.1f}"
                    f" {joint.unit}, a margin of {margin[number - 1] * joint.display:.1f} {joint.unit}",
                    allowed="a margin below half of every joint's range",
                )
        return lower, upper


class Broken(NamedTuple):
    """A condition that is broken, or may be; with "unfit" `why`, a clause."""

    condition: Condition
    why: str | None = None


class Conditions:
    """The conditions on the postures of a problem of a single instrument that are turned onto their targets
    at the parameters x; `entries` are what a header says of targets."""

    def __init__(
        self,
        problem: Problem,
        x: Matrix,
        view: View,
        clearance: Clearance,
        entries: Mapping[str, StatedTarget],
    ) -> None:
        self._problem, self._view, self._clearance = problem, view, clearance
        lower, _ = view.limits(problem.robot)
        self._margin = lower - problem.robot.lower
        self.joints = problem.joints
        self._poses = problem.poses(x)
        self._origin, self._direction = problem.beams(x)
        numbers = problem.split(x).targets
        self._targets = [
            Target(each, entries.get(name)) for each, name in zip(numbers, problem.targets, strict=True)
        ]
        places = numbers[problem.target_index]
        self.length = ((places - self._origin) * self._direction).sum(axis=1)

    @property
    def incidence(self) -> Matrix:
        """(N,) rad between the way back along the beam and the target's normal, where one is stated."""
        assert self._view.facing is not None
        normal = np.array(self._view.facing) / np.linalg.norm(self._view.facing)
        return np.asarray(np.arccos(np.clip(-(self._direction @ normal), -1.0, 1.0)))

    def in_order(self) -> Iterator[tuple[Broken, Callable[[Index], Mask]]]:
        """Each condition that is stated, with a function that says of rows (m,) which of them break it.

        Distances between links take the most time: they come last.
        """
        beam, view, clearance = self._problem.tool.beam, self._view, self._clearance
        yield Broken("limits"), lambda rows: np.asarray(self.beyond(rows).any(axis=1))
        for why, mask in self._unfit.items():
            yield Broken("unfit", why), partial(np.take, mask)
        if beam:
            yield Broken("behind"), lambda rows: self.length[rows] <= 0
            if (length := view.beam) is not None:
                yield (
                    Broken("beam_mm"),
                    lambda rows: (self.length[rows] < length[0]) | (self.length[rows] > length[1]),
                )
            if view.facing is not None:
                yield Broken("facing"), lambda rows: self.incidence[rows] > view.acceptance
        if clearance.cell_known:
            yield Broken("itself"), lambda rows: clearance.hits_itself(self.joints[rows])
            yield Broken("cell"), lambda rows: clearance.hits_cell(self.joints[rows])
            yield Broken("beam" if beam else "sight"), self._behind_box
        if self._ends:
            yield Broken("arm"), lambda rows: self.in_the_way(rows).blocked

    @cached_property
    def _unfit(self) -> dict[str, Mask]:
        """(N,) each what prevents the instrument from measuring, in its words."""
        tool, result = self._problem.tool, dict[str, Mask]()
        for k, target in enumerate(self._targets):
            rows = np.flatnonzero(self._problem.target_index == k)
            prevented = tool.prevented(self._poses[rows], target, tool.variants[0])
            for why, mask in prevented.items():
                result.setdefault(why, np.zeros(len(self.joints), dtype=bool))[rows] = mask
        return result

    def beyond(self, rows: Index) -> Mask:
        """(m, n) True where a joint is outside its limits with the margin, as the pendant counts it too."""
        return np.asarray(beyond_limits(self._problem.robot, self.joints[rows], -self._margin))

    @cached_property
    def _ends(self) -> dict[int, Matrix]:
        """(3,) where the lines end that must be free, by the index of the target that they are to."""
        return ends_of_lines(self._problem, self._targets)

    def _behind_box(self, rows: Index) -> Mask:
        blocked = np.zeros(len(rows), dtype=bool)
        for k, end in self._ends.items():
            there = np.flatnonzero(self._problem.target_index[rows] == k)
            blocked[there] = self._clearance.beam_blocked(self._origin[rows[there]], end)
        return blocked

    def in_the_way(self, rows: Index) -> InTheWay:
        """Which body of the arm is in the way of the beam or the line of sight of rows (m,)."""
        return blocked_lines(self._clearance, self._problem, self._origin, self._targets, rows)


def check_plan(plan: Plan, turned: AimedPlan | None = None, *, outlook: bool = True) -> Check:
    """The judgement of a plan: what it will determine, and which of its constraints it breaks.

    Judged with the wrist turned onto the target (`turned`, once it was), as the servo will turn it. Without
    the `outlook` it takes a third of the time.
    """
    turned = aim_plan(plan) if turned is None else turned
    allowed = _keeping(turned, plan.constraints)
    return Check.of(turned, violations(turned), allowed, prospects(turned) if outlook else None)


def prospects(turned: AimedPlan) -> Prospects:
    """What the postures of a plan that is made instead of this one will keep: its constraints, or those of
    `plan optimal` that its postures keep."""
    aimed, stated_constraints = turned.aimed, turned.plan.constraints
    if not stated_constraints.model_fields_set:
        shots = aimed.problem.select(np.flatnonzero(aimed.hit))
        stated_constraints = usual_constraints(shots, turned.x)
    allowed = _keeping(turned, stated_constraints)
    return Prospects(stated_constraints, _all_of if allowed is None else allowed)


def _all_of(shots: Problem) -> Mask:
    return np.ones(shots.shots, dtype=bool)


def require_constraints(plan: Plan) -> None:
    """BadInput for a plan that breaks its own constraints, or has postures in which nothing can be measured
    since the arm is in the way: no robot is to be moved by it."""
    broken = violations(aim_plan(plan))
    if not plan.constraints.model_fields_set:
        broken = tuple(each for each in broken if each.condition == "arm")
    if not broken:
        return
    postures = list(dict.fromkeys(each.posture for each in broken))
    keys = list(dict.fromkeys(each.constraint for each in broken))
    remedy = "correct the postures or targets that zerobeam check names, or the plan's `constraints`"
    if any(each.assumed for each in broken):
        remedy += "; where the links are thinner than 5 % of the arm, state `bodies` in the robot file"
    only_arm = all(each.condition == "arm" for each in broken)
    raise BadInput(
        "the arm is in the way of the beam or the line of sight, and no robot is moved by the plan"
        if only_arm
        else "the plan breaks its own constraints, and no robot is moved by it",
        found=f"posture {', '.join(map(str, postures))} ({', '.join(keys)})",
        remedy=remedy,
        file=plan.path,
    )


def violations(turned: AimedPlan) -> tuple[Violation, ...]:
    """The violations of each posture of a plan of the plan's constraints and of what its instruments can
    measure, in the order of the postures; at one of them several instruments may measure.

    Postures that cannot be turned onto their targets have no beam to be judged: `check` names them. What the
    arm may touch is judged in the postures as written and in the intermediate ones as well.
    """
    with one_blas_thread(), located(turned.plan.path):
        return tuple(sorted(_broken(turned), key=lambda each: each.posture))


def clear_postures(problem: Problem, x: Matrix, run: Run) -> Mask:
    """(N,) in which postures of a run, whose problem this is, the arm is in the way of no instrument, at the
    parameters x (p,)."""
    view, clear = View.of(StatedConstraints()), np.ones(problem.shots, dtype=bool)
    at = dict(zip(problem.parameters.names, x, strict=True))
    _, measured = by_posture(run.measurements)
    for alone, rows in _by_means(problem, run.header, run.robot, measured):
        nominal = zip(alone.parameters.names, alone.nominal(), strict=True)
        x_alone = np.array([at.get(name, value) for name, value in nominal])
        conditions = Conditions(alone, x_alone, view, Clearance(alone, None), run.header.targets)
        clear[rows] &= ~conditions.in_the_way(np.arange(alone.shots)).blocked
    return clear


def touched_boxes(turned: AimedPlan) -> list[bool]:
    """Of each box of the plan's obstacles, whether the arm touches it in any posture or it blocks a beam."""
    obstacles = turned.plan.constraints.obstacles
    if obstacles is None:
        return []
    touched = []
    for box in obstacles.boxes:
        one = obstacles.model_copy(update={"floor_mm": None, "boxes": [box]})
        plan = replace(turned.plan, constraints=StatedConstraints(obstacles=one))
        broken = violations(replace(turned, plan=plan))
        touched.append(any(each.condition in ("cell", "beam", "sight") for each in broken))
    return touched


def _keeping(turned: AimedPlan, constraints: StatedConstraints) -> Allowed | None:
    """Whether other aimed postures would keep to the constraints of a plan of a single instrument."""
    plan = turned.plan
    if len({(item.instrument, item.variant) for item in plan.measurements}) > 1:
        return None
    view, obstacles = View.of(constraints).rounded(), constraints.obstacles

    def allowed(problem: Problem) -> Mask:
        clearance = Clearance(problem, obstacles)
        conditions = Conditions(problem, turned.x, view, clearance, plan.header.targets)
        kept = np.ones(problem.shots, dtype=bool)
        for _, breaks in conditions.in_order():
            rows = np.flatnonzero(kept)
            if len(rows):
                kept[rows] = ~breaks(rows)
        return kept

    return allowed


def _broken(turned: AimedPlan) -> Iterator[Violation]:
    plan, constraints = turned.plan, turned.plan.constraints
    view = View.of(constraints).rounded()
    obstacles, touched = constraints.obstacles, set[tuple[int, Condition]]()
    for part in _parts(turned):
        clearance = Clearance(part.problem, obstacles)
        conditions = Conditions(part.problem, part.problem.nominal(), view, clearance, plan.header.targets)
        every, hit = np.arange(part.problem.shots), np.flatnonzero(part.hit)
        in_front = hit[conditions.length[hit] > 0] if part.problem.tool.beam else hit
        for broken, breaks in conditions.in_order():
            condition = broken.condition
            if condition == "limits" and constraints.margin_deg is None:
                continue  # a finding of `check`
            if condition == "behind" and (not constraints.model_fields_set or view.beam is not None):
                continue  # a finding of `check`; and a beam that is too short
            rows = {"beam_mm": hit, "unfit": hit, "behind": hit}
            rows |= {"facing": in_front, "beam": in_front, "sight": in_front, "arm": in_front}
            chosen = rows.get(condition, every)
            for i in chosen[breaks(chosen)].tolist():
                posture = int(part.postures[i])
                if (posture, condition) in touched and condition in ("limits", *_TOUCHES):
                    continue  # the arm is the same for every instrument
                touched.add((posture, condition))
                yield from _violation(conditions, plan, broken, i, posture, assumed=clearance.assumed)
    if obstacles is None:
        return
    clearance = Clearance(turned.aimed.problem, obstacles)
    for i, row in enumerate(turned.aimed.problem.shot_numbers):
        for via, joints in [(None, plan.postures[row]), *enumerate(plan.via_of(row))]:
            for condition, hits in _TOUCHES.items():
                if (via is None and (i, condition) in touched) or not hits(clearance, joints[None])[0]:
                    continue
                yield Violation(i, "obstacles", condition, via=via, planned=via is None)


_TOUCHES: dict[Condition, Callable[[Clearance, Matrix], Mask]] = {
    "itself": Clearance.hits_itself,
    "cell": Clearance.hits_cell,
}


class _PartOfPlan(NamedTuple):
    """Measurements of a plan by one instrument and variant: their `problem`, turned onto their targets,
    `postures` (N,) at which of the plan they are, `hit` (N,) whether they are turned onto them."""

    problem: Problem
    postures: Index
    hit: Mask


def _parts(turned: AimedPlan) -> Iterator[_PartOfPlan]:
    plan, problem = turned.plan, turned.aimed.problem
    _, measured = by_posture(plan.measurements)
    for alone, rows in _by_means(problem, plan.header, plan.robot, measured):
        yield _PartOfPlan(alone, rows, turned.aimed.hit[rows])


def _by_means(
    problem: Problem, header: Header, robot: Robot, measured: Sequence[Sequence[Measurement]]
) -> Iterator[tuple[Problem, Index]]:
    """Of what is measured at each posture of a problem (N,): the measurements by each instrument and variant
    as a problem of their own, and at which postures they are."""
    by_means: dict[tuple[str, str], list[tuple[int, Measurement]]] = {}
    for row, some in enumerate(measured):
        for item in some:
            by_means.setdefault((item.instrument, item.variant), []).append((row, item))
    if len(by_means) == 1:
        yield problem, np.arange(problem.shots)
        return
    for pairs in by_means.values():
        rows = np.array([row for row, _ in pairs])
        alone = [[item] for _, item in pairs]
        yield Problem.of_measured(header, robot, problem.joints[rows], alone, planned=True), rows


def _violation(
    conditions: Conditions, plan: Plan, broken: Broken, i: int, posture: int, *, assumed: bool
) -> Iterator[Violation]:
    """Of row i of the conditions, which is that posture of the plan."""
    constraints, row, condition = plan.constraints, np.array([i]), broken.condition
    match condition:
        case "limits":
            lower, upper = View.of(constraints).limits(plan.robot)
            for j in np.flatnonzero(conditions.beyond(row)[0]).tolist():
                joint = plan.robot.joints[j]
                at, low, high = (float(v[j] * joint.display) for v in (conditions.joints[i], lower, upper))
                yield Violation(posture, "margin_deg", condition, at, low, high, joint.unit, j + 1)
        case "beam_mm":
            assert constraints.beam_mm is not None
            length = float(conditions.length[i])
            yield Violation(posture, "beam_mm", condition, length, *constraints.beam_mm, "mm")
        case "facing":
            at = float(np.degrees(conditions.incidence[i]))
            yield Violation(posture, "acceptance_deg", condition, at, 0.0, constraints.acceptance, "deg")
        case "unfit" | "behind":
            yield Violation(posture, "instrument", condition, why=broken.why)
        case "arm":
            way = conditions.in_the_way(row)
            apart, radius, link = float(way.apart[0]), float(way.radius[0]), int(way.link[0])
            yield Violation(
                posture, "instrument", condition, apart, radius, unit="mm", joint=link, assumed=assumed
            )
        case _:
            yield Violation(posture, "obstacles", condition)
