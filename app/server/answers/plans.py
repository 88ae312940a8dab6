"""Plans: reading, writing, and what one will determine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from ....analysis.observability.aim import AimedPlan, aim_plan
from ....analysis.observability.check import Check, without_posture
from ....experiments.arm_shown import shown_arm
from ....experiments.plans.constraints import check_plan, touched_boxes, violations
from ....experiments.plans.obstacles import read_obstacles, write_obstacles
from ....model.errors import BadInput
from ....model.files.header import PLAN_SCHEMA
from ....model.files.plan import Plan, plan_of, write_plan
from ....model.files.plan_file import Obstacles
from ....model.files.reading import Document, KeyPath, read_yaml, require_schema
from ....model.files.validation import FileModel, as_tuple
from ....reports.plan.plan_page import Postures, postures_of
from ....reports.run.parameters import worth_column
from ....words.geometry import check_lines
from ....words.numbers import unit_of
from ....words.observability import advice_sentence, over_target_sentence
from ....words.result_json import check_json
from ....words.verdict import violation_words
from ..asked import NOWHERE, keyed
from ..end_point import EndPoint
from ..folder import Folder
from .notes import noted
from .robots import arm_of, require_robot_inside, rounded, whole_ref

MOST_POSTURES = 1000  # of a plan that is checked while somebody waits
MOST_WITHOUT = 30  # postures that are left out in one answer


class AskedCheck(FileModel):
    """A plan to check."""

    plan: dict[str, Any] = Field(description="the content of a plan file (zerobeam/plan/1)")
    file: str | None = Field(
        default=None, description="the file that it is from: paths in the plan are relative to its folder"
    )
    scene: bool = Field(default=False, description="whether to say where arm, beam and target are")
    obstacles: Obstacles | None = Field(
        default=None, description="obstacles to judge the plan by, instead of those that it states"
    )


class AskedWithout(FileModel):
    """A plan, and which of its postures to leave out."""

    plan: dict[str, Any] = Field(description="the content of a plan file (zerobeam/plan/1)")
    file: str | None = Field(
        default=None, description="the file that it is from: paths in the plan are relative to its folder"
    )
    postures: Annotated[tuple[int, ...], BeforeValidator(as_tuple), Field(max_length=MOST_WITHOUT)] = Field(
        description="postures, from 0, each of which is left out alone"
    )


class AskedObstacles(FileModel):
    """Obstacles to write."""

    file: str = Field(description="path below the folder (.yaml): a new file, or obstacles to be replaced")
    obstacles: Obstacles = Field(description="the content of an obstacles file")


class AskedPlan(FileModel):
    """A plan to write."""

    file: str = Field(description="path below the folder (.yaml): a new file, or a plan to be replaced")
    plan: dict[str, Any] = Field(description="the content of a plan file (zerobeam/plan/1)")


def plan(folder: Folder, name: str) -> dict[str, Any]:
    """A plan file: its content (`plan`), the `targets` of its postures, its `robot`, and `notes`."""
    path = folder.inside(name)
    with noted() as notes:
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=document.line(("schema",)))
        require_robot_inside(folder, document.data, path.parent)
        read = plan_of(document)
        ref = whole_ref(folder, read.header.robot, path.parent)
        arm = shown_arm(ref, [(read.postures[0] * read.robot.display).tolist()])
    return {
        "file": folder.called(path),
        "plan": document.data,
        "targets": list(read.targets),
        "robot": arm_of(arm),
        "notes": [*notes, *read.warnings],
    }


def write(folder: Folder, wanted: AskedPlan) -> dict[str, Any]:
    """Write a plan as a new file or over a plan, whole or not at all; nothing else is ever replaced."""
    path = folder.inside(wanted.file)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise BadInput("a plan cannot have this name", found=wanted.file, allowed="a name that ends in .yaml")
    if path.exists():
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=None)
    with noted() as notes:
        stated = _stated(folder, wanted.plan, path)
    rows = stated.postures * stated.robot.display
    via = [between * stated.robot.display for between in stated.via]
    # What degrees lose on the way to radians and back is far below what a file states.
    write_plan(
        path,
        stated.header,
        np.round(rows, 9),
        stated.targets,
        via_deg=via,
        constraints=stated.constraints,
        force=path.exists(),
    )
    return {"file": folder.called(path), "notes": [*notes, *stated.warnings]}


def check(folder: Folder, wanted: AskedCheck) -> dict[str, Any]:
    """`zerobeam/check/1`; with `scene` also what a picture needs, `null_motion`, and in `said` what the
    command says besides."""
    with noted() as notes:
        turned = _turned(folder, wanted.plan, wanted.file)
        if wanted.obstacles is not None:
            turned = _among(turned, wanted.obstacles)
        found = check_plan(turned.plan, turned)
        answer = check_json(found)
        if wanted.scene:
            scene = _scene(turned.plan, postures_of(turned))
            for broken in found.violations:
                scene[broken.posture]["violations"].append(violation_words(broken))
                if broken.constraint == "obstacles" and broken.via is None and not broken.planned:
                    scene[broken.posture]["touches"].append(broken.condition)
            answer |= {
                "scene": scene,
                "touched_boxes": touched_boxes(turned),
                "null_motion": _null_motion(found),
                "said": _said(found),
            }
    return answer | {"warnings": notes}


def without(folder: Folder, wanted: AskedWithout) -> list[dict[str, Any]]:
    """What the plan determines without each posture: `rest` has `verdict`, `status` and `std` of each offset,
    in its own unit (null: not determined); it is null for a posture that gives no measurement."""
    with noted():
        turned = _turned(folder, wanted.plan, wanted.file)
        broken = violations(turned)
        found = [(i, without_posture(turned, i, broken)) for i in wanted.postures]
    return [{"posture": i, "rest": None if own is None else asdict(own)} for i, own in found]


def obstacles(folder: Folder, name: str) -> dict[str, Any]:
    """An obstacles file: its content."""
    path = folder.inside(name)
    return {"file": folder.called(path), "obstacles": read_obstacles(path).model_dump(mode="json")}


def write_obstacles_file(folder: Folder, wanted: AskedObstacles) -> dict[str, Any]:
    """Write obstacles as a new file or over an obstacles file; nothing else is ever replaced."""
    path = folder.inside(wanted.file)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise BadInput(
            "obstacles cannot have this name", found=wanted.file, allowed="a name that ends in .yaml"
        )
    if path.exists():
        read_obstacles(path)
    write_obstacles(path, wanted.obstacles, force=path.exists())
    return {"file": folder.called(path)}


def _turned(folder: Folder, content: dict[str, Any], file: str | None) -> AimedPlan:
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
    return aim_plan(_stated(folder, content, path))


def _among(turned: AimedPlan, obstacles: Obstacles) -> AimedPlan:
    """The same postures, judged by these obstacles."""
    constraints = turned.plan.constraints.model_copy(update={"obstacles": obstacles})
    return replace(turned, plan=replace(turned.plan, constraints=constraints))


def _said(found: Check) -> dict[str, Any]:
    """What the command prints besides the table: `worth`, the head of the column beside u and what it says of
    each offset, `lines` on the geometry, `advice` on the postures, `over_target`."""
    head, of = worth_column(found.geometry)
    units = {row.name: unit_of(row.unit) for row in found.parameters}
    offsets, over = [row for row in found.parameters if row.group == "offset"], found.over_target
    return {
        "worth": {"head": head, "of": {row.name: of(row) for row in offsets}},
        "lines": check_lines(found),
        "advice": None if found.advice is None else advice_sentence(found.advice),
        "over_target": None if over is None else over_target_sentence(over, units),
    }


def _stated(folder: Folder, content: dict[str, Any], path: Path) -> Plan:
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

    def line(self, place: KeyPath) -> int | None:
        return self.finder(place)


def _scene(stated: Plan, seen: Postures) -> list[dict[str, Any]]:
    """Per posture, as the servo will leave it: joints, the arm's points, the beam from the laser to its end
    (null for a probe), the target's place and name, whether beam or probe comes to it, and empty lists for
    what it breaks of the plan's constraints, in words, and what it touches."""
    laser = stated.header.tool.kind == "laser"
    joints = seen.joints * stated.robot.display
    return [
        {
            "joints_deg": rounded(joints[i], 9),
            "skeleton": rounded(seen.arm[i], 3),
            "tool": rounded(seen.origin[i], 3),
            "beam": rounded(np.array([seen.origin[i], seen.end[i]]), 3) if laser else None,
            "target": rounded(seen.targets[stated.target_index[i]], 3),
            "target_name": stated.targets[i],
            "reaches": bool(seen.reaches[i]),
            "violations": [],
            "touches": [],
        }
        for i in range(len(stated.postures))
    ]


