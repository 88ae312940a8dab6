"""The runs of the folder by the serial number of their robot, with what their results say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, ClassVar

from ....analysis.answer.answer_message import Grade
from ....analysis.answer.result import Result
from ....analysis.row import StatusRow
from ....analysis.status import Verdict
from ....model.errors import BadInput
from ....model.files.header import RUN_SCHEMA
from ....model.records import if_any, it, record
from ....reports.run.inputs import origin_of
from ....words.message import read_message, result_words
from ....words.wording import clipped
from ..folder import Folder
from ..kept import Kept
from ..requests import end_point
from .results import read_result, sha256_of

MOST_RUNS = 300  # the newest
MOST_RESULTS = 300
_LARGEST_RESULT = 4 * 10**6  # bytes: larger ones are opened, not listed with their numbers
_LONGEST_HEADER = 10**6  # bytes
_WIDTH = 80  # letters of a text that a header states
_HEADERS, _BRIEFS = Kept(2000), Kept(2000)


@record(kw_only=True)
class BriefOffset(StatusRow):
    """An offset of a result, which is not held."""

    absent: ClassVar[tuple[str, ...]] = ("held",)

    estimate: float | None
    std: float | None


@record(kw_only=True)
class BriefResult:
    """A result of the folder."""

    file: str
    verdict: Annotated[Verdict | None, if_any] = None
    grade: Annotated[Grade | None, it("how it is coloured"), if_any] = None
    words: Annotated[str | None, it("verdict and worth in words"), if_any] = None
    offsets: Annotated[list[BriefOffset] | None, if_any] = None
    error: Annotated[str | None, it("why it cannot be read"), if_any] = None


@record(kw_only=True)
class BriefRun:
    """A run of the folder: what its header states, and its results, the newest first."""

    file: str
    robot: Annotated[str | None, if_any] = None
    serial: Annotated[str | None, if_any] = None
    when: Annotated[str | None, if_any] = None
    who: Annotated[str | None, if_any] = None
    instrument: Annotated[str | None, if_any] = None
    origin: Annotated[str | None, if_any] = None
    error: Annotated[str | None, it("why it cannot be read"), if_any] = None
    results: list[BriefResult]


@record(kw_only=True)
class FolderHistory:
    """The runs of the folder, and the results of no run here; `left_out` counts what is not listed."""

    runs: list[BriefRun]
    results: list[BriefResult]
    left_out: int


@end_point("GET /api/history", "The folder's runs by serial number, and their results.")
def history(folder: Folder) -> FolderHistory:
    """The runs and results of the folder, the newest first."""
    files = folder.files()
    runs = [file.path for file in files if file.kind == "run"]
    results = [file.path for file in files if file.kind == "result"]
    by_sum: dict[str | None, list[BriefResult]] = {}
    for name in results[:MOST_RESULTS]:
        sha256, brief = _brief(folder, name)
        by_sum.setdefault(sha256, []).append(brief)
    rows, sums = [], set()
    for name in runs[:MOST_RUNS]:
        path = folder.root / name
        sums.add(own_sum := sha256_of(path) or "")
        rows.append(BriefRun(file=name, **_header(path), results=by_sum.get(own_sum, [])))
    loose = [brief for sha256, briefs in by_sum.items() if sha256 not in sums for brief in briefs]
    left_out = max(0, len(runs) - MOST_RUNS) + max(0, len(results) - MOST_RESULTS)
    return FolderHistory(runs=rows, results=loose, left_out=left_out)


def _header(path: Path) -> dict[str, str]:
    try:
        return _HEADERS.of(path, _read_header)
    except (OSError, ValueError, RecursionError):
        return {"error": "the header of this run cannot be read"}


def _read_header(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        header = json.loads(file.readline(_LONGEST_HEADER))
    if not isinstance(header, dict) or header.get("schema") != RUN_SCHEMA:
        raise ValueError("no header of a run")
    robot = header.get("robot")
    name = robot.get("urdf") if isinstance(robot, dict) else robot
    origin = {key: clipped(text, _WIDTH) for key, text in origin_of(header).items()}
    return {"robot": clipped(str(name), _WIDTH), **origin}


def _brief(folder: Folder, name: str) -> tuple[str | None, BriefResult]:
    """A result, and the SHA-256 of its run."""
    try:
        result = _BRIEFS.of(folder.root / name, _listed)
    except BadInput as error:
        return None, BriefResult(file=name, error=folder.without(error.what))
    except OSError:
        return None, BriefResult(file=name, error="the file cannot be read")
    offsets = [
        BriefOffset(name=row.name, unit=row.unit, status=row.status, estimate=row.estimate, std=row.std)
        for row in result.parameters
        if row.group == "offset" and not row.held
    ]
    brief = BriefResult(
        file=name,
        verdict=result.verdict,
        grade=read_message(result).grade,
        words=result_words(result),
        offsets=offsets,
    )
    return result.inputs.sha256, brief


def _listed(path: Path) -> Result:
    if path.stat().st_size > _LARGEST_RESULT:
        raise BadInput("too large to be listed: open it")
    return read_result(path)
