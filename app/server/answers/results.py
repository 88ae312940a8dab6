"""Results: what a `result.json` says, checked, with what lies beside it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Annotated

from ....analysis.answer.result import RESULT_SCHEMA, Result, parse_result
from ....model.errors import BadInput
from ....model.parsing.reading import parse_json, read_text
from ....model.records import inline, record
from ....reports.output.html import fragment
from ....reports.run.front import front
from ....reports.run.inputs import origin_of
from ....reports.run.report import REPORT
from ....reports.run.unobservable import null_motion_picture_of
from ....words.message import read_message
from ..folder import Folder
from ..kept import Kept
from ..requests import end_point
from .actions import OfferedAction, action_of_result
from .displacements import InWorkspace, in_workspace

LARGEST_RESULT = 16 * 10**6  # bytes
MOST_MEASUREMENTS = 1000  # listed: those of the largest residuals
MOST_HASHED = 16 * 10**6  # bytes of a run file that is looked for by its SHA-256
_MOST_KEPT = 2000
_MOST_FIGURES = 200
_RESULTS, _SUMS = Kept(4), Kept(_MOST_KEPT)


def read_result(path: Path) -> Result:
    """A result file; BadInput where it is none, not whole, too large, or contradicts itself."""
    return _RESULTS.of(path, _read)


def first_page(content: Result) -> str | None:
    """Tables, bars and the null-space motion of the report's first page as HTML; None where the result does
    not state its words."""
    if content.next_steps is None or any(row.trusted is None for row in content.offsets):
        return None
    # A file states what is offered, in place of what was computed.
    content = replace(content, entered=content.enter, entered_geometry=content.enter_geometry)
    motion = null_motion_picture_of(content)
    return fragment(front(content, read_message(content)), {} if motion is None else {motion.name: motion})


def _read(path: Path) -> Result:
    text, _ = read_text(path, LARGEST_RESULT)
    try:
        parse_json(text, file=path, line=1)  # refuses duplicate keys and NaN
        return parse_result(text)
    except (json.JSONDecodeError, RecursionError) as error:
        message = f"the file is no JSON, or cut off: {error}"
    except ValueError as error:
        message = str(error)
    raise BadInput(
        "this is not a whole result of zerobeam",
        found=message[:300],
        allowed=f"a result.json of schema {RESULT_SCHEMA}",
        remedy="make it again with zerobeam report",
        file=path,
    )


@record
class ReportFile:
    """A file of a report."""

    path: str
    bytes: int


@record(kw_only=True)
class ShownResult:
    """What a result says, its files, and the `run` of the folder that it was made of. `front`: the tables and
    bars of the report's first page as HTML, with the null-space motion of a degenerate run; None in results
    of versions that did not state their message."""

    file: str
    run: str | None
    report: str | None
    posterior_file: str | None
    files: tuple[ReportFile, ...]
    action: OfferedAction | None
    front: str | None
    origin: dict[str, str]
    workspace: Annotated[InWorkspace, inline("tcp", "tcp_map", "tcp_why", "residuals", "skeletons")]
    result: Annotated[
        Result,
        inline(
            *("verdict", "message", "coverage_factor", "headline", "notes", "next_steps", "posterior"),
            *("misfit", "diagnosis", "parameters", "shots", "inputs"),
        ),
    ]


@end_point(
    "GET /api/result",
    "A result for people, the files of its report, and the displacement of the TCP by the offsets"
    " (`tcp_map`, mm; null where it is not known, with `tcp_why`).",
)
def result(folder: Folder, file: str) -> ShownResult:
    """What a result says, with the measurements of the largest residuals."""
    path = folder.file(file)
    content = read_result(path)
    beside = report_files(path)
    run = run_of(folder, content.inputs.sha256, path)
    message = content.message
    ranked = sorted(content.shots, key=lambda shot: -shot.whitened)[:MOST_MEASUREMENTS]
    numbers = {shot.shot for shot in ranked}
    return ShownResult(
        file=folder.called(path),
        run=None if run is None else folder.called(run),
        report=_called(folder, path.with_name("report.html"), beside),
        posterior_file=_called(folder, path.with_name("posterior.nc"), beside),
        files=tuple(ReportFile(folder.called(file), file.stat().st_size) for file in beside),
        action=None if message is None else action_of_result(folder, message.action, run),
        front=first_page(content),
        origin=origin_of(content.inputs.header),
        workspace=in_workspace(content, run),
        result=replace(content, shots=tuple(shot for shot in content.shots if shot.shot in numbers)),
    )


def report_files(result_file: Path) -> list[Path]:
    """The files of the report that a result belongs to: by the names that a report has, and no others."""
    files = []
    for name in sorted(REPORT.names):
        path = result_file.with_name(name)
        if path.is_symlink():
            continue
        inner = sorted(islice(path.iterdir(), _MOST_FIGURES)) if path.is_dir() else [path]
        files += [file for file in inner if file.is_file() and not file.is_symlink()]
    return files if result_file.name in REPORT.names else [result_file]


def _called(folder: Folder, path: Path, beside: list[Path]) -> str | None:
    return folder.called(path) if path in beside else None


def run_of(folder: Folder, sha256: str, near: Path) -> Path | None:
    """The run file of the folder that has this SHA-256, the nearest first; None where there is none."""
    for path in sorted(_runs(folder), key=lambda run: -len(_shared(run, near))):
        if sha256_of(path) == sha256:
            return path
    return None


def sha256_of(path: Path) -> str | None:
    """Of a run file; None where it is too large to be looked for, or has gone."""
    try:
        return _SUMS.of(path, _sum) if path.stat().st_size <= MOST_HASHED else None
    except OSError:
        return None


def _sum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _runs(folder: Folder) -> Iterator[Path]:
    return (folder.root / file.path for file in folder.files() if file.kind == "run")


def _shared(path: Path, near: Path) -> tuple[str, ...]:
    pairs = zip(path.parts, near.parts, strict=False)
    return tuple(one for i, (one, other) in enumerate(pairs) if path.parts[: i + 1] == near.parts[: i + 1])
