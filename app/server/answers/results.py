"""Results: what a `result.json` says, checked, with what lies beside it."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Annotated

from ....analysis.answer.result import Result
from ....model.records import inline, record
from ....reports.output.html import fragment
from ....reports.run.front import front
from ....reports.run.inputs import origin_of
from ....reports.run.report import REPORT
from ....reports.run.unobservable import null_motion_picture_of
from ....words.message import read_message
from ..folder import Folder
from ..index import Index, read_result
from ..requests import end_point
from .actions import OfferedAction, action_of_result
from .displacements import InWorkspace, in_workspace

MOST_MEASUREMENTS = 1000  # listed: those of the largest residuals
_MOST_FIGURES = 200


def first_page(content: Result) -> str | None:
    """Tables, bars and the null-space motion of the report's first page as HTML; None where the result does
    not state its words."""
    if content.next_steps is None or any(row.trusted is None for row in content.offsets):
        return None
    # A file states what is offered, in place of what was computed.
    content = replace(content, entered=content.enter, entered_geometry=content.enter_geometry)
    motion = null_motion_picture_of(content)
    return fragment(front(content, read_message(content)), {} if motion is None else {motion.name: motion})


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
    made_of = Index(folder).of_sum("run", content.inputs.sha256, near=path)
    run = None if made_of is None else made_of.at
    message = content.message
    ranked = sorted(content.shots, key=lambda shot: -shot.whitened)[:MOST_MEASUREMENTS]
    numbers = {shot.shot for shot in ranked}
    return ShownResult(
        file=folder.called(path),
        run=None if made_of is None else made_of.path,
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
