"""Results: what a `result.json` says, checked, with what lies beside it and how far its offsets displace the
TCP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np

from ....analysis.answer.result import Result
from ....analysis.status import NOT_DESCRIBED
from ....model.arrays import Mask, Matrix
from ....model.errors import BadInput
from ....model.files.run import Run, read_run
from ....model.kinematics.orientation import Three
from ....model.records import inline, it, record
from ....reports.output.html import fragment
from ....reports.run.front import front
from ....reports.run.inputs import origin_of
from ....reports.run.report import REPORT
from ....reports.run.unobservable import null_motion_picture_of
from ....words.case import RunCase
from ....words.catalogue import nominal_arm
from ....words.controllers import TCP_OF_NOMINAL_ARM
from ....words.message import read_message
from ....words.numbers import number_in
from ....words.wording import capital, label, listed
from ..index import Folder, Index, read_result
from ..requests import end_point
from ..versions import kept
from .actions import OfferedAction, action_of_result

# A result in the workspace: how far its offsets displace the TCP, and residuals where they were measured.
#
# The displacement is that of the nominal arm by the estimated offsets, at the postures that were measured.
# Where an offset that the measurements do not determine moves the TCP there is none. What the values to
# enter leave is known only where the geometry is exact: else they make up for links as well, and how well
# is an expectation.

_MOVES_MM = 1e-3  # by so much where it is one degree (mm) off: an offset that moves the TCP by less does not
_recorded = kept(4)(read_run)


@record(kw_only=True)
class TcpErrors:
    """Median lengths of the displacements at the postures, mm."""

    before: float
    after: float | None


@record(kw_only=True)
class TcpVector:
    """The displacement of the TCP at a posture, mm."""

    at: Annotated[Three, it("where a controller with nothing entered has the TCP, base frame")]
    before: Annotated[Three | None, it("from there to where it is by the offsets; null: not known")]
    after: Annotated[Three | None, it("what is left of that with the values entered; null: not known")]


@record(kw_only=True)
class ResidualShown:
    """A residual where it was measured."""

    shot: int
    at: Three
    size_mm: float
    whitened: float


@record(kw_only=True)
class InWorkspace:
    """The postures of a result: all lists in one order, 60 at most."""

    tcp: TcpErrors | None
    tcp_map: list[TcpVector] | None
    tcp_why: str | None
    residuals: list[ResidualShown] | None
    skeletons: list[list[Three]] | None


def in_workspace(result: Result, run: Path | None) -> InWorkspace:
    """What a picture of a result shows, as far as it is known; `run` is the file that it was made of."""
    if result.scene is None:
        return InWorkspace(tcp=None, tcp_map=None, tcp_why=None, residuals=None, skeletons=None)
    by_number = {shot.shot: shot for shot in result.shots}
    drawn = [each for each in result.scene.shots if each.shot in by_number]
    residuals = [
        ResidualShown(
            shot=each.shot,
            at=each.beam_to or each.links[-1],
            size_mm=by_number[each.shot].length_mm,
            whitened=by_number[each.shot].whitened,
        )
        for each in drawn
    ]
    vectors, why = _vectors(result, run, [each.shot for each in drawn])
    return InWorkspace(
        tcp=None if vectors is None else _errors(vectors),
        tcp_map=vectors,
        tcp_why=why,
        residuals=residuals,
        skeletons=[list(each.links[:-1]) for each in drawn],
    )


def _vectors(
    result: Result, run: Path | None, numbers: list[int]
) -> tuple[list[TcpVector] | None, str | None]:
    """The displacement at the measurements of these numbers, and why it is not whole."""
    if run is None:
        return (
            None,
            "The run of this result is not in the folder: its postures are not known.",
        )
    if not result.accuracy or not result.accuracy.point_mm:  # of an earlier version
        return None, "This result does not state a TCP."
    if result.verdict == "misfit":
        return None, f"{capital(NOT_DESCRIBED)}: no displacement of the TCP is known."
    if nominal_arm(RunCase.of_result(result)):
        return None, TCP_OF_NOMINAL_ARM
    try:
        recorded = _recorded(run)
    except BadInput:
        return None, "The run of this result cannot be read: the displacement of the TCP is not computed."
    joints_of = {shot.shot: shot.joints_deg for shot in recorded.shots}
    joints = np.array([joints_of[number] for number in numbers if number in joints_of])
    if len(joints) != len(numbers) or not numbers:
        return None, "The run does not have the measurements of this result."
    return _displaced(result, recorded, joints, np.array(result.accuracy.point_mm))


@dataclass(frozen=True, eq=False)
class _Offsets:
    """(n,) offsets deg (mm), 0 where `undetermined`; what is left with the values entered, or why not."""

    names: tuple[str, ...]
    values: Matrix
    undetermined: Mask
    left: Matrix | None
    why: str | None


def _displaced(
    result: Result, run: Run, joints: Matrix, point: Matrix
) -> tuple[list[TcpVector] | None, str | None]:
    offsets = _offsets(result)
    at = _tcp(run, joints, point)
    before = _tcp(run, joints + offsets.values, point)
    moved = np.zeros((len(joints), len(offsets.names)), dtype=bool)
    for i in np.flatnonzero(offsets.undetermined):
        beside = joints + offsets.values + np.eye(len(offsets.names))[i]
        moved[:, i] = np.linalg.norm(_tcp(run, beside, point) - before, axis=1) > _MOVES_MM
    unknown: Mask = np.asarray(moved.any(axis=1))
    left = None if offsets.left is None else before - _tcp(run, joints + offsets.values - offsets.left, point)
    vectors = [
        TcpVector(
            at=_vec(at[i]),
            before=None if unknown[i] else _vec(before[i] - at[i]),
            after=None if unknown[i] or left is None else _vec(left[i]),
        )
        for i in range(len(joints))
    ]
    if not unknown.any():
        return vectors, offsets.why
    names = listed([label(offsets.names[i]) for i in np.flatnonzero(moved.any(axis=0))])
    where = "" if unknown.all() else f" at {int(unknown.sum())} of {len(unknown)} postures"
    return vectors, f"{names} not determined, and moving the TCP: its displacement is not known{where}."


def _offsets(result: Result) -> _Offsets:
    rows = result.offsets
    determined = np.array([row.status in ("identified", "weak") for row in rows])
    values = np.array(
        [row.estimate if row.status in ("identified", "weak") and row.estimate else 0.0 for row in rows]
    )
    undetermined = ~determined
    undetermined[0] &= rows[0].status != "held"  # else it is a choice of the base frame
    left, why = _left(result, {row.name: value for row, value in zip(rows, values.tolist(), strict=True)})
    return _Offsets(tuple(row.name for row in rows), values, undetermined, left, why)


def _left(result: Result, values: Mapping[str, float]) -> tuple[Matrix | None, str | None]:
    """(n,) deg (mm) by which the offsets are off what is entered, as far as that is known."""
    entered = result.next_steps.enter if result.next_steps is not None else ()
    if not entered:
        return None, "No values may be entered of this result: nothing is said of what they would leave."
    if result.inputs.header.get("geometry") != "exact":
        return None, (
            "By the offsets alone. The values to enter make up for links as well: what they leave is an"
            " expectation over the workspace, and no displacement at a posture."
        )
    as_entered = {row.name: number_in(row.value) for row in entered}
    return np.array([value - as_entered.get(name, 0.0) for name, value in values.items()]), None


def _tcp(run: Run, joints: Matrix, point: Matrix) -> Matrix:
    """(P, 3) mm in the base frame, of the nominal arm at `joints` (P, n) deg (mm)."""
    poses = run.robot.fk(joints, "deg")
    return np.asarray(poses[:, :3, :3] @ point + poses[:, :3, 3])


def _errors(vectors: list[TcpVector]) -> TcpErrors | None:
    before = [float(np.linalg.norm(one.before)) for one in vectors if one.before is not None]
    after = [float(np.linalg.norm(one.after)) for one in vectors if one.after is not None]
    if not before:
        return None
    return TcpErrors(before=float(np.median(before)), after=float(np.median(after)) if after else None)


def _vec(values: Matrix) -> Three:
    x, y, z = values.tolist()
    return x, y, z


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
