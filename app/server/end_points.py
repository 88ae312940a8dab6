"""All end points that calculate. Jobs, files and the page itself are in `routes`."""

from __future__ import annotations

from .answers import history, imports, plans, posteriors, recordings, refits, results, robots
from .end_point import EndPoint

END_POINTS: list[EndPoint] = [
    *imports.END_POINTS,
    *robots.END_POINTS,
    *plans.END_POINTS,
    *recordings.END_POINTS,
    *results.END_POINTS,
    *refits.END_POINTS,
    *posteriors.END_POINTS,
    *history.END_POINTS,
]
