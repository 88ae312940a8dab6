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
    """The four cases, of one typical arm whose offsets are the means of Table 2 of the paper: what works,
    what cannot work, what hardly does, and what still works. Each is by a plan of zerobeam and the simulated
    cell (seed 1)."""
    return (
        DemoRun("good", "seven postures", "varied, the first two again at the end"),
        DemoRun("x-pattern", "X-Pattern", "section 3.2 of the paper: joint 1 at rest"),
        DemoRun("y-pattern", "Y-Pattern", "section 3.2 of the paper: joint 1 turns"),
        DemoRun("uncalibrated", "uncalibrated", "section 3.1: twelve postures, a laser roughly along x"),
    )
