"""The kinds of instruments that there are, by name."""

from __future__ import annotations

from ..parsing.reading import also_called
from .flange_tool import FlangeTool
from .kind import Instrument
from .laser import LaserBeam
from .probe import ProbeTip

TOOLS: dict[str, type[FlangeTool]] = {kind.name: kind for kind in (LaserBeam, ProbeTip)}
KINDS: dict[str, type[Instrument]] = {**TOOLS}
for _kind in KINDS.values():
    also_called(_kind.name, _kind.also_called)


def kind_of(name: str) -> type[Instrument]:
    """The kind of that name; KeyError where there is none."""
    return KINDS[name]


def names_of(*, beam: bool) -> list[str]:
    """The tools that are beams, or that are none."""
    return [name for name, kind in TOOLS.items() if kind.beam == beam]
