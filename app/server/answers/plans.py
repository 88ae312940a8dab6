"""Plans: reading, writing, and what one will determine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from ....analysis.answer.answer_message import Message
from ....analysis.observability.aim import AimedPlan, aim_plan
from ....analysis.observability.check import Check, Violation, WithoutPosture, without_posture
from ....experiments.arm_shown import shown_arm
from ....experiments.plans.constraints import check_plan, touched_boxes, violations
from ....experiments.plans.make import write_obstacles
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import PLAN_SCHEMA
from ....model.files.plan import Obstacles, Plan, plan_of, write_plan
from ....model.instruments.kind import POINT, Mark, Target
from ....model.kinematics.orientation import Three
from ....model.parsing.reading import Document, KeyPath, read_yaml, require_schema
from ....model.parsing.validation import as_tuple, validate
from ....model.records import if_any, it, record
from ....reports.output.html import fragment
from ....reports.plan.check_page import predicted_blocks
from ....reports.plan.plan_page import postures_of
from ....reports.run.unobservable import direction_words
from ....words.message import message as message_of
from ....words.plan_catalogue import violation_words
from ..index import Folder, yaml_path
from ..requests import NOWHERE, Content, Precondition, end_point, keyed, noted
from ..versions import VersionOfFile, replacing, version_of, version_of_sum
from .actions import OfferedAction, action_of_plan
from .forms import RigForm, offered_rigs
from .robot_library import DrawnArm, arm_of, placed, require_robot_inside, rounded, whole_ref

MOST_POSTURES = 1000  # of a plan that is checked while somebody waits
MOST_WITHOUT = 30  # postures that are left out in one answer


StatedPlan = Annotated[Content, it("the content of a plan file (zerobeam/plan/1)")]
FileOfPlan = Annotated[
    str | None, it("the file that it is from: paths in the plan are relative to its folder")
]


@record(kw_only=True)
class ReadPlan(VersionOfFile):
    """A plan file."""

    plan: Annotated[Content, it("its content")]
    targets: Annotated[list[str], it("of its postures")]
    robot: DrawnArm
    rigs: Annotated[list[RigForm], it("what can carry it out")]
    notes: list[str]


@record(kw_only=True)
class WrittenPlan(VersionOfFile):
    """A plan that was written."""

    notes: list[str]


@record(kw_only=True)
class PostureScene:
    """A posture as the servo will leave it, mm in the base frame."""

    joints_deg: list[float]
    skeleton: Annotated[list[Three], it("the arm's points")]
    tool: Three
    beam: Annotated[list[Three] | None, it("from the laser to its end; null for a probe")]
    target: Three
    target_name: str
    reaches: Annotated[bool, it("beam or probe comes to the target")]
    violations: Annotated[list[str], it("what it breaks of the plan's constraints, in words")]
    touches: list[str]
    blocked: Annotated[bool, it("the arm or a box is in the way of the beam, or of a line of sight")]
    sights: Annotated[list[list[Three]], it("lines to what an instrument measures")]
    axes: Annotated[list[Three] | None, it("n unit vectors, of the joints; with `links`"), if_any] = None
    links: Annotated[
        list[list[list[float]]] | None, it("n + 1 poses of base and links: rows of 3 x 4"), if_any
    ] = None


@record(kw_only=True)
class CellMark:
    """What stands in the cell: an instrument or a target, mm in the base frame."""

    kind: Mark
    name: str
    at: Three
    normal: Annotated[Three | None, if_any] = None
    radius: Annotated[float | None, it("of a ball or a face"), if_any] = None
    acceptance_deg: Annotated[float | None, it("largest angle of a beam to the normal"), if_any] = None


@record(kw_only=True)
class NullMotion:
    """How far joints, targets and tool go along a null-space direction, each in its own unit, for one prior
    standard deviation of the leading parameter: to first order the beam stays on the target."""

    kind: str
    joints_deg: list[float]
    others: dict[str, float]


@record(kw_only=True)
class OpenDirection:
    """A combination of parameters that the measurements leave open, in words."""

    combination: str
    kind: str
    reason: str
    remedy: str


@record(kw_only=True)
class CheckRemarks:
    """What the command prints besides the table."""

    predicted: Annotated[
        str, it("what the measurements will determine, and what would make them better, as HTML")
    ]
    directions: Annotated[
        list[OpenDirection | None],
        it("in the order of `null_motion`; null where all of it has a tolerance"),
    ]


@record(kw_only=True, eq=False)
class CheckAnswer(Check):
    """`zerobeam/check/1` with its message and action; with `scene` also what a picture needs and what the
    command prints besides."""

    message: Message
    action: OfferedAction
    marks: Annotated[list[CellMark] | None, if_any] = None
    scene: Annotated[list[PostureScene] | None, if_any] = None
    touched_boxes: Annotated[list[bool] | None, if_any] = None
    null_motion: Annotated[list[NullMotion] | None, if_any] = None
    said: Annotated[CheckRemarks | None, if_any] = None
    warnings: tuple[str, ...]


@record(kw_only=True)
class WithoutOne:
    """What a plan determines without a posture; null for one that gives no measurement."""

    posture: int
    rest: WithoutPosture | None


@record(kw_only=True)
class ReadObstacles(VersionOfFile):
    """An obstacles file."""

    obstacles: Obstacles


@end_point("GET /api/plan", "A plan: its content, targets, robot and notes.")
def plan_file(folder: Folder, file: str) -> ReadPlan:
    """A plan file with its robot."""
    path = folder.inside(file)
    with noted() as notes:
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=document.line(("schema",)))
        require_robot_inside(folder, document.data, path.parent)
        read = plan_of(document)
        ref = whole_ref(folder, read.header.robot, path.parent)
        arm = shown_arm(ref, [(read.postures[0] * read.robot.display).tolist()])
    return ReadPlan(
        version=version_of_sum(document.sha256),
        file=folder.called(path),
        plan=document.data,
        targets=list(read.called),
        robot=arm_of(arm),
        rigs=offered_rigs(read, arm.vendor),
        notes=[*notes, *read.warnings],
    )


@end_point("GET /api/plan/schema", "JSON Schema of a plan.")
def schema(_: Folder) -> Content:
    """JSON Schema of a plan."""
    from ....experiments.schema import json_schema  # with all kinds of files: half a second

    return json_schema("plan")


@end_point("PUT /api/plan", "Writes a plan: a new file, or in place of a plan.")
def write(
    folder: Folder,
    file: Annotated[str, it("path below the folder (.yaml): a new file, or a plan to be replaced")],
    plan: StatedPlan,
    precondition: Precondition,
) -> WrittenPlan:
    """Write a plan as a new file or over a plan, whole or not at all; nothing else is ever replaced, nor
    another version than the one that was read."""
    path = yaml_path(folder, file, "plan")
    with noted() as notes:
        written = _plan_of(folder, plan, path)
    rows = written.postures * written.robot.display
    via = [between * written.robot.display for between in written.via]
    # What degrees lose on the way to radians and back is far below what a file states.
    with replacing(path, precondition, lambda: plan_file(folder, file)) as force:
        write_plan(
            path,
            written.header,
            np.round(rows, 9),
            written.targets,
            means=written.means,
            via_deg=via,
            constraints=written.constraints,
            force=force,
        )
    notes = [*notes, *written.warnings]
    return WrittenPlan(version=version_of(path), file=folder.called(path), notes=notes)


@end_point(
    "POST /api/check", "A check (zerobeam/check/1); with `scene` what is drawn; `obstacles` for the plan's."
)
def check(
    folder: Folder,
    plan: StatedPlan,
    file: FileOfPlan = None,
    scene: Annotated[bool, it("whether to say where arm, beam and target are")] = False,
    links: Annotated[bool, it("with `scene`: whether to say how each link stands")] = False,
    obstacles: Annotated[
        Obstacles | None, it("obstacles to judge the plan by, instead of those that it states")
    ] = None,
) -> CheckAnswer:
    """A check; with `scene` also what a picture needs."""
    with noted() as notes:
        aimed = _aimed(folder, plan, file)
        if obstacles is not None:
            aimed = _among(aimed, obstacles)
        checked = check_plan(aimed.plan, aimed)
        message = message_of(checked)
        offered = action_of_plan(checked, message.action)
        answer = CheckAnswer(**vars(checked), message=message, action=offered)
        if scene:
            answer = replace(
                answer,
                scene=_scene(aimed, checked.violations, links=links),
                marks=list(_marks(aimed)),
                touched_boxes=touched_boxes(aimed),
                null_motion=_null_motion(checked),
                said=_remarks(checked),
            )
    return replace(answer, warnings=tuple(notes))


@end_point("POST /api/without", "What a plan is without each of its postures.")
def without(
    folder: Folder,
    plan: StatedPlan,
    postures: Annotated[
        tuple[int, ...],
        BeforeValidator(as_tuple),
        it("postures, from 0, each of which is left out alone"),
        Field(max_length=MOST_WITHOUT),
    ],
    file: FileOfPlan = None,
) -> list[WithoutOne]:
    """What the plan determines without each posture."""
    with noted():
        aimed = _aimed(folder, plan, file)
        broken = violations(aimed)
        checks = [(i, without_posture(aimed, i, broken)) for i in postures]
    return [WithoutOne(posture=i, rest=rest) for i, rest in checks]


@end_point("GET /api/obstacles", "The content of an obstacles file.")
def obstacles_file(folder: Folder, file: str) -> ReadObstacles:
    """An obstacles file: its content."""
    path = folder.inside(file)
    document = read_yaml(path)
    content = validate(Obstacles, document.data, file=path, line=document.line)
    version = version_of_sum(document.sha256)
    return ReadObstacles(version=version, file=folder.called(path), obstacles=content)


@end_point("PUT /api/obstacles", "Writes obstacles: a new file, or in place of obstacles.")
def write_obstacles_file(
    folder: Folder,
    file: Annotated[str, it("path below the folder (.yaml): a new file, or obstacles to be replaced")],
    obstacles: Annotated[Obstacles, it("the content of an obstacles file")],
    precondition: Precondition,
) -> VersionOfFile:
    """Write obstacles as a new file or over an obstacles file; nothing else is ever replaced, nor another
    version than the one that was read."""
    path = yaml_path(folder, file, "obstacles")
    with replacing(path, precondition, lambda: obstacles_file(folder, file)) as force:
        write_obstacles(path, obstacles, force=force)
    return VersionOfFile(version=version_of(path), file=folder.called(path))


def _aimed(folder: Folder, content: Content, file: str | None) -> AimedPlan:
    """The plan that a file with this content would be, its postures turned onto their targets."""
    path = folder.root / NOWHERE if file is None else folder.inside(file)
    postures = content.get("postures_deg")
    if isinstance(postures, list) and len(postures) > MOST_POSTURES:
        raise BadInput(
            "the plan is too long to be checked while you wait",
            found=f"{len(postures)} postures",
            allowed=f"at most {MOST_POSTURES}",
            remedy="use zerobeam check",
        )
    return aim_plan(_plan_of(folder, content, path))


def _among(aimed: AimedPlan, obstacles: Obstacles) -> AimedPlan:
    """The same postures, judged by these obstacles."""
    constraints = aimed.plan.constraints.model_copy(update={"obstacles": obstacles})
    return replace(aimed, plan=replace(aimed.plan, constraints=constraints))


def _remarks(checked: Check) -> CheckRemarks:
    tolerated = {row.name for row in checked.parameters if row.tolerated}
    return CheckRemarks(
        predicted=fragment(predicted_blocks(checked, alone=True), {}),
        directions=[
            None if tolerated.issuperset(one.combination) else OpenDirection(**vars(direction_words(one)))
            for one in checked.identifiability.null_space
        ],
    )


def _plan_of(folder: Folder, content: Content, path: Path) -> Plan:
    """The plan that a file with this content would be; Refused with the key of what is wrong."""
    require_robot_inside(folder, content, path.parent)
    sha256 = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    try:
        return plan_of(Document(content, path, sha256, {}))
    except BadInput:

        def again(line: Callable[[KeyPath], int | None]) -> Plan:
            return plan_of(_Placed(content, path, sha256, {}, line))

        return keyed(content, again, ("plan",))


@dataclass(frozen=True)
class _Placed(Document):
    """A document of which something else says the line of a place."""

    finder: Callable[[KeyPath], int | None]

    def line(self, keys: KeyPath) -> int | None:
        return self.finder(keys)


def _marks(aimed: AimedPlan) -> Iterator[CellMark]:
    """The targets at their nominal places, and the stations where they stand."""
    plan, problem, x = aimed.plan, aimed.problem, aimed.x
    header, kept = plan.header, plan.constraints
    measuring = {
        item.target: header.kinds[item.instrument] for item in reversed(plan.measurements) if item.target
    }
    for label, kind in header.kinds.items():
        if kind.target_is == "nothing":
            instrument = header.made(label, plan.robot.n)
            at = instrument.in_sight(Target(np.zeros(3), None))
            at = instrument.stands_at[:3] if at is None else at
            if len(at) == 3:
                yield CellMark(kind=kind.mark, name=label, at=rounded(at, 3))
    for name, at_target in zip(problem.targets, problem.split(x).targets, strict=True):
        if problem.is_station(name):
            continue
        entry, kind = header.targets.get(name), measuring[name]
        if entry is not None and entry.kind != POINT:
            if entry.guess_mm is not None:
                ball = entry.diameter_mm is not None
                radius = (entry.diameter_mm or 0.0) / 2 if ball else entry.radius_mm
                yield CellMark(
                    kind=entry.kind if kind.mark == POINT else kind.mark,
                    name=name,
                    at=entry.guess_mm,
                    normal=entry.normal,
                    radius=radius,
                )
        elif kind.beam:
            facing = kept.facing
            yield CellMark(
                kind=kind.mark,
                name=name,
                at=rounded(at_target, 3),
                normal=facing,
                acceptance_deg=None if facing is None else kept.acceptance_deg,
            )
        else:
            yield CellMark(kind=kind.mark, name=name, at=rounded(at_target, 3))


def _sights(aimed: AimedPlan, joints: Matrix) -> list[list[list[Three]]]:
    """Per posture the lines to what is measured."""
    problem, parts = aimed.problem, aimed.problem.split(aimed.x)
    poses = problem.poses(aimed.x, joints)
    rows = []
    for i, pose in enumerate(poses):
        target = parts.targets[problem.target_index[i]]
        lines = (
            part.instrument.sight(pose, target, parts.tool[part.unknowns], part.reading, part.variant)
            for part in problem.tool.read_at(problem.readings[i])
        )
        rows.append([rounded(line, 3) for line in lines if line is not None])
    return rows


def _scene(aimed: AimedPlan, violations: Sequence[Violation], *, links: bool) -> list[PostureScene]:
    scene_plan, postures, problem = aimed.plan, postures_of(aimed), aimed.problem
    names = [problem.targets[k] for k in problem.target_index.tolist()]
    stations = np.array([problem.is_station(name) for name in names])
    at = np.where(stations[:, None], postures.origin, postures.targets[problem.target_index])
    joints, arms = rounded(postures.joints * scene_plan.robot.display, 9), rounded(postures.arm, 3)
    origins, targets = rounded(postures.origin, 3), rounded(at, 3)
    beams = rounded(np.stack([postures.origin, postures.end], axis=1), 3)
    sights = _sights(aimed, postures.joints)
    _, axes, poses = placed(scene_plan.robot, postures.joints) if links else (None, None, None)
    broken_in = [[broken for broken in violations if broken.posture == i] for i in range(len(joints))]
    return [
        PostureScene(
            joints_deg=joints[i],
            skeleton=arms[i],
            tool=origins[i],
            beam=beams[i] if problem.tool.beam else None,
            target=targets[i],
            target_name=names[i],
            sights=sights[i],
            axes=axes and axes[i],
            links=poses and poses[i],
            reaches=bool(postures.reaches[i]),
            violations=[violation_words(one) for one in broken_in[i]],
            touches=[
                one.condition
                for one in broken_in[i]
                if one.constraint == "obstacles" and one.via is None and not one.planned
            ],
            blocked=any(
                one.condition in ("arm", "beam", "sight") and one.via is None and not one.planned
                for one in broken_in[i]
            ),
        )
        for i in range(len(joints))
    ]


def _null_motion(checked: Check) -> list[NullMotion]:
    """Per null-space direction, in the order of `identifiability.null_space`."""
    rows = {row.name: row for row in checked.parameters}
    offsets = [row.name for row in checked.parameters if row.group == "offset"]
    motions = []
    for direction in checked.identifiability.null_space:
        moved = {name: weight * rows[name].prior_std for name, weight in direction.combination.items()}
        others = {name: value for name, value in moved.items() if name not in offsets}
        motions.append(
            NullMotion(
                kind=direction.kind,
                joints_deg=[moved.get(name, 0.0) for name in offsets],
                others=others,
            )
        )
    return motions
