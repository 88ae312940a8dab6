"""The section on accuracy: how far the tool point is off, without the offsets and with them."""

from __future__ import annotations

from typing import Any

from ..style.blocks import FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..words import numbers
from ..words.wording import label, listed, sentence
from .figure_tool_accuracy import NAME
from .view_fit import times_the_noise

Json = dict[str, Any]

TITLE = "Accuracy of the tool point"
_HEAD = ("before_mm", "after95_mm")


def accuracy_section(result: Json) -> Section | None:
    """None where the result has no such part; where no accuracy is claimed, the reason alone."""
    accuracy = result["accuracy"]
    if accuracy is None:
        return None
    workspace, near = accuracy["workspace"], accuracy["near_shots"]
    if workspace is None or near is None:
        said = sentence(accuracy["reason"]).rstrip(".")
        return section_of(TITLE, Paragraph(f"No accuracy is claimed: {said}. {_where(accuracy)}"))
    return section_of(
        TITLE,
        Paragraph(_summary(workspace)),
        *map(Paragraph, _doubts(result)),
        FigureBlock(NAME),
        _table(workspace, near),
        Paragraph(f"{_where(accuracy)} {_postures(workspace, near)}"),
    )


def _summary(region: Json) -> str:
    before, after = ([region[key][level] for level in ("median", "worst")] for key in _HEAD)
    median, worst = (numbers.significant(value, 2, "mm") for value in before)
    return (
        f"Without the offsets the tool point is off by {median} in the median posture and by {worst} in the"
        f" worst. With them 95 % of the error is within {_spread(after[0])} in the median posture and"
        f" {_spread(after[1])} in the worst."
    )


def _doubts(result: Json) -> list[str]:
    """Why the truth may be worse than the numbers."""
    said, fit, weak = [], result["fits"]["likelihood"], result["accuracy"]["weak"]
    if weak:
        names = listed([label(name) for name in weak])
        one = len(weak) == 1
        said.append(
            f"{names} {'is' if one else 'are'} only weakly determined and {'enters' if one else 'enter'} with"
            f" {'its' if one else 'their'} large standard deviation."
        )
    if times := times_the_noise(fit):
        said.append(
            f"The model does not fit: the misses of the shots, {numbers.significant(fit['rms_mm'], 2, 'mm')}"
            f" rms, are some {times} times as large as the stated noise explains. What makes them so moves"
            " the tool point as well and is in none of these numbers: with the offsets the error is larger"
            " than told here. Targets held out (--hold-out) show where."
        )
    return said


def _where(accuracy: Json) -> str:
    at = numbers.with_unit(", ".join(numbers.exact(round(v, 6)) for v in accuracy["point_mm"]), "mm")
    return (
        f"The tool point is {sentence(accuracy['place'])} ({at} in the flange frame), in the base frame that"
        " the encoder of joint 1 draws: δ1, a choice of frame, has no part in it."
    )


def _postures(workspace: Json, near: Json) -> str:
    return (
        f"Workspace: {workspace['postures']} postures evenly over the joints’ limits, obstacles left aside."
        f" Near the shots: {near['postures']} over the ranges that the joints of the shots span; beyond them"
        " the numbers rest on the geometry as drawn. What of the arm is not as drawn, its repeatability and"
        " its load are not in them."
    )


def _table(workspace: Json, near: Json) -> Table:
    columns = [
        ("tool point", "left"),
        ("workspace, median", "right"),
        ("worst", "right"),
        ("near the shots, median", "right"),
        ("worst", "right"),
    ]
    levels = [(region, level) for region in (workspace, near) for level in ("median", "worst")]
    rows = [
        row_of(
            "error without the offsets",
            *(
                _rounded(region["before_mm"][level], region["before_std_mm"][level])
                for region, level in levels
            ),
        )
    ]
    for words, key in (
        ("its standard deviation", "before_std_mm"),
        ("with them, 95 % within", "after95_mm"),
        ("with them, expected error (rms)", "after_rms_mm"),
    ):
        rows.append(row_of(words, *(_spread(region[key][level]) for region, level in levels)))
    return table_of("Accuracy before and after", columns, rows)


def _rounded(value: float, std: float) -> str:
    return numbers.estimate(value, std, "mm") if std > 0 else numbers.significant(value, 2, "mm")


def _spread(value: float) -> str:
    return numbers.spread(value, "mm") if value > 0 else numbers.exact(0, "mm")
