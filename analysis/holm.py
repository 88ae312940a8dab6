"""P-values of several tests of one kind."""

from __future__ import annotations

from collections.abc import Sequence


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted for being the least of so many (Holm, Scand. J. Statist. 6, 1979)."""
    raised, adjusted = 0.0, [0.0] * len(p_values)
    for k, i in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        raised = max(raised, min(1.0, (len(p_values) - k) * p_values[i]))
        adjusted[i] = raised
    return adjusted
