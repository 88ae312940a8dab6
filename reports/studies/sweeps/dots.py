"""Figure of a study over words: every parameter of every case, its prediction and its observed errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ....experiments.studies.sweeps.grid_answer import CaseParameter, GridCase, GridStudy
from ....words import numbers
from ....words.wording import label
from ...style.canvas import Picture, bare_y, log_ticks, new_figure, set_log_scale, style, to_svg
from ...style.palette import light
from ...style.typeface import in_font
from ..coverage_figures import head_rows, name_rows
from .grid_words import NO_PLAN, case_name, dot_pages, shown_unit, standing, unit_signs
from .marks import FITS, UNCERTAINTY, draw_fits, draw_tolerance, gap, hatch, legend, log_scale, write_gap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW = 0.165  # inches
_MARK: Mapping[str, Any] = {"marker": "|", "markersize": 8, "markeredgewidth": 2.2, "linewidth": 0}


def dots_pictures(study: GridStudy) -> list[Picture]:
    """Rows are the parameters of each case, headed by its name and verdict; as many figures as it takes."""
    pages = dot_pages(study)
    drawn, total = sum(map(len, pages)), len(study.cases)
    cut = f"; {drawn} of {total} cases shown, all in offsets.csv" if drawn < total else ""
    return [
        _picture(study, cases, f"dots_{number}", cut if number == len(pages) else "")
        for number, cases in enumerate(pages, start=1)
    ]


def _picture(study: GridStudy, cases: list[GridCase], name: str, cut: str) -> Picture:
    rows = [(case, one) for case in cases for one in (None, *case.parameters)]
    parameters = [one for _, one in rows if one is not None]
    low, high = log_scale(study, {one.unit for one in parameters} or {"deg"})
    gaps: set[str] = set()
    with style():
        figure = new_figure(0.95 + _ROW * len(rows))
        axes = figure.subplots()
        set_log_scale(axes, "x", low, high)
        bare_y(axes)
        axes.grid(visible=False)
        for y, (case, one) in enumerate(rows):
            if one is None:
                mark, words = standing(case)
                colour = light("ink" if mark == "identified" else mark)
                head_rows(axes, y + 0.1, f"{case_name(study, case)}: {words}", 9, color=colour)
            else:
                gaps |= _row(axes, y, study, case, one)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        name_rows(axes, [(y, label(one.name, 12)) for y, (_, one) in enumerate(rows) if one is not None], 8.5)
        axes.set_xlabel(in_font(f"{UNCERTAINTY} u, {unit_signs(parameters) or '°'}"))
        legend(figure, study, gaps, **_MARK)
        svg = to_svg(figure, name)
    title = f"Predicted {UNCERTAINTY} u of each parameter and errors of simulated runs{cut}"
    return Picture(name, title, _alt(study, cases), svg)


def _row(axes: Axes, y: int, study: GridStudy, case: GridCase, one: CaseParameter) -> set[str]:
    """Draw one row; the words of its gap, if it is one."""
    low, high = y - 0.5, y + 0.5
    axes.vlines(log_ticks(*axes.get_xlim()), low, high, color=light("line"), linewidth=0.5, zorder=0.5)
    draw_tolerance(study, one, axes.vlines, ymin=low, ymax=high, zorder=0.6)
    if words := gap(case, one):
        hatch(axes.axhspan, y - 0.4, y + 0.4, words=words, zorder=1, facecolor=light("ground"))
        across = axes.get_yaxis_transform()
        write_gap(axes, 0.5, y, words, transform=across, va="center_baseline", fontsize=8)
        return {words}
    if one.std is not None:
        axes.plot([one.std], [y], color=light("identified"), zorder=2, **_MARK)
    draw_fits(axes, y, one, upright=False)
    return set()


def _alt(study: GridStudy, cases: list[GridCase]) -> str:
    parts = []
    for case in cases:
        rows = [f"{label(one.name)} {_in_words(case, one)}" for one in case.parameters]
        text = NO_PLAN if case.reason is not None else f"{standing(case)[1]}, {'; '.join(rows)}"
        parts.append(f"{case_name(study, case)}: {text}")
    return f"Standard uncertainties of the parameters. {'. '.join(parts)}."


def _in_words(case: GridCase, one: CaseParameter) -> str:
    unit = shown_unit(one)
    if one.std is None:
        return gap(case, one)
    observed = [
        f"RMSE of the {fit} fit {numbers.spread(errors.rmse, unit)}"
        for fit in FITS
        if (errors := one.errors(fit))
    ]
    return ", ".join([f"predicted {numbers.spread(one.std, unit)}", *observed])
