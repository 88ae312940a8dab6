"""All figures of a study."""

from __future__ import annotations

from typing import Any

from .canvas import Picture
from .figure_accuracy import accuracy_picture
from .figure_coverage import coverage_picture
from .figure_ranks import ranks_picture


def study_pictures(answer: dict[str, Any]) -> dict[str, Picture]:
    """The figures of a study by name, two for each plan; one that has nothing to show is left out."""
    settings = answer["settings"]
    drawn: list[Picture | None] = []
    for number, plan in enumerate(answer["plans"], start=1):
        # Numbered, since a plan's name may be anything.
        drawn.append(coverage_picture(plan, settings, f"coverage_{number}"))
        drawn.append(ranks_picture(plan, settings, f"ranks_{number}"))
    drawn.append(accuracy_picture(answer["plans"]))
    return {picture.name: picture for picture in drawn if picture is not None}
