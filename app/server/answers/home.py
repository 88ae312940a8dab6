"""The calibrations of the folder: what each has, how far it is, and when the next is due."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from threadpoolctl import threadpool_limits

from ....analysis.answer.result import Result
from ....analysis.status import Verdict
from ....model.errors import BadInput
from ....model.files.header import by_plain_key
from ....model.files.robot_file import RobotFile, built_in_robots, read_rows, stated_rows
from ....model.instruments.registry import kinds_of
from ....model.records import if_any, it, record
from ....words.message import read_message, result_words
from ....words.provenance import KEYS, SERIAL, first_entry, is_simulated
from ....words.wording import clipped, counted
from ..index import Facts, Folder, FolderFile, Head, Index, Unread
from ..job_commands import StartedRuns
from ..requests import end_point
from ..versions import kept
from .folder_runs import PLAN_HASH

# When the next calibration of an arm is due, by the databases of results in the folder.
#
# The drift is fitted beside the answers, by a thread of its own: who asks waits a little, then goes
# without.

TOLERANCE_MM = 0.5  # TCP error that is tolerated: as `zerobeam history drift` has it
_PATIENCE_S = 0.2  # of one answer
_MOST_KEPT = 64
_MOST_DATABASES = 4

_FITS = ThreadPoolExecutor(1, "due dates")


@dataclass(frozen=True)
class DueDate:
    """Of an arm; `reason` where it is due already."""

    serial: str
    date: datetime
    reason: str

    @property
    def overdue(self) -> bool:
        return self.date <= datetime.now(UTC).replace(tzinfo=None)


def due_dates(
    databases: Sequence[Path], serials: Collection[str], patience_s: float = _PATIENCE_S
) -> dict[str, DueDate]:
    """By serial number, as far as they are known by now: of an arm in several databases the last one is."""
    known: dict[str, DueDate] = {}
    sought = tuple(sorted(serials))
    for path in databases[:_MOST_DATABASES] if sought else ():
        try:
            made = _fit_of(path, _log_of(path), sought)
            dates = made.result(timeout=patience_s)
        except (BadInput, OSError, TimeoutError):
            continue
        for due in dates:
            if due.serial not in known or known[due.serial].date < due.date:
                known[due.serial] = due
    return known


@kept(_MOST_KEPT)
def _fit_of(path: Path, log: tuple[int, int] | None, serials: tuple[str, ...]) -> Future[tuple[DueDate, ...]]:
    """The due dates by this version of a database and its `log`, under way or known."""
    return _FITS.submit(_dates, path, serials)


def _log_of(path: Path) -> tuple[int, int] | None:
    """When the log of a database, which has what was written last, was changed, and its size; None: empty."""
    log = path.with_name(f"{path.name}-wal")
    facts = log.stat() if log.exists() else None
    return None if facts is None or not facts.st_size else (facts.st_mtime_ns, facts.st_size)


def _dates(path: Path, serials: tuple[str, ...]) -> tuple[DueDate, ...]:
    """BadInput where it is no history. A serial number that two models have is no arm's alone.

    What reads histories is loaded when there is one: it takes a second.
    """
    from ....experiments.history.arm_history import arm_drift
    from ....experiments.history.database import open_history
    from ....experiments.history.store import arms, events, results

    history = open_history(str(path))
    dates = []
    try:
        every = [(arm.serial, arm.model) for arm in arms(history, _passed) if arm.results]
        for serial in serials:
            named = [arm for arm in every if arm[0] == serial]
            if len(named) != 1:
                continue
            stored, logged = list(results(history, named[0], _passed)), events(history, named[0], _passed)
            with threadpool_limits(limits=1, user_api="blas"):
                drift = arm_drift(named[0], stored, logged, TOLERANCE_MM)
            if drift.due is not None:
                dates.append(DueDate(serial, drift.due, drift.due_reason))
    finally:
        history.engine.dispose()
    return tuple(dates)


def _passed(error: BadInput) -> None:
    """A row that is damaged says nothing of a date."""


MOST = 1000  # calibrations
PATIENCE_S = 2.0  # of one answer for files that were not read before; the next answer has more of them
_WIDTH = 80
_DATABASES = frozenset({".db", ".sqlite", ".sqlite3"})
_rows = kept(1000)(read_rows)

StateKind = Literal[
    "empty",
    "planned",
    "measuring",
    "measured",
    "pass",
    "weak",
    "degenerate",
    "misfit",
    "held",
    "unreadable",
]
_PARTS = ("header", "plan", "run", "result", "obstacles", "cell", "sensors")
_MAKING = frozenset({"header", "plan", "run", "result"})  # what makes a folder a calibration


@record(kw_only=True)
class CalibrationFiles:
    """Files by kind, the newest first."""

    header: list[str]
    plan: list[str]
    run: list[str]
    result: list[str]
    obstacles: list[str]
    cell: list[str]
    sensors: list[str]


@record(kw_only=True)
class CalibrationState:
    """How far a calibration is, by its newest run or result."""

    kind: Annotated[StateKind, it("`held`: no offset is estimated")]
    text: str
    verdict: Annotated[Verdict | None, if_any] = None
    recorded: Annotated[int | None, it("measurements"), if_any] = None
    of: Annotated[int | None, it("measurements of the plan"), if_any] = None
    file: Annotated[str | None, it("what this is said of"), if_any] = None


@record(kw_only=True)
class CalibrationDue:
    """When the next calibration is due."""

    date: str
    overdue: bool
    text: str


@record(kw_only=True)
class Calibration:
    """A folder with a header, a plan, a run or a result."""

    name: Annotated[str, it("the folder, relative to the app's; `.`: that itself")]
    robot: str | None
    maker: str | None
    model: str | None
    serial: str | None
    instrument: Annotated[str | None, it("kinds, separated by commas")]
    files: CalibrationFiles
    state: CalibrationState
    due: CalibrationDue | None
    simulated: bool
    modified: Annotated[str, it("ISO 8601, UTC")]


@record(kw_only=True)
class HomeAnswer:
    """All calibrations, the newest first."""

    calibrations: list[Calibration]
    left_out: int
    unread: Annotated[int, it("of which files were not read yet: ask again")]
    history: Annotated[bool, it("whether the folder has a database of results")]


@end_point(
    "GET /api/home", "The calibrations of the folder, how far each is, when the next of an arm is due."
)
def home(folder: Folder) -> HomeAnswer:
    """The calibrations of the folder. Nothing is fitted, and a broken file is said where it is."""
    index, runs = Index(folder, PATIENCE_S), StartedRuns(folder)
    rows = list(_by_calibration(index).items())
    made = [_calibration(index, runs, name, files) for name, files in rows[:MOST]]
    databases = index.of_suffix(_DATABASES)
    return HomeAnswer(
        calibrations=_with_due_dates([calibration for calibration, _ in made], databases),
        left_out=len(rows) - len(made),
        unread=sum(later for _, later in made),
        history=bool(databases),
    )


def _with_due_dates(calibrations: list[Calibration], databases: list[Path]) -> list[Calibration]:
    """A rehearsal wears no arm: it has no date."""
    serials = {one.serial for one in calibrations if one.serial and not one.simulated}
    dates = due_dates(databases, serials)
    return [
        one if one.simulated or one.serial not in dates else replace(one, due=_due(dates[one.serial]))
        for one in calibrations
    ]


def _due(due: DueDate) -> CalibrationDue:
    date = f"{due.date:%Y-%m-%d}"
    text = f"Calibration due since {date}" if due.overdue else f"Next calibration due on {date}"
    text = f"{text}: {due.reason}" if due.reason else text
    return CalibrationDue(date=date, overdue=due.overdue, text=text)


def _by_calibration(index: Index) -> dict[str, list[FolderFile]]:
    """The files of each calibration, the newest first; a report's result is with its run."""
    files = index.of_kinds(*_PARTS)
    runs: dict[str, list[FolderFile]] = {}
    for file in files:
        if file.kind == "run":
            runs.setdefault(_above(file.path), []).append(file)
    of_folder: dict[str, list[FolderFile]] = {}
    for file in files:
        parent = _above(file.path)
        above = runs.get(_above(parent), []) if parent != "." and file.kind == "result" else []
        if above and _is_report(index, file, above):
            parent = _above(parent)
        of_folder.setdefault(parent, []).append(file)
    return {name: rows for name, rows in of_folder.items() if any(row.kind in _MAKING for row in rows)}


