"""FANUC: the positions of a TP program that was saved as text (.ls), or position registers (posreg.va)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....model.errors import BadInput
from ....model.kinematics.robot import J3
from ...positions.position_languages import FANUC
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..joint_text import PLAN_LINE, required_plan
from ..taught_positions import written_points

REGISTERS = "$POSREG"
NOT_MEASURED = 999.0  # deg, joint 1: what the program of a plan writes before it has measured


def import_fanuc(
    job: ImportJob, *, j3: J3 | None = None, points: Sequence[str] | None = None, register: int = 1
) -> Imported:
    """Measurements at the P[n] of FANUC .ls files (group 1), or at the PR[n] of a posreg.va; `points` are
    the numbers of some, as text.

    Where the plan is stated its postures are in the registers from `register` on, where its program left
    them. `j3` says what joint 3 is counted from, where it is not as the robot file states. Both files give
    degrees to three decimals.
    """
    planned = None if job.plan is None else len(job.plan.postures)

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        if points is None and REGISTERS not in text and PLAN_LINE.search(text):
            required_plan(job, path)
        return fanuc_positions(text, path, register, planned, points is None)

    return import_points(
        job,
        parse,
        names=points,
        j3=j3,
        vendor="fanuc",
        note="FANUC positions of group 1, angles in degrees, joint 1 first",
    )


def fanuc_positions(
    text: str, path: Path, first: int = 1, planned: int | None = None, all_of_them: bool = True
) -> list[TaughtPoint]:
    """All P[n] of a listing, in its order, or the position registers of group 1 in joint representation.

    Registers that a plan's program has not measured are left out; with `planned` (the number of postures) so
    are those before `first` and behind the last posture, and each has its posture's number. Without it and
    with `all_of_them` registers without joints are left out too.
    """
    points = [point._replace(name=point.name.strip("PR[]")) for point in written_points(FANUC, text, path)]
    if not points and REGISTERS not in text and "/POS" not in text:
        raise BadInput(
            "the file is not a TP program with positions",
            found="no line /POS",
            allowed="a text listing (.ls)",
            remedy="save the program as ASCII, not as .tp",
        )
    if REGISTERS not in text:
        return points
    if planned is not None:
        last = first + planned
        points = [point._replace(number=int(point.name) - first) for point in points]
        points = [point for point in points if first <= int(point.name) < last]
    points = [point for point in points if point.joints is None or point.joints[0] != NOT_MEASURED]
    return [point for point in points if point.joints or point.unread or not all_of_them]
