"""The picture of a plan: one HTML file with the postures to turn about, and what the shots will tell."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ...analysis.observability.aim import AimedPlan
from ...model.errors import BadInput
from ...model.files.plan import Plan
from ...model.files.whole_file import sync_folder, write_whole
from ..output.template import TEMPLATES, style, template
from ..run.view import VERDICT_WORDS
from ..run.view_parameters import STATUS_WORDS, legend, reasons, unit_of
from ..run.view_unknown import advice_words, over_target_words, unknown
from ..scenes.drawing import MOST_DRAWN
from ..scenes.scene import Scene3D
from ..scenes.turnable import SceneWords, turnable
from ..style.blocks import Cell, Facts, Legend, Row, Table, Verdict, row_of, table_of
from ..words import numbers
from ..words.wording import clipped, counted, label, listed, sentence, shown
from .plan_scene import Postures, plan_scene, postures_of

Json = dict[str, Any]

NOT_TOLD = "not told by these shots"
_MARK = '<meta name="generator" content="zerobeam plan page">'
_HEAD = 1000  # bytes: where the mark stands, before anything that comes from a plan
_NEAR_MM = 0.01


def write_plan_page(path: Path, aimed: AimedPlan, answer: Json) -> None:
    """Write the page of a plan (`plan_page`) to `path`, replacing nothing but such a page.

    Written aside, then renamed. BadInput if something else stands there or the folder does not exist.
    """
    target = Path(os.path.realpath(path))
    _check_target(path, target)
    text = plan_page(aimed, answer)
    try:
        with tempfile.TemporaryDirectory(prefix=".zerobeam-plan-", dir=target.parent) as aside:
            whole = Path(aside) / target.name
            write_whole(whole, text)
            _check_target(path, target)
            os.replace(whole, target)
        sync_folder(target.parent)
    except OSError as error:
        raise BadInput(
            "the picture of the plan cannot be written",
            found=error.strerror or str(error),
            remedy="name a file in a folder that may be written to",
            file=path,
        ) from error


def _check_target(path: Path, target: Path) -> None:
    allowed = "a file that does not exist, or a picture of a plan that zerobeam wrote"
    if not target.parent.is_dir():
        raise BadInput(
            "the folder to write the picture into does not exist",
            found=path.parent,
            remedy="make it first",
            file=path,
        )
    if target.is_dir():
        raise BadInput("there is a folder of this name", allowed=allowed, file=path)
    if target.exists() and not _is_plan_page(target):
        raise BadInput(
            "the file exists already and is no picture of a plan; it would be lost",
            allowed=allowed,
            remedy="choose another name, or move it away first",
            file=path,
        )


def _is_plan_page(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return head.startswith(b"<!doctype html>") and _MARK.encode() in head


def plan_page(aimed: AimedPlan, answer: Json) -> str:
    """The page as HTML; `answer` is the plan's `zerobeam/check/1`. One file, no network."""
    plan, seen = aimed.plan, postures_of(aimed)
    scene = plan_scene(plan, seen)
    shown = turnable(scene, _scene_words(plan, seen, scene))
    return template("plan.html.j2").render(
        mark_of_ours=Markup(_MARK),
        view=_told(plan, answer, seen),
        turnable=shown,
        # Our own text, with nothing of the plan in it.
        css=Markup(style() + (TEMPLATES / "plan.css").read_text(encoding="utf-8")) + shown.style,
    )


# ── what the page says ────────────────────────────────────────────────────────────────────────


def _told(plan: Plan, answer: Json, seen: Postures) -> Json:
    inputs, parameters = answer["inputs"], answer["parameters"]
    targets = [clipped(name, 24) for name in plan.target_names]
    count = len(plan.postures)
    return {
        "title": f"Plan {clipped(inputs['plan'], 60)}",
        "subtitle": f"{counted(count, 'posture')} of {clipped(inputs['robot'])} at "
        f"{counted(len(targets), 'target')}: {listed(targets)}",
        "verdict": Verdict(answer["verdict"], VERDICT_WORDS[answer["verdict"]], sentence(answer["headline"])),
        "notes": [sentence(note) for note in answer["notes"]] + _outlook(answer),
        "predicted": _predicted(parameters),
        "legend": Legend(
            legend(parameters, plan.header.model_dump(mode="json", include={"tolerance"})),
            reasons(parameters),
        ),
        "unknown": {**unknown(answer), "sentence": _unknown_sentence(answer)},
        "postures": _postures(plan, answer, seen),
        "joints": _joints_to_copy(plan, seen),
        "inputs": Facts(
            [
                ("Plan", shown(inputs["plan"])),
                ("SHA-256 of the plan", inputs["sha256"]),
                ("Robot", shown(inputs["robot"])),
                ("Versions", ", ".join(f"{shown(k)} {shown(v)}" for k, v in inputs["versions"].items())),
            ]
        ),
    }


def _outlook(answer: Json) -> list[str]:
    """What `check` says beyond the verdict."""
    words = [] if answer["advice"] is None else [advice_words(answer["advice"])]
    return words if answer["over_target"] is None else [*words, over_target_words(answer["over_target"])]


