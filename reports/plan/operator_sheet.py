"""The sheet for the person at the robot (PDF): postures with pictures, what to look at, fields to fill in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...analysis.observability.aim import AimedPlan
from ...analysis.observability.check import Check
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.instruments.kind import PartRead, Target
from ...model.kinematics.pendant import Pendant, pendant_of
from ...model.likelihood.problem import by_posture
from ...model.options import J3
from ...words import numbers
from ...words.wording import again_words, capital, clipped, counted, listed, sentence, shown
from ..output.pdf import pdf
from ..scene import Placed, Posed, Scene3D, floor_of, still_picture, turnable
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
from .check_page import verdict_on
from .plan_page import Postures, postures_of

_DIGITS = {"deg": 3, "mm": 3, "rad": 5, "pulse": 0}  # decimals, as pendants show them
_FIELD = "\u2009".join(["_"] * 9)
_TYPED = (
    "In a run by hand (zerobeam run --rig manual) type the recorded joints, | and the readings, from left to"
    " right."
)
_SHARED = "What is measured in one posture shares a page: do not move the arm between its readings."


class _Posture(NamedTuple):
    """What is done in one posture: the measurements by their `numbers`, which are those of the plan, `row` of
    its problem, and the parts of the instruments that read, in the same order."""

    row: int
    numbers: tuple[int, ...]
    parts: tuple[PartRead, ...]


def operator_sheet(aimed: AimedPlan, check: Check, j3: J3 | None = None) -> bytes:
    """The PDF of a plan; `check` is the judgement of the same aimed plan. Joints are those of the pendant, by
    the robot file or `j3`. BadInput where neither says what joint 3 is counted from."""
    plan, postures = aimed.plan, postures_of(aimed)
    pendant = pendant_of(plan.robot, j3)
    steps = list(_steps(aimed))
    pictures = {f"posture-{step.numbers[0]}": _picture(aimed, postures, step) for step in steps}
    targets = [clipped(name, 24) for name in plan.target_names]
    at = f" at {listed(targets)}" if targets else ""
    kinds = plan.header.kinds
    several = len(kinds) > 1
    page = Page(
        title=f"Operator's sheet: {clipped(check.inputs.plan, 60)}",
        subtitle=f"{counted(len(steps), 'posture')} of {clipped(plan.robot.name)}{at}, in this order",
        verdict=verdict_on(check),
        notes=[
            "The way from posture to posture is not checked for obstacles. First time: reduced speed, a hand"
            " on the enabling switch.",
            *(
                f"{capital(clipped(label, 24))}: {kind.words.to_do}" if several else kind.words.to_do
                for label, kind in kinds.items()
            ),
            *([_TYPED] if any(kind.heads() for kind in kinds.values()) else []),
            *([_SHARED] if len(steps) < len(plan.postures) else []),
            *([] if pendant.sentence is None else [sentence(f"As on the pendant, {pendant.sentence}.")]),
        ],
        sections=[
            section_of("In their order", _overview(plan, postures, steps, pendant)),
            *(_posture(aimed, postures, step, pendant) for step in steps),
        ],
        facts=[
            ("Robot, serial number", _FIELD),
            ("Measured by, on", _FIELD),
            ("Plan", f"{shown(check.inputs.plan)}, SHA-256 {check.inputs.sha256[:12]}"),
        ],
    )
    return pdf(page, pictures)


def _steps(aimed: AimedPlan) -> Iterator[_Posture]:
    """The postures in their order."""
    problem, measurements = aimed.problem, aimed.plan.measurements
    rows, _ = by_posture(measurements)
    for row, first in enumerate(rows):
        parts = {
            (part.instrument.label, part.variant): part
            for part in problem.tool.read_at(problem.readings[row])
        }
        numbers = [i for i, item in enumerate(measurements) if item.posture == measurements[first].posture]
        of = [parts[measurements[i].instrument, measurements[i].variant] for i in numbers]
        met_first = sorted(zip(numbers, of, strict=True), key=lambda each: not each[1].instrument.met)
        yield _Posture(row, tuple(number for number, _ in met_first), tuple(part for _, part in met_first))


def _joints(pendant: Pendant, row: Matrix) -> list[str]:
    """As the pendant shows joints (n,), rad or mm."""
    values = pendant.shown(row * pendant.robot.display).tolist()
    return [
        numbers.with_unit(numbers.fixed(value, _DIGITS[unit]), unit)
        for value, unit in zip(values, [pendant.units[i] for i in pendant.order], strict=True)
    ]


def _names(pendant: Pendant) -> list[str]:
    return [pendant.names[i] for i in pendant.order]


def _overview(plan: Plan, postures: Postures, steps: Sequence[_Posture], pendant: Pendant) -> Table:
    beams = any(part.instrument.beam for step in steps for part in step.parts)
    rows = []
    for step in steps:
        for number, part in zip(step.numbers, step.parts, strict=True):
            length = _millimetres(postures.length[step.row]) if part.instrument.beam else ""
            row = [str(number), _measured(plan, number), *_joints(pendant, plan.postures[number])]
            rows.append(row_of(*row, *([length] if beams else [])))
    heads = ["posture", "measured", *_names(pendant), *(["beam"] if beams else [])]
    caption = f"Planned postures{', and the length of the beam' if beams else ''}"
    return table_of(caption, heads, rows, "rlr")


def _measured(plan: Plan, number: int, of_target: str = "") -> str:
    """What is measured: a target, behind `of_target`, or reflector, behind its instrument where there are
    several."""
    called = clipped(plan.called[number], 24)
    label = clipped(plan.measurements[number].instrument, 24)
    what = f"{of_target}{called}" if plan.targets[number] else called
    what += again_words(plan.repeated_by(number))
    return f"{label}, {what}" if len(plan.header.labels) > 1 and called != label else what


def _millimetres(value: float) -> str:
    return numbers.with_unit(numbers.fixed(float(value), 0), "mm")


def _posture(aimed: AimedPlan, postures: Postures, step: _Posture, pendant: Pendant) -> Section:
    plan, first = aimed.plan, step.numbers[0]
    where = []
    for part, (point, _) in zip(step.parts, _lines(aimed, postures, step), strict=True):
        name = f"{part.instrument.words.part} {clipped(part.variant, 24)}".strip()
        where.append((f"{capital(name)} at", _coordinates(point)))
        where.append(("Distance from axis z", _millimetres(float(np.linalg.norm(point[:2])))))
        if part.instrument.beam:
            where.append(("Beam to the target", _millimetres(postures.length[step.row])))
    rows: list[Row] = [
        row_of(f"by way of {k}", *_joints(pendant, between))
        for k, between in enumerate(plan.via_of(first), start=1)
    ]
    rows += [
        row_of("planned", *_joints(pendant, plan.postures[first])),
        row_of("recorded", *[_FIELD] * plan.robot.n),
    ]
    which = listed([str(number) for number in step.numbers])
    table = table_of(f"Joints at posture {which}", ["", *_names(pendant)], rows)
    fields = dict.fromkeys(field for part in step.parts for field in part.instrument.words.fields)
    filled: Sequence[tuple[str, str]] = [*((field, _FIELD) for field in fields), ("Time, remarks", _FIELD)]
    note = None
    if postures.met and not postures.reaches[step.row]:
        note = Paragraph("By the model this posture does not reach its target: see zerobeam check.")
    measured = "; ".join(_measured(plan, number, "target ") for number in step.numbers)
    figure = FigureBlock(f"posture-{first}")
    blocks = (note, figure, Facts(where), table, *_readings(plan, step), Facts(filled))
    return section_of(f"Posture {which}, {measured}", *blocks, new_page=True)


def _readings(plan: Plan, step: _Posture) -> Iterator[Table]:
    """Where what the instruments read is written, in the order in which it is entered."""
    by_heads: dict[tuple[str, ...], list[Row]] = {}
    for number, part in zip(step.numbers, step.parts, strict=True):
        heads = part.instrument.heads()
        if heads:
            row = row_of(_measured(plan, number), *[_FIELD] * len(heads))
            by_heads.setdefault(heads, []).append(row)
    for heads, rows in by_heads.items():
        yield table_of("Readings", ["", *heads], rows)


def _lines(aimed: AimedPlan, postures: Postures, step: _Posture) -> list[tuple[Matrix, Matrix | None]]:
    """(3,) mm in the base frame of what each part measures on the flange, and where the line from there to
    what it measures ends, if there is one."""
    problem, row = aimed.problem, step.row
    parts, target = problem.split(aimed.x), postures.targets[problem.target_index[row]]
    (pose,) = problem.poses(aimed.x, postures.joints[[row]])
    lines: list[tuple[Matrix, Matrix | None]] = []
    for part in step.parts:
        instrument, unknowns = part.instrument, parts.tool[part.unknowns]
        end = None
        if instrument.beam:
            end = postures.end[row]
        elif instrument.target_is != "nothing" or instrument.in_sight(Target(target, None)) is not None:
            sight = instrument.sight(pose, target, unknowns, part.reading, part.variant)
            end = None if sight is None else sight[1]
        lines.append((instrument.on_flange(pose, unknowns, part.variant), end))
    return lines


def _coordinates(point: Matrix) -> str:
    coordinates = ", ".join(numbers.fixed(float(value), 0) for value in point)
    return f"{coordinates}\u00a0mm (x, y, z of the base)"


def _picture(aimed: AimedPlan, postures: Postures, step: _Posture) -> Picture:
    """One posture, drawn as the first one of a page is."""
    plan, row, number = aimed.plan, step.row, step.numbers[0]
    origin, end = _lines(aimed, postures, step)[0]
    posed = Posed(f"posture {number}", postures.arm[row], origin, end, bool(postures.reaches[row]))
    scene = Scene3D([posed], list(_placed(plan, postures, step)), floor_of(plan.robot))
    what = listed(list(dict.fromkeys(part.instrument.words.posture for part in step.parts)))
    view = turnable(
        scene,
        alt=f"The arm in posture {number}, with {what}.",
        caption=f"Posture {number}. {scene.grid_words}; x, y, z: the base frame.",
        paper="",
    )
    return still_picture(view, f"posture-{number}")


def _placed(plan: Plan, postures: Postures, step: _Posture) -> Iterator[Placed]:
    """The targets of a posture, a face by its stated point."""
    for name in dict.fromkeys(plan.targets[number] for number in step.numbers):
        entry = None if name is None else plan.header.targets.get(name)
        if entry is not None and entry.normal is not None:
            if entry.guess_mm is not None:
                yield Placed(str(name), np.array(entry.guess_mm, dtype=float), "nominal")
        elif name is not None:
            yield Placed(name, postures.targets[plan.target_names.index(name)], "nominal")
