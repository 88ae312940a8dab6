"""`zerobeam plan`: from a header and a target to a checked plan file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from math import radians
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from ruamel.yaml import YAML

from ...analysis.acceptance import LackingTest, lacking_test
from ...analysis.observability.check import Check, CheckedParameter
from ...analysis.observability.check import Planned as PlanVerdict
from ...analysis.observability.power import DetectionPower
from ...analysis.observability.predictions import CurvePoint
from ...model.arrays import Progress
from ...model.errors import BadInput
from ...model.files.from_arrays import checked
from ...model.files.header import Header, StatedTarget
from ...model.files.plan import (
    UNCONSTRAINED,
    Means,
    Obstacles,
    Plan,
    StatedConstraints,
    first_in_turn,
    read_plan,
    write_plan,
)
from ...model.files.robot_file import load_robot, rebased
from ...model.files.whole_file import refuse_existing, schema_line, write_whole
from ...model.kinematics.robot import Robot
from ...model.parsing.validation import read_model
from ...model.records import inline, internal, it, key, record
from ...words import numbers
from ...words.enter import lacking_test_sentence
from ...words.observability import no_plan_sentence, power_sentences
from ...words.wording import counted
from ..measuring_options import Pattern, PlanOptions, Portion
from .candidates import CandidatePostures, Planned, candidates, pools_in_words
from .constraints import View, check_plan
from .optimal import Fewest, Planner, Proposal
from .patterns import Line, pattern


def read_obstacles(path: Path) -> Obstacles:
    """An obstacles file (YAML)."""
    return read_model(Obstacles, path)


def write_obstacles(path: Path, obstacles: Obstacles, *, force: bool = False) -> None:
    """Write an obstacles file (YAML), whole or not at all; over another one with `force` only."""
    refuse_existing(path, force=force)
    text = StringIO()
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.dump(obstacles.model_dump(mode="json"), text)
    write_whole(path, schema_line(path, "obstacles") + text.getvalue(), force=force)


PROPOSAL_SCHEMA: Final = "zerobeam/proposal/1"
_USUAL, _USUAL_UNCERTAIN = 7, 20  # measurements: of a pattern or an exact arm, of an uncertain arm
_LOOSE = 0.8  # a certified efficiency below this needs a word
NO_OBSTACLES = Obstacles()
_DECIMALS = 6  # of degrees and millimetres in the file: finer than any controller moves


@dataclass(frozen=True, kw_only=True)
class PlanRequest(PlanOptions):
    """Request for a plan of a header, whose paths are relative to a folder; `bodies` are the obstacles."""

    kind: Pattern = "optimal"
    header: Header
    header_folder: Path
    bodies: Obstacles = NO_OBSTACLES

    @classmethod
    def of(cls, kind: Pattern, header: Header, folder: Path, options: PlanOptions) -> Self:
        """The request for what is stated; its obstacles are read."""
        bodies = NO_OBSTACLES if options.obstacles is None else read_obstacles(options.obstacles)
        return cls(**vars(options), kind=kind, header=header, header_folder=folder, bodies=bodies)

    @property
    def line(self) -> Line:
        """Of a pattern."""
        roll = None if self.roll_deg is None else radians(self.roll_deg)
        return Line(self.distance_mm, self.height_mm, self.width_mm, roll)

    @property
    def measurements(self) -> int:
        """How many the plan has: of an uncertain arm so many more that its run notices as much."""
        if self.shots is not None:
            return self.shots
        return _USUAL_UNCERTAIN if self.kind == "optimal" and self.header.arm is not None else _USUAL


@record(eq=False)
class MadePlan:
    """A plan and the verdict of `check` on it; `proposal` is None for a pattern. `untested` says what an
    acceptance test after an optimal plan lacks, where it cannot pass.

    `plan` and `checked` are None where no number of measurements reaches the tolerance; `file` is None then,
    and where none was asked for.
    """

    schema: Annotated[Literal["zerobeam/proposal/1"], it("kind and version of the document")] = field(
        default=PROPOSAL_SCHEMA, kw_only=True
    )
    kind: Annotated[Pattern, it("of plan")]
    plan: Annotated[Plan | None, internal]
    file: Annotated[Path | None, internal]
    checked: Annotated[Check | None, it("the whole answer of `check` on the plan written", name="check")]
    proposal: Annotated[
        Proposal | None,
        inline(
            *("criterion", "value", "bound", "efficiency", "converged", "support", "travel_s", "candidates")
        ),
    ]
    fewest: Annotated[Fewest | None, inline("tolerance", "limit", most="max_shots")]
    removed: Annotated[
        str | None, it("how many candidate postures each constraint removed, in words; null for a pattern")
    ]
    untested: Annotated[LackingTest | None, internal] = None

    def __repr__(self) -> str:
        count = 0 if self.plan is None else len(self.plan.postures)
        return f"<MadePlan: {self.kind}, {count} postures>"

    @property
    @key("how good the choice is and why it may not be better, or why there is no plan", name="said")
    def sentences(self) -> list[str]:
        made, fewest = self.proposal, self.fewest
        if self.checked is None and fewest is not None:
            most, worst = fewest.curve[-1].shots, fewest.curve[-1].worst_std
            return [
                f"No plan of up to {fewest.most} measurements is enough. With {most} measurements the largest"
                f" standard uncertainty is {numbers.spread(worst)}, the tolerance"
                f" {numbers.exact(fewest.tolerance)}. The limit is {fewest.limit}."
            ]
        if made is None or self.checked is None:
            return []
        repeats = sum(row is not None for row in made.again)
        count = len(made.again) - repeats
        seconds = "" if made.travel_s is None else f"; travel {numbers.significant(made.travel_s, 2)} s"
        lines = [
            f"{count} measurements by the {made.criterion}-criterion: at least"
            f" {numbers.percent(made.efficiency, 1)} as good as the best choice from"
            f" {made.candidates} candidates{seconds}."
            + (f" {counted(repeats, 'measurement')} again at the end." if repeats else "")
        ]
        if made.efficiency < _LOOSE:
            lines.append(
                f"The bound divides {count} measurements among {made.support} postures, which whole ones"
                " cannot: the best choice may be no better than this."
            )
        if not made.converged:
            lines.append(
                "The bound did not converge within its number of steps: it holds, and the plan may be better."
            )
        known = self.checked.worst
        if fewest is not None and known is not None and known > fewest.tolerance:
            lines.append(
                f"The tolerance {numbers.exact(fewest.tolerance)} is reached with everything where it is"
                f" guessed; at a typical place the largest standard uncertainty is {numbers.spread(known)}."
            )
        never = no_plan_sentence(made.hopeless)
        untested = None if self.untested is None else lacking_test_sentence(self.untested)
        return [*lines, *power_sentences(self.checked.power), *(each for each in (never, untested) if each)]

    @property
    @key("the name of the file, null if none was written", name="plan")
    def file_name(self) -> str | None:
        return None if self.file is None else self.file.name

    @property
    @key("of `check` on the plan written")
    def verdict(self) -> PlanVerdict | None:
        return None if self.checked is None else self.checked.verdict

    @property
    @key("the number of its postures")
    def shots(self) -> int | None:
        return None if self.checked is None else len(self.checked.postures)

    @property
    @key("by name of each offset: the `std` of the check")
    def predicted_std(self) -> dict[str, float | None]:
        return {row.name: row.std for row in self._offsets}

    @property
    @key("by name of each offset: `deg` or `mm`")
    def units(self) -> dict[str, str]:
        return {row.name: row.unit for row in self._offsets}

    @property
    @key("as of a check: the probability with which a run of the plan detects each wrong model")
    def power(self) -> tuple[DetectionPower, ...]:
        return () if self.checked is None else self.checked.power

    @property
    @key("`shots` and `worst_std` of the numbers of measurements that were tried, up to that of the answer")
    def curve(self) -> tuple[CurvePoint, ...]:
        return () if self.fewest is None else self.fewest.curve

    @property
    def _offsets(self) -> list[CheckedParameter]:
        rows = () if self.checked is None else self.checked.parameters
        return [row for row in rows if row.group == "offset"]


def make_plan(request: PlanRequest, file: Path | None, tell: Progress, *, force: bool = False) -> MadePlan:
    """Make the plan, write it to a new `file` (if one is asked for; with `force` over one that is there) and
    check it.

    BadInput names the constraint that prevents it.
    """
    if file is not None:
        refuse_existing(file, force=force)
    robot = load_robot(request.header.robot, request.header_folder)
    header = _with_target(request, Path(".") if file is None else file.parent)
    proposal, fewest, removed = None, None, None
    if request.kind == "optimal":
        shares = portions(request)
        pools = candidate_pools(request, header, robot, shares, lambda share: tell("candidates", share))
        removed = pools_in_words(pools)
        tell("choice", 0.0)
        planner = Planner(header, robot, {}, pools, request.repeat)
        if request.tolerance is None:
            counts = {label: share.number for label, share in shares.items()}
            proposal = planner.optimal(counts, request.criterion, seed=request.seed)
        else:
            most = min(request.max_shots, sum(len(pool.postures) for pool in pools))
            fewest = planner.fewest(request.tolerance, most, request.criterion, seed=request.seed)
            proposal = fewest.proposal
        if proposal is None:
            return MadePlan(request.kind, None, None, None, None, fewest, removed)
        postures, planned, again = proposal.postures, proposal.planned, proposal.again
        _require_tied(header, {each.target for each in planned})
    else:
        name = _target_name(header)
        target = np.array(header.targets[name].guess_mm)
        postures = pattern(
            header, robot, target, request.kind, request.measurements, name=name, line=request.line
        )
        repeated = first_in_turn([name] * len(postures), request.repeat)
        postures = np.concatenate([postures, postures[repeated]])
        again = (None,) * (len(postures) - len(repeated)) + tuple(repeated)
        planned = (Planned(header.labels[0], target=name),) * len(postures)
    rows = np.round(postures * robot.display, _DECIMALS)
    targets, means = [each.target for each in planned], _means(header, planned, again)
    kept = _constraints(request) if request.kind == "optimal" else UNCONSTRAINED
    if file is None:
        plan = Plan.of_postures(header, robot, rows, targets, request.kind, kept, means)
    else:
        write_plan(file, header, rows, targets, means=means, constraints=kept, force=force)
        plan = read_plan(file)
    tell("check", 0.0)
    checked_plan = check_plan(plan)
    untested = None
    if proposal is not None and checked_plan.verdict == "pass":  # else there is none, as the verdict says
        aimed, tolerance = checked_plan.aimed, header.tolerance
        untested = lacking_test(
            aimed.aimed.problem, aimed.x, {"deg": tolerance.offset_deg, "mm": tolerance.length_mm}
        )
    return MadePlan(request.kind, plan, file, checked_plan, proposal, fewest, removed, untested)


def portions(request: PlanRequest) -> dict[str, Portion]:
    """How many measurements each instrument makes; BadInput where that is not said of each of several."""
    labels = request.header.labels
    if not request.measure and len(labels) == 1:
        return {labels[0]: Portion(request.measurements)}
    if request.shots is not None or set(request.measure) != set(labels):
        raise BadInput(
            "it is not said how many measurements each instrument makes",
            found=", ".join(f"{label}={share.number}" for label, share in request.measure.items())
            or f"{request.shots or 'no number'} for {len(labels)} instruments",
            allowed=f"a number for each of {', '.join(labels)}",
            argument="measure",
        )
    if request.tolerance is not None and len(labels) > 1:
        raise BadInput(
            "the fewest measurements are found for a single instrument",
            found=f"{len(labels)} instruments: {', '.join(labels)}",
            remedy="leave the tolerance out, and say how many measurements each makes",
            argument="tolerance",
        )
    return dict(request.measure)


def candidate_pools(
    request: PlanRequest,
    header: Header,
    robot: Robot,
    shares: Mapping[str, Portion],
    tell: Callable[[float], None],
) -> list[CandidatePostures]:
    """The candidates of each instrument, target and reflector."""
    each = {label: _planned(header, robot, label, share.targets) for label, share in shares.items()}
    total, pools = sum(map(len, each.values())), list[CandidatePostures]()
    for label, planned in each.items():
        first = len(pools)
        for one in planned:
            pools.append(
                candidates(
                    header,
                    robot,
                    None,
                    -(-request.candidates // total),
                    view=View.of(_constraints(request)),
                    obstacles=request.bodies,
                    seed=request.seed + len(pools),
                    planned=one,
                    progress=lambda share: tell((len(pools) + share) / total),
                )
            )
        least = shares[label].number if request.tolerance is None else 2
        if sum(len(pool.postures) for pool in pools[first:]) < least:
            raise BadInput(
                f"there are too few postures to choose {least} measurements from",
                found="; ".join(pool.reasons() for pool in pools[first:]),
                remedy="loosen the condition without which most would be left, or put the target elsewhere",
            )
    return pools


def _planned(header: Header, robot: Robot, label: str, targets: tuple[str, ...]) -> list[Planned]:
    """What an instrument measures: its variants, at each of the targets."""
    instrument = header.made(label, robot.n)
    kinds = instrument.target_kinds()
    if not kinds:
        if targets:
            raise BadInput(
                f"{label} measures no target",
                found=", ".join(targets),
                remedy="state its number alone",
                argument="measure",
            )
        return [Planned(label, variant) for variant in instrument.variants]
    suited = [name for name, target in header.targets.items() if target.kind in kinds]
    others = [other for other, kind in header.kinds.items() if other != label]
    alike = [other for other in others if set(kinds) & set(header.kinds[other].target_kinds())]
    if not targets and alike and len(suited) > 1:
        raise BadInput(
            f"it is not said which targets {label} measures",
            found=f"{', '.join(suited)}, which {', '.join(alike)} could measure too",
            allowed=f"{label}@{suited[0]}=COUNT",
            argument="measure",
        )
    for name in targets or suited:
        if name not in suited or header.targets[name].guess_mm is None:
            raise BadInput(
                f"{label} cannot be planned to measure {name}",
                found="no such target of its kind"
                if name not in suited
                else f"targets.{name} without guess_mm",
                allowed=", ".join(suited) or "a target in the header",
                remedy=f"state targets.{name}: {{guess_mm: [x, y, z], …}}",
            )
    if not suited:
        raise BadInput(
            "a plan needs to know about where its target is",
            found=f"no target of {label}",
            remedy=f"state --target x,y,z (mm, base frame), or targets.{instrument.target}:"
            " {guess_mm: [x, y, z], …} in the header",
            argument="target",
        )
    return [Planned(label, variant, name) for name in targets or suited for variant in instrument.variants]


def _require_tied(header: Header, measured: Collection[str | None]) -> None:
    """BadInput where a distance or an angle is to a target that the chosen measurements leave out."""
    pairs = [*(each.between for each in header.distances), *(each.between for each in header.angles)]
    left = sorted({name for pair in pairs for name in pair} - set(measured))
    if left:
        raise BadInput(
            f"the best plan of so many measurements leaves out {', '.join(left)}",
            found="an angle or a distance to it in the header",
            remedy="plan more measurements, or remove it from the header's angles and distances",
        )


def _means(header: Header, planned: Sequence[Planned], again: Sequence[int | None]) -> tuple[Means, ...]:
    """What each measurement is made with, where the header leaves a choice, and which it repeats."""
    several = len(header.labels) > 1
    means = tuple(
        Means(each.instrument if several else None, each.variant or None, again=repeated)
        for each, repeated in zip(planned, again, strict=True)
    )
    return means if any(each != Means() for each in means) else ()


def _target_name(header: Header) -> str:
    """The kind's own, or `psd` where the header says so."""
    return "psd" if "psd" in header.targets else header.instrument.target


