"""Plans: reading, writing, and what one will determine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from ....analysis.observability.aim import aim_plan
from ....analysis.observability.check import Check
from ....analysis.observability.check import check as judge
from ....experiments.arm_shown import shown_arm
from ....model.errors import BadInput
from ....model.files.header import PLAN_SCHEMA
from ....model.files.plan import Plan, plan_of, write_plan
from ....model.files.reading import Document, Place, read_yaml, require_schema
from ....model.files.validation import FileModel
from ....reports.plan.plan_scene import Postures, postures_of
from ....reports.words.result_json import check_json
from ..asked import NOWHERE, keyed
from ..end_point import EndPoint
from ..folder import Folder
from .notes import noted
from .robots import arm_of, require_robot_inside, rounded, whole_ref

MOST_POSTURES = 1000  # of a plan that is checked while somebody waits


class AskedCheck(FileModel):
    """A plan to check."""

    plan: dict[str, Any] = Field(description="the content of a plan file (zerobeam/plan/1)")
    file: str | None = Field(
        default=None, description="the file that it is from: paths in the plan are relative to its folder"
    )
    scene: bool = Field(default=False, description="whether to say where arm, beam and target are")


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
        arm = shown_arm(
            ref,
            [", ".join(map(repr, (read.postures[0] * read.robot.display).tolist()))],
            units="deg",
            j3="link",
        )
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
    if path.suffix.lower() not in {".yaml", ".yml"} or path.name.startswith("."):
        raise BadInput("a plan cannot have this name", found=wanted.file, allowed="a name that ends in .yaml")
    if path.exists():
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=None)
    with noted() as notes:
        stated = _stated(folder, wanted.plan, path)
    rows = stated.postures * stated.robot.display
    via = [between * stated.robot.display for between in stated.via]
    # What degrees lose on the way to radians and back is far below what a file states.
    write_plan(path, stated.header, np.round(rows, 9), stated.targets, via_deg=via, force=path.exists())
    return {"file": folder.called(path), "notes": [*notes, *stated.warnings]}


def check(folder: Folder, wanted: AskedCheck) -> dict[str, Any]:
    """`zerobeam/check/1`; with `scene` also what a picture needs, and `null_motion`."""
    path = folder.root / NOWHERE if wanted.file is None else folder.inside(wanted.file)
    postures = wanted.plan.get("postures_deg")
    if isinstance(postures, list) and len(postures) > MOST_POSTURES:
        raise BadInput(
            "the plan is too long to be checked while you wait",
            found=f"{len(postures)} postures",
            allowed=f"at most {MOST_POSTURES}",
            remedy="use zerobeam check",
        )
    with noted() as notes:
        stated = _stated(folder, wanted.plan, path)
        turned = aim_plan(stated)
        found = judge(stated, turned)
        answer = check_json(found)
        if wanted.scene:
            answer |= {"scene": _scene(stated, postures_of(turned)), "null_motion": _null_motion(found)}
    return answer | {"warnings": notes}


def _stated(folder: Folder, content: dict[str, Any], path: Path) -> Plan:
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

    def line(self, place: Place) -> int | None:
        return self.finder(place)


def _scene(stated: Plan, seen: Postures) -> list[dict[str, Any]]:
    """Per posture, as the servo will leave it: joints, the arm's points, the beam from the laser to its end
    (null for a probe), the target's place and name, and whether beam or probe comes to it."""
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
]