def _null_motion(found: Check) -> list[dict[str, Any]]:
    """Per null-space direction, in the order of `identifiability.null_space`: how far each joint, target and
    tool parameter goes along it, in its own unit, for one prior standard deviation of the leading parameter.

    To first order, arm and target that move so keep the beam on the target.
    """
    rows = {row.name: row for row in found.parameters}
    offsets = [row.name for row in found.parameters if row.group == "offset"]
    motions = []
    for direction in found.identifiability.null_space:
        moved = {name: weight * rows[name].prior_std for name, weight in direction.combination.items()}
        motions.append(
            {
                "kind": direction.kind,
                "joints_deg": [moved.get(name, 0.0) for name in offsets],
                "others": {name: value for name, value in moved.items() if name not in offsets},
            }
        )
    return motions


END_POINTS = [
    EndPoint("/api/plan", "GET", "A plan: its content, targets, robot and notes.", plan, asked=("file",)),
    EndPoint("/api/plan", "PUT", "Writes a plan: a new file, or in place of a plan.", write, AskedPlan),
    EndPoint("/api/check", "POST", "A check (zerobeam/check/1); with `scene` more.", check, AskedCheck),
    EndPoint("/api/without", "POST", "What a plan is without each of its postures.", without, AskedWithout),
    EndPoint("/api/obstacles", "GET", "The content of an obstacles file.", obstacles, asked=("file",)),
    EndPoint(
        "/api/obstacles",
        "PUT",
        "Writes obstacles: a new file, or in place of obstacles.",
        write_obstacles_file,
        AskedObstacles,
    ),
]
