"""The figures of a sweep: their form follows from the axes."""

from __future__ import annotations

from typing import Any

from ..style.canvas import Picture
from .figure_sweep_dots import dots_pictures
from .figure_sweep_lines import lines_picture
from .figure_sweep_map import map_picture
from .figure_sweep_ratio import ratio_picture
from .sweep_cases import form_of


def sweep_figures(answer: dict[str, Any]) -> list[Picture | None]:
    """None for one that has nothing to show."""
    form = form_of(answer)
    if form == "dots":
        return [*dots_pictures(answer)]
    return [lines_picture(answer)] if form == "lines" else [map_picture(answer), ratio_picture(answer)]