def _scene_words(plan: Plan, seen: Postures, scene: Scene3D) -> SceneWords:
    """What is said about the picture."""
    count = len(plan.postures)
    places = [
        f"{clipped(name, 24)} at {', '.join(numbers.fixed(value, 0) for value in place)}\u00a0mm"
        for name, place in zip(plan.target_names, seen.targets.tolist(), strict=True)
    ]
    laser = plan.header.tool.kind == "laser"
    what = "and its beam to the target" if laser else "with the probe at the target"
    alt = (
        f"The arm as a line through its joints in {counted(count, 'posture')}, {what}, above a floor grid. "
        f"Targets (x, y, z in the base frame): {listed(places)}. "
        "The table of postures on this page says the same in numbers."
    )
    caption = (
        f"Grid of {numbers.exact(scene.grid_step, 'mm')} at z = 0; x, y and z are the base frame. "
        "No joint offsets; targets at their nominal places."
    )
    few = f" Drawn on paper: the first {MOST_DRAWN} postures." if count > MOST_DRAWN else ""
    paper = "On paper: posture 0 in black, the others in grey." + few
    return SceneWords(alt, caption, paper, "posture", laser)


def _predicted(parameters: list[Json]) -> Table:
    columns = [
        ("name", "left"),
        ("status", "left"),  # second, so that a phone shows it without scrolling
        ("predicted std", "right"),
        ("from the data alone", "right"),
        ("known before", "right"),
    ]
    return table_of(
        "Standard deviations that these shots will give", columns, [_predicted_row(row) for row in parameters]
    )


def _predicted_row(row: Json) -> Row:
    """One unknown. Where the shots cannot tell it, its row has no number that could be taken for one."""
    status, unit = row["status"], unit_of(row)
    name, word = label(row["name"]), Cell(STATUS_WORDS[status], mark=status)
    if status == "held" or row["held"]:
        return row_of(name, word, Cell("not estimated", span=3), tone=status)
    if status == "unidentifiable" or row["std"] is None:
        return row_of(name, word, Cell(NOT_TOLD, span=3), tone=status)
    alone = "infinite" if row["data_std"] is None else numbers.spread(row["data_std"], unit)
    before = numbers.spread(row["prior_std"], unit)
    return row_of(name, word, numbers.spread(row["std"], unit), alone, before, tone=status)


def _unknown_sentence(answer: Json) -> str:
    names = [label(row["name"]) for row in answer["parameters"] if row["status"] == "unidentifiable"]
    if names:
        verb, it = ("is", "it") if len(names) == 1 else ("are", "them")
        return f"{listed(names)} {verb} {NOT_TOLD}: no value will be given for {it}."
    if answer["identifiability"]["null_space"]:
        return "Every parameter that is not held will be told, but some combinations only poorly."
    return "Nothing that was asked for: these shots tell every parameter that is not held."


def _postures(plan: Plan, answer: Json, seen: Postures) -> Json:
    laser = plan.header.tool.kind == "laser"
    columns = [("posture", "right"), ("target", "left")]
    columns += [(f"joint {j + 1}", "right") for j in range(plan.robot.n)]
    columns += [("beam length", "right")] if laser else []
    columns += [("off before aiming", "right")]
    rows = []
    for i, posture in enumerate(answer["postures"]):
        joints = [
            numbers.with_unit(numbers.fixed(float(value) * joint.display, 2), joint.unit)
            for value, joint in zip(seen.joints[i], plan.robot.joints, strict=True)
        ]
        length = numbers.with_unit(numbers.fixed(float(seen.length[i]), 0), "mm")
        beam = [length if seen.reaches[i] else "behind it" if posture["hit"] else "misses"] if laser else []
        off = posture["off_mm"]
        near = f"below {numbers.exact(_NEAR_MM, 'mm')}"
        told = near if off < _NEAR_MM else numbers.significant(off, 2, "mm")
        tone = "" if seen.reaches[i] else "weak"
        rows.append(
            row_of(str(posture["posture"]), clipped(posture["target"], 24), *joints, *beam, told, tone=tone)
        )
    off_mm = max(posture["off_mm"] for posture in answer["postures"])
    said = "The joints are those of the aimed postures: the servo turns the arm until the target is hit."
    if off_mm > 0.05:
        said += f" As planned, they point up to {numbers.significant(off_mm, 2, 'mm')} beside it."
    if not seen.hit.all():
        said += " Where the target cannot be hit the joints are the planned ones, and no shot is counted."
    return {"sentence": said, "table": table_of("Postures, turned onto their targets", columns, rows)}


def _joints_to_copy(plan: Plan, seen: Postures) -> str:
    """The aimed postures as they stand in a plan file: degrees, or mm for a prismatic joint."""
    several = len(plan.target_names) > 1
    lines = ["postures_deg:"]
    for row, name in zip((seen.joints * plan.robot.display).tolist(), plan.targets, strict=True):
        values = json.dumps([round(value, 6) + 0.0 for value in row])
        lines.append(
            f"  - {{joints_deg: {values}, target: {json.dumps(name)}}}" if several else f"  - {values}"
        )
    return "\n".join(lines)
