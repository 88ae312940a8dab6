"""True values of a simulated run, from its provenance: what a rehearsal is held against."""

from __future__ import annotations

import re
from collections.abc import Mapping

SIMULATED = "simulated"  # of the provenance key `origin`
_TRUE = re.compile(r"true (\S+) \((?:deg|mm|1)\)")


def true_values(provenance: Mapping[str, object]) -> dict[str, float]:
    """The true values by parameter (deg, mm) that the provenance of a simulated run states; else none."""
    if provenance.get("origin") != SIMULATED:
        return {}
    found = ((_TRUE.fullmatch(key), value) for key, value in provenance.items())
    return {
        match.group(1): float(value)
        for match, value in found
        if match is not None and isinstance(value, int | float) and not isinstance(value, bool)
    }
