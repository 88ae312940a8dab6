"""All end points that calculate. Jobs, files and the page itself are in `routes`."""

from __future__ import annotations

from .answers import plans, robots
from .end_point import EndPoint

END_POINTS: list[EndPoint] = [*robots.END_POINTS, *plans.END_POINTS]
