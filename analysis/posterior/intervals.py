"""The 95 % interval of a parameter by three methods: curvature, profile likelihood, posterior."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from ...model.records import internal, it, record
from ..solution import Solution
from ..status import Status, require_no_more_than
from .posterior import PosteriorSummary
from .profiles import profile_ends

_DIFFERS = 0.1  # of the width of an interval: by so much its ends may differ and still be the same


@record
class Intervals:
    """The 95 % intervals of one parameter by three methods, where they differ or the parameter is weak."""

    name: Annotated[str, it("of an offset, tool or noise parameter")]
    unit: Annotated[str, it("of its ends")]
    status: Annotated[Status, internal]
    linear: Annotated[
        tuple[float, float], it("the `interval95` of the parameter, by the curvature at the mode")
    ]
    profile: Annotated[
        tuple[float, float] | None, it("by the profile likelihood; null where an end was not found")
    ]
    posterior: Annotated[
        tuple[float, float] | None, it("between the quantiles of the draws; null without a posterior")
    ]
    differ: Annotated[bool, it("whether an end is off by a tenth of the width or more")]

    def __post_init__(self) -> None:
        require_no_more_than(self.name, self.status, interval95=self.linear)


def intervals(solution: Solution, posterior: PosteriorSummary) -> tuple[Intervals, ...]:
    """Of offsets, tool and noise: where the three methods differ, or the parameter is weak."""
    if not solution.converged:
        return ()
    problem, rows = solution.problem, solution.parameters
    which = np.array([i for i in solution.known if rows[i].group != "target"], dtype=int)
    ends = profile_ends(solution, which)
    draws = {row.name: (row.q2_5, row.q97_5) for row in posterior.parameters or ()}
    result = []
    for i, (low, high) in zip(which, ends, strict=True):
        row, item = rows[i], problem.parameters.items[i]
        assert row.interval95 is not None
        profile = (item.shown(low), item.shown(high)) if np.isfinite([low, high]).all() else None
        others = [interval for interval in (profile, draws.get(row.name)) if interval is not None]
        margin = _DIFFERS * (row.interval95[1] - row.interval95[0])
        off = np.abs(np.array(others).reshape(-1, 2) - row.interval95).max(initial=0.0)
        differ = (profile is None and not problem.noise.separate) or bool(off > margin)
        status = solution.identified.status[i]
        wide = status == "assumed" and bool(solution.std[i] > item.tolerance)
        if differ or status == "weak" or wide:
            result.append(
                Intervals(
                    row.name, row.unit, row.status, row.interval95, profile, draws.get(row.name), differ
                )
            )
    return tuple(result)
