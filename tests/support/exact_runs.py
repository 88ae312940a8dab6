"""Runs of an exact arm: links as the model has them, offsets the means of Table 2 of the paper. Their
residuals are those of the stated noise, so that known answers and golden numbers are of them.
"""

from pathlib import Path
from typing import NamedTuple

_FOLDER = Path(__file__).parent / "runs_of_exact_arms"


class ExactRun(NamedTuple):
    """A run by its `name`."""

    name: str

    @property
    def path(self) -> Path:
        return _FOLDER / f"{self.name}.jsonl"


def demo_runs() -> tuple[ExactRun, ...]:
    """Seven varied measurements, an X-Pattern, twelve with an uncalibrated tool."""
    return ExactRun("good"), ExactRun("x-pattern"), ExactRun("uncalibrated")
