"""A grid of settings as people read it: axes, values, cases, and which figures show them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable
from typing import Literal

from scipy.special import chdtri

from ....analysis.status import Verdict
from ....experiments.studies.sweeps.grid_answer import CaseParameter, GridAxis, GridCase, GridStudy, RunErrors
from ....experiments.studies.sweeps.study_file import overlap
from ....words import numbers
from ....words.wording import clipped

NO_PLAN = "no plan"
# Mark (a role of the palette) and words of a case's verdict.
STANDING: dict[Verdict | None, tuple[str, str]] = {
    "pass": ("identified", "pass"),
    "weak": ("weak", "weak"),
    "degenerate": ("unidentifiable", "degenerate"),
    None: ("held", NO_PLAN),
}
_MOST_MAPPED = 3  # axes of numbers
_LONGEST_VALUE, _LONGEST_UNIT = 24, 12
_MOST_DOTS, _MOST_PAGES = 46, 4  # rows of a figure of dots, and how many of those there are

GridPoint = tuple[tuple[GridAxis, int], ...]  # some of the axes, each with the index of its value


def form_of(study: GridStudy) -> Literal["dots", "lines", "map", "axes"]:
    """The form of the figure: no axis of numbers, dots; one, lines; two or three, a map; more, a panel for
    each axis."""
    count = sum(axis.numeric is not None for axis in study.axes)
    return "dots" if count == 0 else "lines" if count == 1 else "map" if count <= _MOST_MAPPED else "axes"


def figure_names(study: GridStudy) -> list[str]:
    """Names of the figures in their order; a map, and panels of axes, have a second one for the observed
    errors."""
    form = form_of(study)
    if form == "dots":
        return [f"dots_{number}" for number, _ in enumerate(dot_pages(study), start=1)]
    return [form, "ratio"] if form in ("map", "axes") and study.has("likelihood") else [form]


def dot_pages(study: GridStudy) -> list[list[GridCase]]:
    """The cases of each figure of dots: as many as fit, one value of the first axis kept together."""
    pages: list[list[GridCase]] = []
    for _, group in itertools.groupby(study.cases, key=lambda case: case.at[:1]):
        cases = list(group)
        together = len(study.axes) > 1 and _rows_of(cases) <= _MOST_DOTS
        for part in [cases] if together else [[one] for one in cases]:
            if not pages or _rows_of(pages[-1]) + _rows_of(part) > _MOST_DOTS:
                pages.append([])
            pages[-1] += part
    return pages[:_MOST_PAGES]


def _rows_of(cases: list[GridCase]) -> int:
    return sum(1 + len(case.parameters) for case in cases)


def by_point(study: GridStudy, along: Collection[int]) -> list[tuple[GridPoint, list[GridCase]]]:
    """The cases by their place on all axes but those numbered `along`."""
    groups: dict[tuple[int, ...], list[GridCase]] = {}
    for case in study.cases:
        groups.setdefault(tuple(at for i, at in enumerate(case.at) if i not in along), []).append(case)
    others = [axis for i, axis in enumerate(study.axes) if i not in along]
    return [(tuple(zip(others, at, strict=True)), cases) for at, cases in sorted(groups.items())]


def shown_unit(thing: GridAxis | CaseParameter) -> str:
    """The unit, fit to be shown behind a number."""
    return clipped(thing.unit, _LONGEST_UNIT)


def unit_signs(things: Iterable[GridAxis | CaseParameter]) -> str:
    """The units as next to a scale: `°, mm`."""
    return ", ".join(dict.fromkeys("°" if one.unit == "deg" else shown_unit(one) for one in things))


def value_text(axis: GridAxis, index: int) -> str:
    """A value of an axis with its unit, a word as it is."""
    value = axis.values[index]
    return (
        clipped(value, _LONGEST_VALUE) if isinstance(value, str) else numbers.exact(value, shown_unit(axis))
    )


def axis_title(axis: GridAxis) -> str:
    """Label and unit of an axis, as next to its scale."""
    unit = unit_signs([axis])
    return f"{clipped(axis.label)}, {unit}" if unit else clipped(axis.label)


def point_name(point: GridPoint) -> str:
    """`measurements 7, Y-Pattern`: words have no label, numbers with their label."""
    return ", ".join(
        value_text(axis, i)
        if axis.numeric is None
        else f"{clipped(axis.label, _LONGEST_VALUE)} {value_text(axis, i)}"
        for axis, i in point
    )


def case_name(study: GridStudy, case: GridCase) -> str:
    """The place of a case on all axes."""
    return point_name(tuple(zip(study.axes, case.at, strict=True)))


def standing(case: GridCase) -> tuple[str, str]:
    """Mark and words of a case."""
    return STANDING[case.verdict]


def is_varied(study: GridStudy, setting: str) -> bool:
    """Whether an axis changes a setting (dotted name), a part of it, or what it is a part of."""
    return any(overlap(key, setting) for axis in study.axes for put in axis.changes for key in put)


def tolerance(study: GridStudy, one: CaseParameter) -> float | None:
    """The largest u that counts as identified, in the parameter's unit; None where the cases differ in it."""
    if is_varied(study, "tolerance") or one.unit not in ("deg", "mm"):
        return None
    limits = study.settings.tolerance
    angle = limits.tilt_deg if one.group == "tool" else limits.offset_deg
    return angle if one.unit == "deg" else limits.length_mm


def rmse_interval(errors: RunErrors) -> tuple[float, float]:
    """The 95 % interval of an RMSE of normal errors: chi-squared has as many dof as there are runs."""
    low, high = (math.sqrt(errors.runs / float(chdtri(errors.runs, tail))) for tail in (0.025, 0.975))
    return errors.rmse * low, errors.rmse * high
