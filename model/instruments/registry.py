"""The kinds of instruments that there are, by name: ours, and those of other packages.

A package of kinds names each by an entry point of the group `zerobeam.instruments`: a `Station`. It is not
imported before a header names it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint

from ..errors import BadInput
from ..parsing.reading import also_called
from .flange_tool import FlangeTool, LaserBeam, ProbeTip
from .kind import Instrument, Station
from .length_gauges import Ballbar, Dial
from .pose import PoseStation
from .tips import PlaneProbe, SphereProbe
from .tracker import Tracker

GROUP = "zerobeam.instruments"
TOOLS: dict[str, type[FlangeTool]] = {kind.name: kind for kind in (LaserBeam, ProbeTip)}
STATIONS: dict[str, type[Station]] = {
    kind.name: kind for kind in (Tracker, PoseStation, PlaneProbe, SphereProbe, Ballbar, Dial)
}
KINDS: dict[str, type[Instrument]] = {**TOOLS, **STATIONS}
for _kind in (*STATIONS.values(), *TOOLS.values()):  # a word that two kinds are called by is the tool's
    also_called(_kind.name, _kind.also_called)


def kind_of(name: str) -> type[Instrument]:
    """The kind of that name; KeyError where there is none, BadInput where its package is broken."""
    return KINDS[name] if name in KINDS else _loaded(name)


def kinds_of(header: Mapping[str, object]) -> dict[str, type[Instrument]]:
    """The kind of each instrument of a header's plain values, by its label."""
    tool, others = header.get("tool"), header.get("instruments")
    entries = ({"tool": tool} if tool else {}) | (others if isinstance(others, dict) else {})
    return {label: kind_of(entry["kind"]) for label, entry in entries.items() if isinstance(entry, dict)}


def kind_names() -> list[str]:
    """All kinds by name, those of other packages last."""
    return [*KINDS, *sorted(_entry_points().keys() - KINDS)]


def names_of(*, beam: bool) -> list[str]:
    """The tools that are beams, or that are none."""
    return [name for name, kind in TOOLS.items() if kind.beam == beam]


@cache
def _entry_points() -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group=GROUP)}


@cache
def _loaded(name: str) -> type[Station]:
    """The kind of another package."""
    point = _entry_points()[name]
    package = f"package {point.dist.name} {point.dist.version}" if point.dist else point.value
    try:
        kind = point.load()
    except Exception as error:  # whatever their code raises while it is imported
        raise BadInput(
            f"the instrument {name!r} of {package} cannot be loaded",
            found=f"{type(error).__name__}: {error}",
            remedy=f"correct or remove {package}",
        ) from error
    if not (isinstance(kind, type) and issubclass(kind, Station)):
        fault = f"{point.value} is no subclass of zerobeam.model.instruments.kind.Station"
    elif kind.name != name:
        fault = f"{point.value} is called {kind.name!r}"
    elif "kind" not in kind.Stated.model_fields:
        fault = f"{point.value}: Stated has no key 'kind'"
    else:
        return kind
    raise BadInput(
        f"the instrument {name!r} of {package} is not one",
        found=fault,
        allowed=f"a Station whose name is {name!r} and whose Stated has the key 'kind'",
        remedy=f"correct or remove {package}",
    )
