"""What the page asks of the calculations: by the same functions as the commands, the same JSON."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ...analysis.observability.aim import aim_plan
from ...analysis.observability.check import Check
from ...analysis.observability.check import check as judge
from ...experiments.arm_shown import ShownArm, arm_json, shown_arm
from ...model.errors import BadInput
from ...model.files.header import PLAN_SCHEMA, UrdfRef
from ...model.files.plan import Plan, plan_of, write_plan
from ...model.files.reading import Document, Place, read_yaml, require_schema
from ...model.files.robot_file import built_in_robots, stated_rows
from ...model.robot import Matrix
from ...reports.plan.plan_scene import Postures, postures_of
from ...reports.words.result_json import check_json
from .asked import NOWHERE, AskedCheck, AskedPlan, AskedRobot, keyed
from .folder import Folder

MOST_POSTURES = 1000  # of a plan that is checked while somebody waits


@cache
def robots() -> list[dict[str, Any]]:
    """The built-in robots: name, vendor and model (null where they are not stated)."""
    stated = [(name, stated_rows(name, Path())) for name in built_in_robots()]
    return [{"name": name, "vendor": rows.vendor, "model": rows.model} for name, rows in stated]


def robot(folder: Folder, wanted: AskedRobot) -> dict[str, Any]:
    """`zerobeam/arm/1`, and in the first posture `skeleton` (n + 2 points, mm: base, joints, flange), `axes`
    (n unit vectors, of the joints) in the base frame; `notes` where numbers look wrong."""
    texts = [] if wanted.joints_deg is None else [", ".join(map(repr, map(float, wanted.joints_deg)))]
    with _noted() as notes:
        ref = _whole_ref(folder, wanted.robot, folder.root)
        arm = shown_arm(ref, texts, units="deg", j3=wanted.j3)
    return _arm(arm) | {"notes": notes}


def plan(folder: Folder, name: str) -> dict[str, Any]:
    """A plan file: its content (`plan`), the `targets` of its postures, its `robot`, and `notes`."""
    path = folder.inside(name)
    with _noted() as notes:
        document = read_yaml(path)
        require_schema(document.data, PLAN_SCHEMA, file=path, line=document.line(("schema",)))
        _require_robot_inside(folder, document.data, path.parent)
        read = plan_of(document)
        ref = _whole_ref(folder, read.header.robot, path.parent)
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
        "robot": _arm(arm),
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
    with _noted() as notes:
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
    with _noted() as notes:
        stated = _stated(folder, wanted.plan, path)
        turned = aim_plan(stated)
        found = judge(stated, turned)
        answer = check_json(found)
        if wanted.scene:
            answer |= {"scene": _scene(stated, postures_of(turned)), "null_motion": _null_motion(found)}
    return answer | {"warnings": notes}


def _stated(folder: Folder, content: dict[str, Any], path: Path) -> Plan:
    """The plan that a file with this content would be; Refused with the key of what is wrong."""
    _require_robot_inside(folder, content, path.parent)
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


def _require_robot_inside(folder: Folder, content: Any, start: Path) -> None:
    stated = content.get("robot") if isinstance(content, dict) else None
    name = stated.get("urdf") if isinstance(stated, dict) else stated
    if isinstance(name, str) and name not in built_in_robots() and (isinstance(stated, dict) or "." in name):
        folder.inside(name, start)


def _whole_ref(folder: Folder, ref: str | UrdfRef, start: Path) -> str | UrdfRef:
    """The same robot, its file with its whole path."""
    if isinstance(ref, UrdfRef):
        return ref.model_copy(update={"urdf": str(folder.inside(ref.urdf, start))})
    if ref in built_in_robots() or "." not in ref:
        return ref
    return str(folder.inside(ref, start))


def _arm(arm: ShownArm) -> dict[str, Any]:
    theta = ca.SX.sym("theta", arm.robot.n)
    both = [ca.densify(arm.robot.skeleton(theta)), ca.densify(arm.robot.axes(theta))]
    points, axes = ca.Function("arm", [theta], both)(arm.poses[0].joints)
    return arm_json(arm) | {
        "skeleton": _rounded(np.array(points).T, 3),
        "axes": _rounded(np.array(axes).T, 9),
    }


def _scene(stated: Plan, seen: Postures) -> list[dict[str, Any]]:
    """Per posture, as the servo will leave it: joints, the arm's points, the beam from the laser to its end
    (null for a probe), the target's place and name, and whether beam or probe comes to it."""
    laser = stated.header.tool.kind == "laser"
    joints = seen.joints * stated.robot.display
    return [
        {
            "joints_deg": _rounded(joints[i], 9),
            "skeleton": _rounded(seen.arm[i], 3),
            "tool": _rounded(seen.origin[i], 3),
            "beam": _rounded(np.array([seen.origin[i], seen.end[i]]), 3) if laser else None,
            "target": _rounded(seen.targets[stated.target_index[i]], 3),
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


def _rounded(values: Matrix, digits: int) -> list[Any]:
    return (np.round(values, digits) + 0.0).tolist()  # type: ignore[no-any-return]


@contextmanager
def _noted() -> Iterator[list[str]]:
    """The notes of our own that are given within, for the page instead of the terminal."""
    notes: list[str] = []
    ours = __package__.partition(".")[0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield notes
    notes += [str(note.message) for note in caught if note.category.__module__.startswith(ours)]