def _is_report(index: Index, result: FolderFile, runs: list[FolderFile]) -> bool:
    """Whether a result is in the folder of a report of one of the `runs`; a broken one is taken for that."""
    if not result.at.with_name("report.html").is_file():
        return False
    facts = index.facts(result)
    return not isinstance(facts, Result) or any(run.is_of(facts.inputs.sha256) for run in runs)


def _above(name: str) -> str:
    return str(PurePosixPath(name).parent)


def _calibration(
    index: Index, runs: StartedRuns, name: str, files: list[FolderFile]
) -> tuple[Calibration, bool]:
    """A calibration, and whether something of it is read later."""
    parts = {kind: [file for file in files if file.kind == kind] for kind in _PARTS}
    state, facts = _state(index, runs, files, parts)
    if not any(isinstance(one, Head) for one in facts):
        facts += [index.facts(parts[kind][0]) for kind in ("run", "plan", "header") if parts[kind]]
    results = [one for one in facts if isinstance(one, Result)]
    headers = [one.header for one in facts if isinstance(one, Head)]
    headers += [one.inputs.header for one in results]
    robot, maker, model = _robot(index.folder, headers, results, name)
    calibration = Calibration(
        name=name,
        robot=robot,
        maker=maker,
        model=model,
        serial=next(filter(None, map(_serial, headers)), None),
        instrument=_instruments(headers[0]) or None if headers else None,
        files=CalibrationFiles(**{kind: [file.path for file in files] for kind, files in parts.items()}),
        state=state,
        due=None,
        simulated=any(is_simulated(header.get("provenance") or {}) for header in headers),
        modified=files[0].modified,
    )
    return calibration, any(isinstance(one, Unread) and one.later for one in facts)


