"""The sheet for the person at the robot (PDF): postures with pictures, what to look at, fields to fill in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...analysis.observability.aim import AimedPlan
from ...analysis.observability.check import Check
from ...model.files.plan import Plan
from ...model.kinematics.pendant import Pendant, pendant_of
from ...model.kinematics.robot import J3
from ...words import numbers
from ...words.wording import capital, clipped, counted, listed, sentence, shown
from ..output.pdf import pdf
from ..scenes.scene import Placed, Scene3D, floor_of
from ..scenes.turnable import still_picture, turnable
from ..style.blocks import (
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture
from .plan_page import Postures, posture_in_scene, postures_of, verdict_on

_DIGITS = {"deg": 3, "mm": 3, "rad": 5, "pulse": 0}  # decimals, as pendants show them
_FIELD = "\u2009".join(["_"] * 9)


def operator_sheet(aimed: AimedPlan, check: Check, j3: J3 | None = None) -> bytes:
    """The PDF of a plan; `check` is the judgement of the same aimed plan. Joints are those of the pendant, by
    the robot file or `j3`. BadInput where neither says what joint 3 is counted from."""
    plan, postures = aimed.plan, postures_of(aimed)
    pendant = pendant_of(plan.robot, j3)
    tool = plan.header.instrument
    pictures = {f"posture-{i}": _picture(plan, postures, i) for i in range(len(plan.postures))}
    targets = listed([clipped(name, 24) for name in plan.target_names])
    page = Page(
        title=f"Operator's sheet: {clipped(check.inputs.plan, 60)}",
        subtitle=f"{counted(len(plan.postures), 'posture')} of {clipped(plan.robot.name)} at {targets},"
        " in this order",
        verdict=verdict_on(check),
        notes=[
            "The way from posture to posture is not checked for obstacles. First time: reduced speed, a hand"
            " on the enabling switch.",
            tool.words.to_do,
            *([] if pendant.sentence is None else [sentence(f"As on the pendant, {pendant.sentence}.")]),
        ],
        sections=[
            section_of("In their order", _overview(plan, postures, pendant)),
            *(_posture(plan, postures, i, pendant) for i in range(len(plan.postures))),
        ],
        facts=[
            ("Robot, serial number", _FIELD),
            ("Measured by, on", _FIELD),
            ("Plan", f"{shown(check.inputs.plan)}, SHA-256 {check.inputs.sha256[:12]}"),
        ],
    )
    return pdf(page, pictures)


def _joints(pendant: Pendant, row: np.ndarray) -> list[str]:
    """As the pendant shows joints (n,), rad or mm."""
    values = pendant.shown(row * pendant.robot.display).tolist()
    return [
        numbers.with_unit(numbers.fixed(value, _DIGITS[unit]), unit)
        for value, unit in zip(values, [pendant.units[i] for i in pendant.order], strict=True)
    ]


def _names(pendant: Pendant) -> list[tuple[str, str]]:
    return [(pendant.names[i], "right") for i in pendant.order]


def _overview(plan: Plan, postures: Postures, pendant: Pendant) -> Table:
    rows = [
        row_of(
            str(i), clipped(target, 24), *_joints(pendant, plan.postures[i]), _millimetres(postures.length[i])
        )
        for i, target in enumerate(plan.called)
    ]
    columns = [("posture", "right"), ("target", "left"), *_names(pendant), ("beam", "right")]
    return table_of("Planned postures, and the length of the beam", columns, rows)


def _millimetres(value: float) -> str:
    return numbers.with_unit(numbers.fixed(float(value), 0), "mm")


def _posture(plan: Plan, postures: Postures, i: int, pendant: Pendant) -> Section:
    tool = plan.header.instrument
    reach = float(np.linalg.norm(postures.origin[i][:2]))
    where = [
        (f"{capital(tool.name)} at", _coordinates(postures.origin[i])),
        ("Distance from axis z", _millimetres(reach)),
    ]
    if tool.beam:
        where.append(("Beam to the target", _millimetres(postures.length[i])))
    rows: list[Row] = [
        row_of(f"by way of {k}", *_joints(pendant, between))
        for k, between in enumerate(plan.via_of(i), start=1)
    ]
    rows += [
        row_of("planned", *_joints(pendant, plan.postures[i])),
        row_of("recorded", *[_FIELD] * plan.robot.n),
    ]
    table = table_of(f"Joints at posture {i}", [("", "left"), *_names(pendant)], rows)
    filled: Sequence[tuple[str, str]] = [
        *((field, _FIELD) for field in tool.words.fields),
        ("Time, remarks", _FIELD),
    ]
    note = None
    if not postures.reaches[i]:
        note = Paragraph("By the model this posture does not reach its target: see zerobeam check.")
    title = f"Posture {i}, target {clipped(plan.called[i], 24)}"
    blocks = (note, FigureBlock(f"posture-{i}"), Facts(where), table, Facts(filled))
    return section_of(title, *blocks, new_page=True)


def _coordinates(point: np.ndarray) -> str:
    coordinates = ", ".join(numbers.fixed(float(value), 0) for value in point)
    return f"{coordinates}\u00a0mm (x, y, z of the base)"


def _picture(plan: Plan, postures: Postures, i: int) -> Picture:
    """One posture, drawn as the first one of a page is."""
    posed = posture_in_scene(plan, postures, i, f"posture {i}")
    target = plan.target_index[i]
    placed = Placed(plan.target_names[target], postures.targets[target], "nominal")
    scene = Scene3D([posed], [placed], floor_of(plan.robot))
    view = turnable(
        scene,
        alt=f"The arm in posture {i}, with {plan.header.instrument.words.posture}.",
        caption=f"Posture {i}. {scene.grid_words}; x, y, z: the base frame.",
        paper="",
    )
    return still_picture(view, f"posture-{i}")
