"""The page of a plan: one HTML file with the postures in 3D and the predicted uncertainties."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...analysis.diagnostics.null_motion import motion_of_plan
from ...analysis.observability.aim import AimedPlan
from ...analysis.observability.causes import NullDirection
from ...analysis.observability.check import Check
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.files.whole_file import refuse_existing, write_whole
from ...model.kernel import one_blas_thread
from ...words import numbers
from ...words.geometry_words import check_lines
from ...words.message import WHAT_ELSE
from ...words.observability import outlook_lines, rank_facts
from ...words.outlook_words import TITLE
from ...words.plan_catalogue import check_notes, planned_anew
from ...words.wording import again_words, clipped, counted, label, listed, sentence, shown
from ..output.html import Turnable, html
from ..run.front import outlook_blocks
from ..run.parameter_section import legend, reasons
from ..run.unobservable import direction_words, motion_picture, motion_section, tolerance_only
from ..scene import MOST_DRAWN, Placed, Posed, Scene3D, axes_of, floor_of, turnable
from ..style.blocks import (
    Commands,
    Directions,
    Facts,
    Legend,
    Page,
    Paragraph,
    SceneBlock,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from .check_page import NOT_DETERMINED, check_front, first_words, predicted_table, verdict_on


class Postures(NamedTuple):
    """The postures of a plan as places in the base frame, where the servo can turn them onto their targets.

    `joints` (N, n) rad or mm, as planned where `hit` (N,) is False; `arm` (N, n + 2, 3), `origin` (N, 3) and
    `end` (N, 3) of the beam (the tip of a probe), `targets` (K, 3) mm; `length` (N,) mm along the beam to the
    point nearest to the target, negative where the laser points away from it; `reaches` (N,) whether beam or
    probe comes to the target: a laser shines one way only. `beam` whether there is one, `met` whether the
    joints are turned onto targets at all.
    """

    joints: Matrix
    hit: NDArray[np.bool_]
    arm: Matrix
    origin: Matrix
    end: Matrix
    targets: Matrix
    length: Matrix
    reaches: NDArray[np.bool_]
    beam: bool
    met: bool


def postures_of(aimed_plan: AimedPlan) -> Postures:
    """What `check` judges: no offsets, targets at their nominal places. A beam that does not reach its target
    is as long as that is far."""
    problem, x, aimed = aimed_plan.problem, aimed_plan.x, aimed_plan.aimed
    joints = np.where(aimed.hit[:, None], aimed.problem.joints, problem.joints)
    with one_blas_thread():
        parts = problem.split(x)
        (points,) = problem.functions.kernel("skeleton")(joints, parts.arm)
        origin, direction = problem.moved(joints).beams(x)
    between = parts.targets[problem.target_index] - origin
    along = (between * direction).sum(axis=1)
    reaches = aimed.hit & aimed.ahead
    length = np.where(reaches, along, np.linalg.norm(between, axis=1))
    end = origin + length[:, None] * direction
    arm, tool = points.transpose(0, 2, 1), problem.tool
    return Postures(joints, aimed.hit, arm, origin, end, parts.targets, along, reaches, tool.beam, tool.met)


def plan_scene(plan: Plan, postures: Postures) -> Scene3D:
    """The scene of a plan."""
    count, axes = len(postures.joints), axes_of(plan.robot, postures.joints)
    return Scene3D(
        [
            replace(posture_in_scene(postures, i, f"posture {i} (of 0 to {count - 1})"), axes=axes[i])
            for i in range(count)
        ],
        [Placed(name, at, "nominal") for name, at in _places(plan, postures)],
        floor_of(plan.robot),
        kinds=[joint.kind for joint in plan.robot.joints],
    )


def _places(plan: Plan, postures: Postures) -> Iterator[tuple[str, Matrix]]:
    """Targets that are points, by their places. Of an instrument that is to be set up nobody knows where."""
    for name, at in zip(plan.target_names, postures.targets, strict=False):
        entry = plan.header.targets.get(name)
        if entry is None or entry.normal is None:
            yield name, at


def posture_in_scene(postures: Postures, i: int, name: str) -> Posed:
    end = postures.end[i] if postures.beam else None
    return Posed(name, postures.arm[i], postures.origin[i], end, bool(postures.reaches[i]))


_MARK = b'<meta name="generator" content="zerobeam plan page">'
_HEAD = 1000  # bytes: where the mark is, before anything that comes from a plan
_NEAR_MM = 0.01
_ABOUT_COPIES = (
    "Each row is one posture’s joints_deg: degrees, millimetres for a prismatic joint. One click selects all."
)


def plan_page(aimed: AimedPlan, check: Check) -> str:
    """The page as HTML: one file, no network. `check` is the judgement of the same aimed plan."""
    postures = postures_of(aimed)
    motion, directions = motion_of_plan(check), check.identifiability.null_space
    why = motion_section(motion, directions, len(postures.joints))
    page = _page(aimed.plan, check, postures, why)
    picture = motion_picture(motion, directions, len(postures.joints))
    pictures = {} if picture is None else {picture.name: picture}
    return html(page, pictures, "plan", turnable=plan_turnable(aimed, postures))


def plan_turnable(aimed: AimedPlan, postures: Postures) -> Turnable:
    """The scene of a plan made ready for a page, with what is said about it."""
    plan, scene = aimed.plan, plan_scene(aimed.plan, postures)
    count = len(postures.joints)
    targets = [
        f"{clipped(name, 24)} at {', '.join(numbers.fixed(value, 0) for value in at)}\u00a0mm"
        for name, at in _places(plan, postures)
    ]
    named = f" Targets (x, y, z in the base frame): {listed(targets)}." if targets else ""
    few = f" Drawn on paper: the first {MOST_DRAWN} postures." if count > MOST_DRAWN else ""
    what = listed(list(dict.fromkeys(kind.words.posture for kind in plan.header.kinds.values())))
    return turnable(
        scene,
        alt=f"The arm in {counted(count, 'posture')}, with {what}, above a floor"
        f" grid.{named}"
        " The table of postures on this page says the same in numbers.",
        caption=f"{scene.grid_words}; x, y and z are the base frame."
        f" No joint offsets{'; targets at their nominal places' if targets else ''}.",
        paper=f"On paper: posture 0 in black, the others in grey.{few}",
    )


def _page(plan: Plan, check: Check, postures: Postures, why: Section | None) -> Page:
    inputs, facts = check.inputs, check.identifiability
    targets = [clipped(name, 24) for name in plan.target_names]
    header = plan.header.model_dump(mode="json", include={"tolerance"})
    others = [row for row in check.parameters if not row.tolerated]
    undetermined = [_undetermined(check, facts.null_space), tolerance_only(check.parameters)]
    versions = ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs.versions.items())
    measured = f" at {counted(len(targets), 'target')}: {listed(targets)}" if targets else ""
    first = first_words(check)
    more = [*map(sentence, check_notes(check)), *check_lines(check), *outlook_lines(check)]
    also = [Paragraph(text) for text in more if text not in first.cautions]
    return Page(
        title=f"Plan {clipped(inputs.plan, 60)}",
        subtitle=f"{counted(len(postures.joints), 'posture')} of {clipped(inputs.robot)}{measured}",
        verdict=verdict_on(check),
        notes=[],
        message=first,
        front=check_front(check),
        sections=[
            *([] if why is None else [why]),
            section_of("", SceneBlock()),
            section_of(
                "Predicted uncertainties",
                predicted_table(check, others),
                Legend(legend((row.status for row in others), header), reasons(others)),
            ),
            *_outlook(check),
            *([section_of(WHAT_ELSE, *also)] if also else []),
            section_of(
                "What is not observable",
                Paragraph(" ".join(text for text in undetermined if text)),
                Directions([direction_words(direction) for direction in facts.null_space]),
                Facts(rank_facts(facts)),
            ),
            section_of(
                "Postures", Paragraph(_about_postures(check, postures)), _postures(plan, check, postures)
            ),
            *_copies(_joints_to_copy(plan, postures)),
            section_of(
                "Inputs",
                Facts(
                    [
                        ("Plan", shown(inputs.plan)),
                        ("SHA-256 of the plan", inputs.sha256),
                        ("Robot", shown(inputs.robot)),
                        ("Versions", versions),
                    ]
                ),
            ),
        ],
    )


def _outlook(check: Check) -> list[Section]:
    blocks = outlook_blocks(check.outlook, check.parameters, planned_anew(check), brief=False)
    return [section_of(TITLE, *blocks)] if blocks else []


def _copies(lines: list[str]) -> list[Section]:
    if not lines:
        return []
    blocks = Paragraph(_ABOUT_COPIES), Commands(lines)
    return [section_of("The same to copy into a plan", *blocks, level=2)]


def _undetermined(check: Check, directions: Sequence[NullDirection]) -> str:
    """Of all parameters without a tolerance."""
    parameters = [row for row in check.parameters if not row.tolerated]
    what = "parameter" if len(parameters) == len(check.parameters) else "other parameter"
    names = [label(row.name) for row in parameters if row.status == "unidentifiable"]
    if names:
        verb, it = ("is", "it") if len(names) == 1 else ("are", "them")
        return f"{listed(names)} {verb} {NOT_DETERMINED}: no value will be given for {it}."
    if directions:
        return f"Every {what} that is not held is identifiable, but some combinations are weakly observable."
    return f"Every {what} that is not held is identifiable."


def _about_postures(check: Check, postures: Postures) -> str:
    if not postures.met:
        return "The joints are those of the plan. The instrument reads in every posture."
    off_mm = max(posture.off_mm for posture in check.postures)
    text = (
        "The joints are those of the aimed postures: the servo aims the beam at the target."
        if postures.beam
        else "The joints are those at which the target is met."
    )
    if off_mm > 0.05:
        text += f" As planned, they miss it by up to {numbers.significant(off_mm, 2, 'mm')}."
    if not postures.hit.all():
        text += (
            " Where the target cannot be hit the joints are the planned ones, and no measurement is counted."
        )
    return text


def _postures(plan: Plan, check: Check, postures: Postures) -> Table:
    with_beam = postures.beam
    heads = ["posture", "target", *(f"joint {j + 1}" for j in range(plan.robot.n))]
    heads += [*(["beam length"] if with_beam else []), "off before aiming"]
    near = f"below {numbers.exact(_NEAR_MM, 'mm')}"
    rows = []
    for i, posture in enumerate(check.postures):
        joints = [
            numbers.with_unit(numbers.fixed(float(value) * joint.display, 2), joint.unit)
            for value, joint in zip(postures.joints[i], plan.robot.joints, strict=True)
        ]
        length = numbers.with_unit(numbers.fixed(float(postures.length[i]), 0), "mm")
        if with_beam:
            joints.append(length if postures.reaches[i] else "behind it" if posture.hit else "misses")
        off = near if posture.off_mm < _NEAR_MM else numbers.significant(posture.off_mm, 2, "mm")
        tone = "" if postures.reaches[i] else "weak"
        target = clipped(posture.target, 24) + again_words(plan.repeated_by(posture.posture))
        rows.append(row_of(str(posture.posture), target, *joints, off, tone=tone))
    caption = "Postures, rotated onto their targets" if postures.met else "Postures"
    return table_of(caption, heads, rows, "rlr")


def _joints_to_copy(plan: Plan, postures: Postures) -> list[str]:
    """The aimed postures as in a plan file: degrees, or mm for a prismatic joint."""
    if not postures.met or not all(means.usual for means in plan.means):
        return []
    several = len(plan.target_names) > 1
    lines = ["postures_deg:"]
    shown = (postures.joints * plan.robot.display).tolist()
    for i, name in enumerate(plan.called):
        again = plan.repeated_by(i)
        values = json.dumps([round(value, 6) + 0.0 for value in shown[i if again is None else again]])
        repeats = "" if again is None else f", again: {again}"
        whole = f"  - {{joints_deg: {values}, target: {json.dumps(name)}{repeats}}}"
        lines.append(whole if several or repeats else f"  - {values}")
    return lines


def write_plan_page(path: Path | str, aimed: AimedPlan, check: Check) -> None:
    """Write the page of a plan (`plan_page`) to `path`, replacing nothing but such a page.

    BadInput if something else is there or the folder does not exist, NotWritten where it cannot be written.
    """
    path = Path(path)
    refuse_existing(path, force=_is_plan_page(path) or None)
    write_whole(Path(os.path.realpath(path)), plan_page(aimed, check), force=True)


def _is_plan_page(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return head.startswith(b"<!doctype html>") and _MARK in head
