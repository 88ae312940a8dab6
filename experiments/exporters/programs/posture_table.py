"""A plan as a table (CSV): one row for each posture to go to, as the pendant shows it, in order."""

from __future__ import annotations

import numpy as np

from ....model.files.plan import Plan
from ....model.kinematics.pendant import pendant_of
from ....words import spreadsheet
from ..ascii_line import one_line
from .steps import Motion, rounded


def csv_table(plan: Plan, motion: Motion, name: str) -> str:
    """Columns `posture`, `target`, then the joints by name in the pendant's order; `posture` is empty for an
    intermediate one."""
    motion.refuse("csv", "speed", "zone", "register", "listener", "tool")
    robot, pendant = plan.robot, pendant_of(plan.robot, motion.j3)
    names = [f"{one_line(robot.joints[i].name)}_{pendant.units[i]}" for i in pendant.order]
    rows: list[dict[str, object]] = []
    for i, posture in enumerate(plan.postures):
        way = rounded(pendant.shown(np.array([*plan.via_of(i), posture]) * robot.display))
        texts = [("", "")] * (len(way) - 1) + [(str(i), one_line(plan.targets[i]))]
        for (number, target), row in zip(texts, way, strict=True):
            rows.append({"posture": number, "target": target, **dict(zip(names, row, strict=True))})
    return spreadsheet.csv_text(rows)
