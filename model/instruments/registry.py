"""The kinds of instruments that there are, by name."""

from __future__ import annotations

from ..parsing.reading import also_called
from .ballbar import Ballbar
from .dial import Dial
from .flange_tool import FlangeTool
from .kind import Instrument, Station
from .laser import LaserBeam
from .plane import PlaneProbe
from .pose import PoseStation
from .probe import ProbeTip
from .sphere import SphereProbe
from .tracker import Tracker

TOOLS: dict[str, type[FlangeTool]] = {kind.name: kind for kind in (LaserBeam, ProbeTip)}
STATIONS: dict[str, type[Station]] = {
    kind.name: kind for kind in (Tracker, PoseStation, PlaneProbe, SphereProbe, Ballbar, Dial)
}
KINDS: dict[str, type[Instrument]] = {**TOOLS, **STATIONS}
for _kind in (*STATIONS.values(), *TOOLS.values()):  # a word that two kinds are called by is the tool's
    also_called(_kind.name, _kind.also_called)


def kind_of(name: str) -> type[Instrument]:
    """The kind of that name; KeyError where there is none."""
    return KINDS[name]


def names_of(*, beam: bool) -> list[str]:
    """The tools that are beams, or that are none."""
    return [name for name, kind in TOOLS.items() if kind.beam == beam]
