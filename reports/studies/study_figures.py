"""All figures of each study, by name; one that has nothing to show is left out."""

from __future__ import annotations

from typing import Any

from ...experiments.studies.sweeps.grid_answer import GridStudy
from ..style.canvas import Picture
from .figure_accuracy import accuracy_picture
from .figure_cell import cell_coverage_picture, time_picture
from .figure_coverage import coverage_picture
from .figure_ranks import ranks_picture
from .figure_scatter import scatter_picture
from .sweeps.dots import dots_pictures
from .sweeps.grid_words import form_of
from .sweeps.heat_map import map_picture
from .sweeps.lines import lines_picture
from .sweeps.ratio import ratio_picture


def coverage_pictures(answer: dict[str, Any]) -> dict[str, Picture]:
    """Two for each plan, and one for all."""
    settings = answer["settings"]
    drawn: list[Picture | None] = []
    for number, plan in enumerate(answer["plans"], start=1):
        # Numbered, since a plan's name may be anything.
        drawn.append(coverage_picture(plan, settings, f"coverage_{number}"))
        drawn.append(ranks_picture(plan, settings, f"ranks_{number}"))
    drawn.append(accuracy_picture(answer["plans"]))
    return _named(drawn)


def cell_pictures(answer: dict[str, Any]) -> dict[str, Picture]:
    return _named([cell_coverage_picture(answer), time_picture(answer)])


def table2_pictures(answer: dict[str, Any]) -> dict[str, Picture]:
    return _named([scatter_picture(answer["plans"])])


def sweep_pictures(study: GridStudy) -> dict[str, Picture]:
    """Their form follows from the axes."""
    form = form_of(study)
    if form == "dots":
        return _named([*dots_pictures(study)])
    return _named([lines_picture(study)] if form == "lines" else [map_picture(study), ratio_picture(study)])


def _named(drawn: list[Picture | None]) -> dict[str, Picture]:
    return {picture.name: picture for picture in drawn if picture is not None}
