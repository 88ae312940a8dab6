"""All figures of a report."""

from __future__ import annotations

from typing import Any

from ...analysis.posterior.posterior import Draws
from ..style.canvas import Picture
from .figure_misses import misses_picture
from .figure_offsets import offsets_picture
from .figure_posterior import posterior_picture
from .figure_tool_accuracy import tool_accuracy_picture


def pictures(result: dict[str, Any], draws: Draws | None) -> dict[str, Picture]:
    """The figures of a `result.json` by name; one that may not be drawn is left out."""
    drawn = (
        offsets_picture(result),
        tool_accuracy_picture(result),
        posterior_picture(result, draws),
        misses_picture(result),
    )
    return {picture.name: picture for picture in drawn if picture is not None}
