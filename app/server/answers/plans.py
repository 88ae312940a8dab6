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
from ....model.files.reading import Document, Place, read_yaml, require_schema
from ....model.files.stated_plan.obstacles import Obstacles
from ....model.files.validation import FileModel, as_tuple
from ....reports.plan.plan_scene import Postures, postures_of
from ....reports.run.geometry import check_lines
from ....reports.run.parameters import unit_of, worth_column
from ....words.observability import advice_sentence, over_target_sentence
from ....words.result_json import check_json
from ....words.verdict import violation_words
from ..folder import Folder
from ..requests import NOWHERE, EndPoint, keyed, noted
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


def write(folder: Folder, request: AskedPlan) -> dict[str, Any]:
    """Write a plan as a new file or over a plan, whole or not at all; nothing else is ever replaced."""
    path = folder.inside(request.file)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise BadInput(
            "a plan cannot have this name", found=request.file, allowed="a name that ends in .yaml"
        )
    if path.exists():
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=None)
    with noted() as notes:
        written = _plan_of(folder, request.plan, path)
    rows = written.postures * written.robot.display
    via = [between * written.robot.display for between in written.via]
    # What degrees lose on the way to radians and back is far below what a file states.
    write_plan(
        path,
        written.header,
        np.round(rows, 9),
        written.targets,
        via_deg=via,
        constraints=written.constraints,
        force=path.exists(),
    )
    return {"file": folder.called(path), "notes": [*notes, *written.warnings]}


def check(folder: Folder, request: AskedCheck) -> dict[str, Any]:
    """`zerobeam/check/1`; with `scene` also what a picture needs, `null_motion`, and in `said` what the
    command says besides."""
    with noted() as notes:
        aimed = _aimed(folder, request.plan, request.file)
        if request.obstacles is not None:
            aimed = _among(aimed, request.obstacles)
        checked = check_plan(aimed.plan, aimed)
        answer = check_json(checked)
        if request.scene:
            scene = _scene(aimed.plan, postures_of(aimed))
            for broken in checked.violations:
                scene[broken.posture]["violations"].append(violation_words(broken))
                if broken.constraint == "obstacles" and broken.via is None and not broken.planned:
                    scene[broken.posture]["touches"].append(broken.condition)
            answer |= {
                "scene": scene,
                "touched_boxes": touched_boxes(aimed),
                "null_motion": _null_motion(checked),
                "said": _remarks(checked),
            }
    return answer | {"warnings": notes}


def without(folder: Folder, request: AskedWithout) -> list[dict[str, Any]]:
    """What the plan determines without each posture: `rest` has `verdict`, `status` and `std` of each offset,
    in its own unit (null: not determined); it is null for a posture that gives no measurement."""
    with noted():
        aimed = _aimed(folder, request.plan, request.file)
        broken = violations(aimed)
        checks = [(i, without_posture(aimed, i, broken)) for i in request.postures]
    return [{"posture": i, "rest": None if rest is None else asdict(rest)} for i, rest in checks]


def obstacles(folder: Folder, name: str) -> dict[str, Any]:
    """An obstacles file: its content."""
    path = folder.inside(name)
    return {"file": folder.called(path), "obstacles": read_obstacles(path).model_dump(mode="json")}


def write_obstacles_file(folder: Folder, request: AskedObstacles) -> dict[str, Any]:
    """Write obstacles as a new file or over an obstacles file; nothing else is ever replaced."""
    path = folder.inside(request.file)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise BadInput(
            "obstacles cannot have this name", found=request.file, allowed="a name that ends in .yaml"
        )
    if path.exists():
        read_obstacles(path)
    write_obstacles(path, request.obstacles, force=path.exists())
    return {"file": folder.called(path)}


def _aimed(folder: Folder, content: dict[str, Any], file: str | None) -> AimedPlan:
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


def _remarks(checked: Check) -> dict[str, Any]:
    """What the command prints besides the table: `worth`, the head of the column beside u and what it says of
    each offset, `lines` on the geometry, `advice` on the postures, `over_target`."""
    head, of = worth_column(checked.geometry)
    units = {row.name: unit_of(row.unit) for row in checked.parameters}
    offsets, over = [row for row in checked.parameters if row.group == "offset"], checked.over_target
    return {
        "worth": {"head": head, "of": {row.name: of(row) for row in offsets}},
        "lines": check_lines(checked),
        "advice": None if checked.advice is None else advice_sentence(checked.advice),
        "over_target": None if over is None else over_target_sentence(over, units),
    }


def _plan_of(folder: Folder, content: dict[str, Any], path: Path) -> Plan:
    """The plan that a file with this content would be; Refused with the key of what is wrong."""
    require_robot_inside(folder, content, path.parent)
    sha256 = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    try:
        return plan_of(Document(content, path, sha256, {}))
    except BadInput:

        def again(line: Callable[[Place], int | None]) -> Plan:
            return plan_of(_Placed(content, path, sha256, {}, line))

        return keyed(content, again, ("plan",))


@dataclass(frozen=True)
class _Placed(Document):
    """A document of which something else says the line of a place."""

    finder: Callable[[Place], int | None]

    def line(self, keys: Place) -> int | None:
        return self.finder(keys)


def _scene(scene_plan: Plan, aimed: Postures) -> list[dict[str, Any]]:
    """Per posture, as the servo will leave it: joints, the arm's points, the beam from the laser to its end
    (null for a probe), the target's place and name, whether beam or probe comes to it, and empty lists for
    what it breaks of the plan's constraints, in words, and what it touches."""
    laser = scene_plan.header.tool.kind == "laser"
    joints = aimed.joints * scene_plan.robot.display
    return [
        {
            "joints_deg": rounded(joints[i], 9),
            "skeleton": rounded(aimed.arm[i], 3),
            "tool": rounded(aimed.origin[i], 3),
            "beam": rounded(np.array([aimed.origin[i], aimed.end[i]]), 3) if laser else None,
            "target": rounded(aimed.targets[scene_plan.target_index[i]], 3),
            "target_name": scene_plan.targets[i],
            "reaches": bool(aimed.reaches[i]),
            "violations": [],
            "touches": [],
        }
        for i in range(len(scene_plan.postures))
    ]


def _null_motion(checked: Check) -> list[dict[str, Any]]:
    """Per null-space direction, in the order of `identifiability.null_space`: how far each joint, target and
    tool parameter goes along it, in its own unit, for one prior standard deviation of the leading parameter.

    To first order, arm and target that move so keep the beam on the target.
    """
    rows = {row.name: row for row in checked.parameters}
    offsets = [row.name for row in checked.parameters if row.group == "offset"]
    motions = []
    for direction in checked.identifiability.null_space:
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
