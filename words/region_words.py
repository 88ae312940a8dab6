"""The region of the TCP's error, as every sentence, table and map names it."""

from __future__ import annotations

from ..analysis.tcp_region import CENTRAL, TcpRegion
from . import numbers
from .wording import capital, counted, shown

_EARLIER = "in the workspace"  # of results that do not say which


def region_words(region: TcpRegion | None) -> str:
    """Its name, with the preposition: it follows a sentence, or begins one (`region_first`)."""
    if region is None:
        return _EARLIER
    if region.name is not None:
        return region.name
    if region.positions is not None:
        return f"over the {counted(region.postures or 0, 'posture')} of {shown(region.positions)}"
    ranges = {
        "central": f"in the central {100 * CENTRAL:.0f} % of the joints\u2019 ranges",
        "full": "over the full joint ranges",
    }[region.joints or "central"]
    if region.box_mm is None:
        return ranges
    sides = (
        f"{axis} {numbers.exact(low)} to {numbers.exact(high)}"
        for axis, low, high in zip("xyz", *region.box_mm, strict=True)
    )
    return f"in the box {', '.join(sides)} mm, {ranges}"


def region_short(region: TcpRegion | None) -> str:
    """The same in the head of a column."""
    if region is None:
        return "workspace"
    if region.positions is not None:
        return "own positions"
    if region.box_mm is not None:
        return "stated box"
    return f"central {100 * CENTRAL:.0f} %" if region.joints != "full" else "full ranges"


def region_first(region: TcpRegion | None) -> str:
    """The same at the beginning of a sentence."""
    return capital(region_words(region))
