"""KUKA: the axis positions of a data list (.dat)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ....model.errors import BadInput, located
from ....model.parsing.reading import line_numbers, shown
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..maker import blanked

# KUKA: DECL E6AXIS XP1={A1 -90.0,A2 …,E6 0.0}, or P[1]={E6AXIS: A1 …} of an array: an aggregate of KRL that
# begins with an axis is an axis position, one that begins with X is Cartesian.
REMARK = r";[^\n]*"
AGGREGATE = re.compile(
    r"(?P<name>\w+(?:\[\d+\])?)\s*=\s*\{\s*(?:\w+\s*:)?(?P<fields>\s*(?:A\d|X)\s[^{}]*)(?P<closed>\}?)",
    re.IGNORECASE,
)
DATA_LIST = re.compile(r"^[ \t]*DEFDAT\b", re.MULTILINE | re.IGNORECASE)
_END_OF_LIST = re.compile(r"^[ \t]*ENDDAT\b", re.MULTILINE | re.IGNORECASE)
# What the program of a plan records: the axes at posture n, and whether they are.
_MEASURED_NAME = re.compile(r"\bZB_M(\d{1,9})\b", re.IGNORECASE)
_DONE = re.compile(r"\bZB_D(\d{1,9})\s*=\s*TRUE\b", re.IGNORECASE)
AXIS = re.compile(r"^A(\d)\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)$", re.IGNORECASE)


def import_kuka(
    job: ImportJob,
    *,
    points: Sequence[str] | None = None,
) -> Imported:
    """Measurements at the axis positions of KUKA .dat files; `points` are the names of those to use (XP1, …).

    Of the data list of a plan's program (zerobeam export plan krl) those that it has recorded. External axes
    (E1, …) are ignored. The signs of the axes are KUKA's: the robot file must have them too.
    """
    return import_points(
        job,
        _positions if points is None else kuka_positions,
        names=points,
        note="KUKA axis positions, angles in degrees, A1 first, external axes ignored",
    )


def kuka_positions(text: str, path: Path) -> list[TaughtPoint]:
    """All positions of a data list, in its order; comments (;) are skipped."""
    bare = blanked(text, REMARK)
    if DATA_LIST.search(bare) and not _END_OF_LIST.search(bare):
        raise BadInput("the data list is incomplete: its last line, ENDDAT, is missing", file=path)
    points, line_of = [], line_numbers(bare)
    for match in AGGREGATE.finditer(bare):
        line = line_of(match.start("name"))
        cartesian = match["fields"].strip()[0] in "Xx"
        with located(path, line):
            points.append(TaughtPoint(match["name"], None if cartesian else _axes(match), line))
    return points


def _positions(text: str, path: Path) -> list[TaughtPoint]:
    """All positions; of a data list of a plan's program those that it has recorded, by their postures."""
    points = kuka_positions(text, path)
    if not _MEASURED_NAME.search(text):
        return points
    done = {match[1] for match in _DONE.finditer(blanked(text, REMARK))}
    named = [(point, _MEASURED_NAME.fullmatch(point.name)) for point in points]
    return [
        point._replace(number=int(match[1]))
        for point, match in named
        if match is not None and match[1] in done
    ]


def _axes(match: re.Match[str]) -> tuple[float, ...]:
    fields = [field.strip() for field in match["fields"].split(",")]
    axes = [field for field in fields if field[:1].upper() == "A"]
    values = [AXIS.match(axis) for axis in axes]
    numbers = [int(value[1]) for value in values if value is not None]
    if not match["closed"] or not axes or numbers != list(range(1, len(axes) + 1)):
        raise BadInput(
            f"the axes of {match['name']} cannot be read",
            found=shown(match["fields"].strip()[:80]),
            allowed="{A1 …, A2 …, …}, each once, in this order",
        )
    return tuple(float(value[2]) for value in values if value is not None)
