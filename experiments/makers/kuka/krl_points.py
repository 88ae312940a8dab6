"""KUKA: the axis positions of a data list (.dat)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...positions.position import SourceFile
from ...positions.position_languages import KRL
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..taught_positions import written_points

# What the program of a plan records: the axes at posture n, and whether they are.
_MEASURED_NAME = re.compile(r"\bZB_M(\d{1,9})\b", re.IGNORECASE)
_DONE = re.compile(r"\bZB_D(\d{1,9})\s*=\s*TRUE\b", re.IGNORECASE)


def import_kuka(job: ImportJob, *, points: Sequence[str] | None = None) -> Imported:
    """Measurements at the axis positions of KUKA .dat files; `points` are the names of those to use (XP1, …).

    Of the data list of a plan's program (zerobeam export plan krl) those that it has recorded. External axes
    (E1, …) are ignored. The signs of the axes are KUKA's: the robot file must have them too.
    """
    return import_points(
        job,
        _measured if points is None else kuka_positions,
        names=points,
        note="KUKA axis positions, angles in degrees, A1 first, external axes ignored",
    )


def kuka_positions(text: str, path: Path) -> list[TaughtPoint]:
    """All positions of a data list, in its order."""
    points = written_points(KRL, text, path)
    return [point for point in points if not point.name.startswith("line ")]


def _measured(text: str, path: Path) -> list[TaughtPoint]:
    """All positions; of a data list of a plan's program those that it has recorded, by their postures."""
    points = kuka_positions(text, path)
    if not _MEASURED_NAME.search(text):
        return points
    done = {match[1] for match in _DONE.finditer(SourceFile(path.name, text, KRL.remark).bare)}
    named = [(point, _MEASURED_NAME.fullmatch(point.name)) for point in points]
    return [
        point._replace(number=int(match[1]))
        for point, match in named
        if match is not None and match[1] in done
    ]
