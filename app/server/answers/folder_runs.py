"""The runs of the folder: by the serial number of their robot, with what their results say; and those that
have not reached their end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from ....analysis.answer.answer_message import Grade
from ....analysis.answer.result import Result
from ....analysis.row import StatusRow
from ....analysis.solution import Solution, so_far
from ....analysis.status import Verdict
from ....model.errors import BadInput
from ....model.files.run import Run, recorded
from ....model.likelihood.problem import Problem
from ....model.records import if_any, it, record
from ....reports.run.inputs import origin_of
from ....words.message import headline_so_far, read_message, result_words
from ....words.provenance import rig_words
from ....words.wording import clipped, person
from ..index import Facts, Folder, Head, Index, Unread
from ..job_commands import StartedRuns
from ..requests import end_point, noted
from ..versions import version_of_sum

MOST_RUNS = 300  # the newest
MOST_RESULTS = 300
_WIDTH = 80  # letters of a text that a header states


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
    index = Index(folder)
    runs, results = index.of_kinds("run"), index.of_kinds("result")
    by_version: dict[str | None, list[BriefResult]] = {}
    for file in results[:MOST_RESULTS]:
        facts = index.facts(file)
        of = version_of_sum(facts.inputs.sha256) if isinstance(facts, Result) else None
        by_version.setdefault(of, []).append(_brief(file.path, facts))
    rows = [
        BriefRun(file=file.path, **_of_header(index.facts(file)), results=by_version.get(file.version, []))
        for file in runs[:MOST_RUNS]
    ]
    versions = {file.version for file in runs[:MOST_RUNS]}
    loose = [brief for of, briefs in by_version.items() if of not in versions for brief in briefs]
    left_out = max(0, len(runs) - MOST_RUNS) + max(0, len(results) - MOST_RESULTS)
    return FolderHistory(runs=rows, results=loose, left_out=left_out)


def _of_header(facts: Facts) -> dict[str, str]:
    """What the header of a run states, or why it cannot be read."""
    if not isinstance(facts, Head):
        return {"error": facts.why if isinstance(facts, Unread) else "the file is no run any more"}
    robot = facts.header.get("robot")
    name = robot.get("urdf") if isinstance(robot, dict) else robot
    try:
        origin = origin_of(facts.header)
    except (BadInput, KeyError, TypeError):
        return {"error": "the instruments of this run cannot be read"}
    return {key: clipped(text, _WIDTH) for key, text in {"robot": str(name), **origin}.items()}


def _brief(name: str, facts: Facts) -> BriefResult:
    if not isinstance(facts, Result):
        why = facts.why if isinstance(facts, Unread) else "the file is no result any more"
        return BriefResult(file=name, error=why)
    return BriefResult(
        file=name,
        verdict=facts.verdict,
        grade=read_message(facts).grade,
        words=result_words(facts),
        offsets=[
            BriefOffset(name=row.name, unit=row.unit, status=row.status, estimate=row.estimate, std=row.std)
            for row in facts.offsets
            if not row.held
        ],
    )


_MOST = 20  # of its measurements after each of which u is said
_MOST_RUNS = 5  # that are offered to be resumed
_LARGEST = 2 * 10**6  # bytes of a run file that is read while somebody waits
PLAN_HASH = "plan sha256"  # in the provenance of a run that was carried out
_ABB = "abb"


@record(kw_only=True)
class RecordedRun:
    """A run file, and how to go on with it."""

    file: str
    origin: Annotated[str | bool | int | float | None, it("of its provenance")] = None
    plan: Annotated[str | None, it("the plan that it was begun with, if it is here")] = None
    postures: Annotated[int | None, it("of that plan")] = None
    recorded: Annotated[Sequence[int], it("numbers of its measurements")] = ()
    ended: Annotated[bool | None, it("null: not known")] = None
    torn: Annotated[bool, it("its last line is cut off")] = False
    resume: Annotated[list[str] | None, it("the command that goes on with it, without an address")]
    controller: Annotated[
        str | None, it("abb, or the protocol, of a controller whose address is to be stated again")
    ] = None
    why_not: Annotated[str | None, it("why there is none")]


@record(kw_only=True)
class CoursePoint:
    """What the measurements so far determined after one of them."""

    recorded: Annotated[int, it("how many measurements there were")]
    std: Annotated[dict[str, float | None], it("of each offset, deg or mm; null: not determined")]
    expanded: Annotated[dict[str, float | None], it("the same as U = k std")]


@record(kw_only=True)
class RunSoFar(RecordedRun):
    """A run file, with what its measurements determine."""

    std: Annotated[dict[str, float | None], it("of each offset, deg or mm; null: not determined")]
    expanded: Annotated[dict[str, float | None], it("the same as U = k std")]
    tolerance: Annotated[dict[str, float], it("up to which std an offset counts as identified")]
    course: Annotated[list[CoursePoint], it("after each of the last measurements")]
    residuals: Annotated[
        dict[int, float], it("normalised residuals at the fit to all, by the number of the measurement")
    ]
    worst_std: float | None
    consistent: Annotated[bool, it("nothing contradicts the model: else no tolerance counts as reached")]
    headline: str | None
    notes: list[str]


@end_point("GET /api/run", "What a run file has so far, and how to go on with it.")
def recording(folder: Folder, file: str) -> RunSoFar:
    """What a run file has, what that determines, and how to go on with it."""
    with noted() as notes:
        run, facts = _read(Index(folder), StartedRuns(folder), file)
        states = _states(run)
        state = states[-1][1] if states else None
    return RunSoFar(
        **vars(facts),
        std={} if state is None else state.offset_std,
        expanded={} if state is None else state.offset_expanded,
        tolerance={} if state is None else state.offset_tolerance,
        course=[
            CoursePoint(recorded=count, std=so_far.offset_std, expanded=so_far.offset_expanded)
            for count, so_far in states
        ],
        residuals={} if state is None else state.normalised_residuals,
        worst_std=None if state is None else state.worst,
        consistent=state is None or state.consistent,
        headline=None if state is None else headline_so_far(state, person),
        notes=notes,
    )


@end_point("GET /api/unfinished", "Runs begun here that have not reached their end.")
def unfinished(folder: Folder) -> list[RecordedRun]:
    """The runs that the app began and that have not reached their end, the newest first, `_MOST_RUNS` at the
    most; of one that cannot be read `why_not` alone."""
    rows, index, started = [], Index(folder), StartedRuns(folder)
    with noted():
        for name in started.unfinished()[:_MOST_RUNS]:
            try:
                rows.append(_read(index, started, name)[1])
            except BadInput as error:
                rows.append(RecordedRun(file=name, resume=None, why_not=folder.without(str(error))))
    return rows


def _read(index: Index, started: StartedRuns, name: str) -> tuple[Run, RecordedRun]:
    """A run, and what is said of it without a fit."""
    path = index.folder.file(name)
    if path.stat().st_size > _LARGEST:
        remedy = "use zerobeam analyse"
        raise BadInput("the run is too long to be looked at here", remedy=remedy, file=Path(name))
    shown = index.folder.called(path)
    run, torn = recorded(path.read_bytes(), path)
    plan_file = index.of_sum("plan", run.header.provenance.get(PLAN_HASH))
    plan = None if plan_file is None else plan_file.path
    own_command = started.command(shown)
    command, why_not = _resume(index, shown, run, plan, own_command)
    resume, controller = (None, None) if command is None else _without_address(command)
    facts = None if plan_file is None else index.facts(plan_file)
    postures = facts.postures if isinstance(facts, Head) else None
    done = [shot.shot for shot in run.shots]
    ended: bool | None = started.ended(shown)
    if not ended and postures is not None and set(range(postures)) <= set(done):
        ended = True
    elif not ended and own_command is None:
        ended = None
    return run, RecordedRun(
        file=shown,
        origin=run.header.provenance.get("origin"),
        plan=plan,
        postures=postures,
        recorded=done,
        ended=ended,
        torn=torn is not None,
        resume=resume,
        controller=controller,
        why_not=why_not,
    )


def _without_address(command: Sequence[str]) -> tuple[list[str], str | None]:
    """A command without the address of a controller, and how the controller is reached. The folder may come
    from anybody: a person states where the arm is that moves, and who gets its password."""
    rig = next((word.removeprefix("--rig=") for word in command if word.startswith("--rig=")), "")
    scheme, is_live, _ = rig.partition("://")
    hidden = ("--host=", "--rig=") if is_live else ("--host=",)
    words = [word for word in command if not word.startswith(hidden)]
    return words, scheme if is_live or rig == _ABB else None


def _states(run: Run) -> list[tuple[int, Solution]]:
    """How many measurements there were and what they determined, the last `_MOST` times, all at the end."""
    if not run.shots:
        return []
    problem = Problem.from_run(run)
    count = problem.shots  # postures, of what several instruments read at one
    first = max(1, count - _MOST + 1)
    return [(k, so_far(problem.select(np.arange(k)))) for k in range(first, count + 1)]


def _resume(
    index: Index, name: str, run: Run, plan: str | None, own_command: Sequence[str] | None
) -> tuple[list[str] | None, str | None]:
    """The command that goes on with a run of a plan, or why there is none; `own_command` where it was begun
    here."""
    provenance = run.header.provenance
    if plan is None:
        return None, "the plan that it was begun with is not in this folder, or has changed"
    if own_command is not None:
        return [*own_command[:-1], plan], None
    words = ["run", "--resume", f"--out={name}"]
    rig = rig_words(provenance)
    if rig is None:
        return None, "how its controller is reached is not in the run file: use zerobeam run --resume"
    cell = provenance.get("cell sha256")
    if cell is not None:
        cell_file = index.of_sum("cell", cell)
        if cell_file is None:
            return None, "the cell file that it was begun with is not in this folder, or has changed"
        words.append(f"--cell={cell_file.path}")
    return [*words, *rig, plan], None
