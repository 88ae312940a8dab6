"""The runs of the folder by the serial number of their robot, with what their results say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ....model.errors import BadInput
from ....model.files.header import RUN_SCHEMA
from ....words.wording import clipped
from ..folder import Folder
from ..requests import EndPoint
from .results import Kept, ResultFile, read_result, sha256_of

MOST_RUNS = 300  # the newest
MOST_RESULTS = 300
_LARGEST_RESULT = 4 * 10**6  # bytes: larger ones are opened, not listed with their numbers
_LONGEST_HEADER = 10**6  # bytes
_WIDTH = 80  # letters of a text that a header states
_HEADERS, _BRIEFS = Kept(2000), Kept(2000)


def history(folder: Folder) -> dict[str, Any]:
    """`runs`: `file`, `robot`, `serial`, `when`, `who`, `instrument`, `origin`, and its `results`, newest
    first: `file`, `verdict`, `offsets`. `results` are those of no run here. What cannot be read has `error`.
    """
    files = folder.files()
    runs = [row["path"] for row in files if row["kind"] == "run"]
    results = [row["path"] for row in files if row["kind"] == "result"]
    by_sum: dict[str | None, list[dict[str, Any]]] = {}
    for name in results[:MOST_RESULTS]:
        brief = _brief(folder, name)
        by_sum.setdefault(brief.pop("sha256", None), []).append(brief)
    rows, sums = [], set()
    for name in runs[:MOST_RUNS]:
        path = folder.root / name
        sums.add(sha256 := sha256_of(path) or "")
        rows.append({"file": name, **_header(folder, path), "results": by_sum.get(sha256, [])})
    loose = [brief for sha256, briefs in by_sum.items() if sha256 not in sums for brief in briefs]
    left_out = max(0, len(runs) - MOST_RUNS) + max(0, len(results) - MOST_RESULTS)
    return {"runs": rows, "results": loose, "left_out": left_out}


def _header(folder: Folder, path: Path) -> dict[str, Any]:
    try:
        return dict(_HEADERS.of(path, _read_header))
    except (OSError, ValueError, RecursionError):
        return {"error": "the header of this run cannot be read"}


def _read_header(path: Path) -> dict[str, Any]:
    from ....reports.run.inputs import origin_of

    with path.open("rb") as file:
        header = json.loads(file.readline(_LONGEST_HEADER))
    if not isinstance(header, dict) or header.get("schema") != RUN_SCHEMA:
        raise ValueError("no header of a run")
    robot = header.get("robot")
    called = robot.get("urdf") if isinstance(robot, dict) else robot
    origin = {key: clipped(text, _WIDTH) for key, text in origin_of(header).items()}
    return {"robot": clipped(str(called), _WIDTH), **origin}


def _brief(folder: Folder, name: str) -> dict[str, Any]:
    try:
        return {"file": name, **_BRIEFS.of(folder.root / name, _in_brief)}
    except BadInput as error:
        return {"file": name, "error": folder.without(error.what)}
    except OSError:
        return {"file": name, "error": "the file cannot be read"}


def _in_brief(path: Path) -> dict[str, Any]:
    if path.stat().st_size > _LARGEST_RESULT:
        raise BadInput("too large to be listed: open it")
    result: ResultFile = read_result(path)
    offsets = [
        {"name": row.name, "unit": row.unit, "status": row.status, "estimate": row.estimate, "std": row.std}
        for row in result.parameters
        if row.group == "offset" and not row.held
    ]
    return {"sha256": result.inputs.sha256, "verdict": result.verdict, "offsets": offsets}


END_POINTS = [
    EndPoint("/api/history", "GET", "The folder's runs by serial number, and their results.", history),
]