def _state(
    index: Index, runs: StartedRuns, files: list[FolderFile], parts: Mapping[str, list[FolderFile]]
) -> tuple[CalibrationState, list[Facts]]:
    """The state by the newest run or result, else the newest plan or header; and what was read for it."""
    newest = next((file for file in files if file.kind in ("run", "result")), None)
    newest = newest or next((file for file in files if file.kind == "plan"), None)
    newest = newest or next(file for file in files if file.kind == "header")
    of = (newest.kind == "run" and _result_of(index, newest, parts["result"])) or newest
    kind, facts = of.kind, index.facts(of)
    if isinstance(facts, Unread):
        late: StateKind = "measured" if kind in ("run", "result") else "planned"
        state: StateKind = late if facts.later else "unreadable"
        text = facts.why if facts.later else f"{of.at.name}: {facts.why}"
        return CalibrationState(kind=state, text=text, file=of.path), [facts]
    if isinstance(facts, Result):
        state = read_message(facts).grade or "held"
        text = result_words(facts)
        return CalibrationState(kind=state, text=text, verdict=facts.verdict, file=of.path), [facts]
    if kind == "header":
        return CalibrationState(kind="empty", text="no plan yet", file=of.path), [facts]
    if kind == "plan":
        text = f"planned: {counted(facts.postures, 'measurement')}"
        return CalibrationState(kind="planned", text=text, of=facts.postures, file=of.path), [facts]
    plan = _plan_of(index, facts, parts["plan"])
    planned = plan.postures if isinstance(plan, Head) else None
    recorded = len(facts.shots)
    under_way = planned is not None and not facts.shots >= set(range(planned)) and not runs.ended(of.path)
    measured = f" {recorded} of {planned}" if under_way else f": {counted(recorded, 'measurement')}"
    whole = CalibrationState(
        kind="measuring" if under_way else "measured",
        text=f"measured{measured}",
        recorded=recorded,
        of=planned,
        file=of.path,
    )
    return whole, [facts] if plan is None else [facts, plan]


def _result_of(index: Index, run: FolderFile, results: list[FolderFile]) -> FolderFile | None:
    """The newest result of a run."""
    for file in results:
        facts = index.facts(file)
        if isinstance(facts, Result) and run.is_of(facts.inputs.sha256):
            return file
    return None


def _plan_of(index: Index, run: Head, plans: list[FolderFile]) -> Facts | None:
    """What the plan of a run says; None where it is not here."""
    sha256 = (run.header.get("provenance") or {}).get(PLAN_HASH)
    return next((index.facts(plan) for plan in plans if plan.is_of(sha256)), None)


def _robot(
    folder: Folder, headers: list[Mapping[str, Any]], results: list[Result], name: str
) -> tuple[str | None, str | None, str | None]:
    """Name, maker and model of the arm, as far as they are stated."""
    declared = headers[0].get("robot") if headers else None
    if isinstance(declared, dict):
        return clipped(PurePosixPath(str(declared.get("urdf"))).stem, _WIDTH), None, None
    if not isinstance(declared, str):
        return (results[0].inputs.robot if results else None), None, None
    if declared in built_in_robots():
        rows = _built_in(declared)
        return declared, rows.vendor, rows.model
    try:
        rows = _rows(folder.inside(declared, folder.root / name))
    except (BadInput, OSError):
        shown = results[0].inputs.robot if results else PurePosixPath(declared).stem
        return clipped(shown, _WIDTH), None, None
    return clipped(rows.name, _WIDTH), rows.vendor, rows.model


@cache
def _built_in(name: str) -> RobotFile:
    return stated_rows(name, Path())


def _instruments(header: Mapping[str, Any]) -> str:
    """The kinds of a header's instruments."""
    try:
        kinds = kinds_of(header)
    except (BadInput, KeyError, TypeError):
        return ""
    return ", ".join(dict.fromkeys(kind.name for kind in kinds.values()))


def _serial(header: Mapping[str, Any]) -> str:
    return clipped(first_entry(by_plain_key(header.get("provenance") or {}), KEYS[SERIAL]), _WIDTH)