def _with_target(request: PlanRequest, folder: Path) -> Header:
    """The header with the target's guess, its robot named as seen from the plan's folder."""
    robot_ref = rebased(request.header.robot, request.header_folder, folder)
    if request.target is None:
        if request.kind != "optimal":
            raise BadInput(
                f"the {request.kind.upper()}-Pattern is made about a target",
                found="no position of it",
                remedy="state where it is: X,Y,Z in mm, base frame",
                argument="target",
            )
        return request.header.model_copy(update={"robot": robot_ref})
    kind = request.header.instrument
    if "point" not in kind.target_kinds():
        raise BadInput(
            f"the position of a target is stated for a {kind.name}",
            found=f"target: {', '.join(f'{value:g}' for value in request.target)}",
            remedy="leave it out: "
            + ("what it touches is stated in the header" if kind.target_kinds() else "it measures no target"),
            argument="target",
        )
    targets, name = dict(request.header.targets), _target_name(request.header)
    if targets and set(targets) != {name}:
        raise BadInput(
            "the header states other targets than the plan is made for",
            found=", ".join(targets),
            allowed=f"none, or {name}",
            remedy="remove `targets` from the header: the target's position is stated separately",
        )
    guess = {"guess_mm": tuple(request.target)}
    targets[name] = targets[name].model_copy(update=guess) if targets else StatedTarget(**guess)  # type: ignore[arg-type]
    return request.header.model_copy(update={"targets": targets, "robot": robot_ref})


def _constraints(request: PlanRequest) -> StatedConstraints:
    """The constraints as the plan file states them; those of the beam only where there is one."""
    if request.facing is not None and not any(request.facing):
        raise BadInput(
            "this direction has no length",
            found="0,0,0",
            allowed="a direction, or `any` (None in Python)",
            argument="facing",
        )
    if not 0 < request.acceptance_deg <= 90:
        raise BadInput(
            "the angle is out of range",
            found=request.acceptance_deg,
            allowed="above 0, up to 90",
            argument="acceptance_deg",
        )
    if not 0 <= request.beam_mm[0] < request.beam_mm[1]:
        raise BadInput(
            "the lengths are out of order",
            found=request.beam_mm,
            allowed="0 <= shortest < longest",
            argument="beam_mm",
        )
    constraints: dict[str, object] = {"margin_deg": request.margin_deg, "obstacles": request.bodies}
    if any(kind.beam for kind in request.header.kinds.values()):
        if request.facing is not None:
            constraints = {"facing": request.facing, "acceptance_deg": request.acceptance_deg, **constraints}
        constraints["beam_mm"] = request.beam_mm
    return checked(StatedConstraints, constraints)
