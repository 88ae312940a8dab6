"""The built-in runs of `zerobeam demo`: simulated, with the truth in their provenance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parent / "demos"


@dataclass(frozen=True)
class DemoRun:
    """`name` of the report's folder, `title` of its column, `about` what a reader should see in it."""

    name: str
    title: str
    about: str

    @property
    def path(self) -> Path:
        return _FOLDER / f"{self.name}.jsonl"


def example_files() -> dict[str, Path]:
    """Header and plan of the example that the app rehearses, by their names in its folder: an irb1600 by the
    defaults of a new calibration (`experiments.plans.new_calibration`)."""
    return {name: _FOLDER / f"example-{name}" for name in ("header.yaml", "plan.yaml")}


def demo_runs() -> tuple[DemoRun, ...]:
    """The three cases: what works, what cannot work, and what still works."""
    return (
        DemoRun(
            "good",
            "good run",
            "seven varied measurements; the true offsets are the means of Table 2 of the paper.",
        ),
        DemoRun(
            "x-pattern",
            "X-Pattern",
            "the paper's section 3.2: seven measurements in a row from back to front, joint 1 at rest.",
        ),
        DemoRun(
            "uncalibrated",
            "uncalibrated tool",
            "section 3.1: twelve measurements with a laser that is roughly along x; its last joint is held.",
        ),
    )
