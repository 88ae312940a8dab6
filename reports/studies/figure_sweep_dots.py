"""Figure of a sweep over words: every offset of every case, what was predicted and what was observed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from ..words import numbers
from ..words.wording import in_font, label
from .figure_sweep_marks import FITS, draw_fit, gap, gap_colour, hatch, legend, log_ticks, plain, scale_of
from .sweep_cases import NO_PLAN, case_name, dot_pages, observed, predicted, standing, tolerance, unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Json = dict[str, Any]

_ROW = 0.165  # inches


def dots_pictures(answer: Json) -> list[Picture]:
    """Rows are the parameters of each case, headed by its name and verdict; as many figures as it takes."""
    pages = dot_pages(answer)
    drawn, total = sum(map(len, pages)), len(answer["cases"])
    cut = f"; {drawn} of {total} cases shown, all in offsets.csv" if drawn < total else ""
    return [
        _picture(answer, cases, f"dots_{number}", cut if number == len(pages) else "")
        for number, cases in enumerate(pages, start=1)
    ]


def _picture(answer: Json, cases: list[Json], name: str, cut: str) -> Picture:
    rows = [(case, row) for case in cases for row in (None, *case["parameters"])]
    units = list(dict.fromkeys(unit_of(row) for _, row in rows if row is not None)) or ["deg"]
    low = min(scale_of(answer, unit)[0] for unit in units)
    high = max(scale_of(answer, unit)[1] for unit in units)
    gaps: set[str] = set()
    with style():
        from matplotlib.lines import Line2D

        figure = new_figure(0.95 + _ROW * len(rows))
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        axes.set_xticks(log_ticks(low, high))
        axes.minorticks_off()
        axes.xaxis.set_major_formatter(plain)
        bare_y(axes)
        axes.grid(visible=False)
        for y, (case, row) in enumerate(rows):
            if row is None:
                _heading(axes, y, answer, case)
            else:
                gaps |= _row(axes, y, answer, case, row)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        named = [(y, row) for y, (_, row) in enumerate(rows) if row is not None]
        axes.set_yticks([y for y, _ in named], [in_font(label(row["name"], 12)) for _, row in named])
        axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=8.5)
        axes.set_xlabel(
            in_font(f"standard deviation, {', '.join({'deg': '°'}.get(unit, unit) for unit in units)}")
        )
        mark = Line2D(
            [],
            [],
            marker="|",
            markersize=8,
            markeredgewidth=2.2,
            linewidth=0,
            color=light("identified"),
            label="predicted std",
        )
        legend(figure, answer, mark, gaps, 3)
        svg = to_svg(figure, name)
    title = f"Predicted std of each offset, and what simulated runs show{cut}"
    return Picture(name, title, _alt(answer, cases), svg)


def _heading(axes: Axes, y: int, answer: Json, case: Json) -> None:
    mark, words = standing(case)
    axes.text(
        0.0,
        y + 0.1,
        in_font(f"{case_name(answer, case)}: {words}"),
        transform=axes.get_yaxis_transform(),
        va="center_baseline",
        fontsize=9,
        fontweight="bold",
        color=light("ink") if mark == "identified" else light(mark),
    )


def _row(axes: Axes, y: int, answer: Json, case: Json, row: Json) -> set[str]:
    """Draw one row; the words of its gap, if it is one."""
    low, high = axes.get_xlim()
    axes.vlines(log_ticks(low, high), y - 0.5, y + 0.5, color=light("line"), linewidth=0.5, zorder=0.5)
    if (at := tolerance(answer, row)) is not None:
        axes.vlines(
            at, y - 0.5, y + 0.5, linestyle=(0, (4, 2)), linewidth=1.0, color=light("weak"), zorder=0.6
        )
    if said := gap(case, row):
        axes.axhspan(
            y - 0.4,
            y + 0.4,
            facecolor=light("ground"),
            edgecolor=light("line"),
            hatch=hatch(said),
            linewidth=0,
            zorder=1,
        )
        axes.text(
            0.5,
            y,
            said,
            transform=axes.get_yaxis_transform(),
            ha="center",
            va="center_baseline",
            fontsize=8,
            color=gap_colour(said),
            bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.6},
        )
        return {said}
    if std := predicted(row):
        axes.plot([std], [y], "|", markersize=8, markeredgewidth=2.2, color=light("identified"), zorder=2)
    for fit in FITS:
        draw_fit(axes, y, row, fit, upright=False)
    return set()


def _alt(answer: Json, cases: list[Json]) -> str:
    parts = []
    for case in cases:
        offsets = []
        for row in case["parameters"]:
            said = [gap(case, row)] if gap(case, row) else []
            if std := predicted(row):
                said.append(f"predicted {numbers.spread(std, unit_of(row))}")
            said += [
                f"rmse of the {fit} fit {numbers.spread(entry['rmse'], unit_of(row))}"
                for fit in FITS
                if (entry := observed(row, fit))
            ]
            offsets.append(f"{label(row['name'])} {', '.join(said)}")
        told = NO_PLAN if case["reason"] is not None else f"{standing(case)[1]}, {'; '.join(offsets)}"
        parts.append(f"{case_name(answer, case)}: {told}")
    return f"Standard deviations of the offsets. {'. '.join(parts)}."
