"""The section on accuracy: how far the TCP is off, without the offsets and with them."""

from __future__ import annotations

from ...analysis.answer.result import Result
from ...analysis.diagnostics.accuracy import Accuracy, Region
from ...words import numbers
from ...words.findings import accuracy_reason, place
from ...words.wording import label, listed, person, sentence
from ..style.blocks import FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from .workspace_figure import NAME

TITLE = "Accuracy of the TCP"


def workspace_section(result: Result) -> Section:
    """Where no accuracy is claimed, the reason alone."""
    accuracy = result.accuracy
    workspace, near = accuracy.workspace, accuracy.near_shots
    if workspace is None or near is None:
        said = sentence(accuracy_reason(accuracy, person) or "")
        return section_of(TITLE, Paragraph(f"No accuracy is claimed: {said}. {_where(accuracy)}"))
    if result.misfit is not None:
        said = "the model does not describe the measurements, and what it misses moves the TCP as well"
        return section_of(TITLE, Paragraph(f"No accuracy is claimed: {said}. {_where(accuracy)}"))
    return section_of(
        TITLE,
        Paragraph(_summary(workspace)),
        *map(Paragraph, _doubts(result)),
        FigureBlock(NAME),
        _table(workspace, near),
        Paragraph(f"{_where(accuracy)} {_postures(workspace, near)}"),
    )


def _summary(region: Region) -> str:
    before, after = region.before_mm, region.after95_mm
    median, worst = (numbers.significant(value, 2, "mm") for value in (before.median, before.worst))
    return (
        f"Without the offsets the TCP is off by {median} in the median posture and by {worst} in the"
        f" worst. With them 95 % of the error is within {_spread(after.median)} in the median posture and"
        f" {_spread(after.worst)} in the worst."
    )


def _doubts(result: Result) -> list[str]:
    """Why the truth may be worse than the numbers."""
    said, weak = [], result.accuracy.weak
    if weak:
        names = listed([label(name) for name in weak])
        one = len(weak) == 1
        said.append(
            f"{names} {'is' if one else 'are'} only weakly determined and {'enters' if one else 'enter'} with"
            f" {'its' if one else 'their'} large standard uncertainty."
        )
    return said


def _where(accuracy: Accuracy) -> str:
    at = numbers.with_unit(", ".join(numbers.exact(round(v, 6)) for v in accuracy.point_mm), "mm")
    return (
        f"The TCP is {sentence(place(accuracy, person))} ({at} in the flange frame), in the base frame that"
        " the encoder of joint 1 defines: δ1 is a choice of frame and does not enter."
    )


def _postures(workspace: Region, near: Region) -> str:
    return (
        f"Workspace: {workspace.postures} postures evenly over the joints’ limits, without regard to"
        f" obstacles. Near the measurements: {near.postures} over the ranges of their joints; beyond them"
        " the numbers rest on the nominal geometry. Deviations from it, the arm’s repeatability and"
        " its load are not in them."
    )


def _table(workspace: Region, near: Region) -> Table:
    columns = [
        ("TCP", "left"),
        ("workspace, median", "right"),
        ("worst", "right"),
        ("near the measurements, median", "right"),
        ("worst", "right"),
    ]
    regions = (workspace, near)
    stds = [
        level for region in regions for level in (region.before_std_mm.median, region.before_std_mm.worst)
    ]
    errors = [level for region in regions for level in (region.before_mm.median, region.before_mm.worst)]
    after = [level for region in regions for level in (region.after95_mm.median, region.after95_mm.worst)]
    rms = [level for region in regions for level in (region.after_rms_mm.median, region.after_rms_mm.worst)]
    rows = [
        row_of("error without the offsets", *map(_rounded, errors, stds)),
        row_of("its standard uncertainty", *map(_spread, stds)),
        row_of("with them, 95 % within", *map(_spread, after)),
        row_of("with them, expected error (rms)", *map(_spread, rms)),
    ]
    return table_of("Accuracy before and after", columns, rows)


def _rounded(value: float, std: float) -> str:
    return numbers.estimate(value, std, "mm") if std > 0 else numbers.significant(value, 2, "mm")


def _spread(value: float) -> str:
    return numbers.spread(value, "mm") if value > 0 else numbers.exact(0, "mm")
