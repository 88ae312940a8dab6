"""A plan as a table (CSV): one row for each posture to go to, in order."""

from __future__ import annotations

from ....model.files.plan import Plan
from ....reports.words import spreadsheet
from ..ascii_line import one_line
from .steps import Motion, steps_of


def csv_table(plan: Plan, motion: Motion, name: str) -> str:
    """Columns `posture`, `target`, then the joints by name; `posture` is empty for an intermediate one."""
    motion.refuse("csv", "speed", "zone", "j3", "register", "listener", "tool")
    names = [f"{one_line(joint.name)}_{joint.unit}" for joint in plan.robot.joints]
    rows = []
    for step in steps_of(plan):
        passing = [("", "", row) for row in step.via]
        for number, target, row in [*passing, (str(step.number), one_line(step.target), step.joints)]:
            values = dict(zip(names, row, strict=True))
            rows.append({"posture": number, "target": target, **values})
    return spreadsheet.csv_text(rows)
