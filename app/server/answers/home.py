"""The calibrations of the folder: what each has, and how far it is."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from ....analysis.answer.result import Result
from ....analysis.status import Verdict
from ....model.errors import BadInput
from ....model.files.header import RUN_SCHEMA, Header, UrdfRef
from ....model.files.plan import plan_of
from ....model.files.robot_file import built_in_robots, read_rows, stated_rows
from ....model.instruments.registry import kinds_of
from ....model.parsing.reading import read_yaml
from ....model.parsing.validation import validate
from ....model.records import if_any, it, record
from ....words.message import read_message, result_words
from ....words.provenance import KEYS, SERIAL, by_plain_key, first_entry, is_simulated
from ....words.wording import clipped, counted
from ..folder import Folder, KindOfFile
from ..kept import Kept
from ..requests import end_point
from ..started_runs import StartedRuns
from .due_dates import DueDate, due_dates
from .results import read_result, sha256_of
from .unfinished_runs import PLAN_HASH

MOST = 1000  # calibrations
_KEPT = 8000
_LARGEST_RESULT = 4 * 10**6  # bytes
_LARGEST_RUN = 16 * 10**6  # bytes
_PATIENCE_S = 2.0  # of one answer for files that were not read before; the next answer has more of them
_SHOT = re.compile(rb'"shot"\s*:\s*(\d+)')
_WIDTH = 80
_DATABASES = frozenset({".db", ".sqlite", ".sqlite3"})
_RUNS, _PLANS, _HEADERS, _ROWS, _BRIEFS = Kept(_KEPT), Kept(_KEPT), Kept(_KEPT), Kept(_KEPT), Kept(_KEPT)

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

    kind: Annotated[StateKind, it("`held`: a pass of a simulated run")]
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


@dataclass(frozen=True)
class _Facts:
    """What a file says of its arm: `robot` as it is stated, relative to `start`."""

    robot: object
    instrument: str
    serial: str | None = None
    simulated: bool = False
    count: int = 0
    shots: frozenset[int] = frozenset()
    plan_sha256: str | None = None


@dataclass(frozen=True)
class _Unread:
    """Why a file says nothing; `later`: it was not read yet."""

    why: str
    later: bool = False


_Part = _Facts | Result | _Unread


class _Reading:
    """Reads files of the folder, those that are not known yet for a bounded time."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.runs = StartedRuns(folder)
        self._end = time.monotonic() + _PATIENCE_S

    def facts(self, kind: str, name: str) -> _Part:
        kept, make = _READERS[kind]

        def timely(path: Path) -> _Part:
            if time.monotonic() > self._end:
                raise TimeoutError
            try:
                made: _Part = make(path)
                return made
            except BadInput as error:
                return _Unread(self.folder.without(_first_line(error)))

        try:
            part: _Part = kept.of(self.folder.root / name, timely)
            return part
        except TimeoutError:
            return _Unread("not read yet", later=True)
        except OSError as error:
            return _Unread(f"the file cannot be read: {error.strerror}")


def _first_line(error: BadInput) -> str:
    where = "" if error.line is None else f"line {error.line}: "
    return clipped(f"{where}{error.what}", 200)


@end_point(
    "GET /api/home", "The calibrations of the folder, how far each is, when the next of an arm is due."
)
def home(folder: Folder) -> HomeAnswer:
    """The calibrations of the folder. Nothing is fitted, and a broken file is said where it is."""
    reading = _Reading(folder)
    rows = list(_by_calibration(reading, folder.of_kinds(frozenset(_PARTS))).items())
    made = [_calibration(reading, name, files) for name, files in rows[:MOST]]
    databases = folder.of_suffix(_DATABASES)
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


def _by_calibration(reading: _Reading, files: list[KindOfFile]) -> dict[str, list[KindOfFile]]:
    """The files of each calibration, the newest first; a report's result is with its run."""
    runs: dict[str, list[str]] = {}
    for file in files:
        if file.kind == "run":
            runs.setdefault(_above(file.path), []).append(file.path)
    of_folder: dict[str, list[KindOfFile]] = {}
    for file in files:
        parent = _above(file.path)
        above = runs.get(_above(parent), []) if parent != "." and file.kind == "result" else []
        if above and _is_report(reading, file.path, above):
            parent = _above(parent)
        of_folder.setdefault(parent, []).append(file)
    return {name: rows for name, rows in of_folder.items() if any(row.kind in _MAKING for row in rows)}


def _is_report(reading: _Reading, result: str, runs: list[str]) -> bool:
    """Whether a result is in the folder of a report of one of the `runs`; a broken one is taken for that."""
    root = reading.folder.root
    if not (root / result).with_name("report.html").is_file():
        return False
    read = reading.facts("result", result)
    if not isinstance(read, Result):
        return True
    return read.inputs.sha256 in {sha256_of(root / run) for run in runs}


def _above(name: str) -> str:
    return str(PurePosixPath(name).parent)


def _calibration(reading: _Reading, name: str, files: list[KindOfFile]) -> tuple[Calibration, bool]:
    """A calibration, and whether something of it is read later."""
    paths = {kind: [file.path for file in files if file.kind == kind] for kind in _PARTS}
    parts: list[_Part] = []
    state = _state(reading, files, paths, parts)
    if not any(isinstance(one, _Facts) for one in parts):
        parts += [reading.facts(kind, paths[kind][0]) for kind in ("run", "plan", "header") if paths[kind]]
    facts = [one for one in parts if isinstance(one, _Facts)]
    results = [one for one in parts if isinstance(one, Result)]
    robot, maker, model = _robot(reading.folder, facts, results, name)
    provenance = by_plain_key(results[0].inputs.provenance) if results else {}
    header: Mapping[str, Any] = results[0].inputs.header if results else {}
    calibration = Calibration(
        name=name,
        robot=robot,
        maker=maker,
        model=model,
        serial=next((one.serial for one in facts if one.serial), None)
        or first_entry(provenance, KEYS[SERIAL])
        or None,
        instrument=(facts[0].instrument if facts else _instruments(header)) or None,
        files=CalibrationFiles(**paths),
        state=state,
        due=None,
        simulated=any(is_simulated(one.inputs.provenance) for one in results)
        or any(one.simulated for one in facts),
        modified=files[0].modified,
    )
    return calibration, any(isinstance(one, _Unread) and one.later for one in parts)


def _state(
    reading: _Reading,
    files: list[KindOfFile],
    paths: Mapping[str, list[str]],
    parts: list[_Part],
) -> CalibrationState:
    """The state by the newest run or result, else the newest plan or header; `parts` gets what was read."""
    newest = next((file for file in files if file.kind in ("run", "result")), None)
    newest = newest or next((file for file in files if file.kind == "plan"), None)
    newest = newest or next(file for file in files if file.kind == "header")
    kind, file = newest.kind, newest.path
    if kind == "run" and (result := _result_of(reading, file, paths["result"])) is not None:
        kind, file = "result", result
    facts = reading.facts(kind, file)
    parts.append(facts)
    if isinstance(facts, _Unread):
        late: StateKind = "measured" if kind in ("run", "result") else "planned"
        state: StateKind = late if facts.later else "unreadable"
        text = facts.why if facts.later else f"{PurePosixPath(file).name}: {facts.why}"
        return CalibrationState(kind=state, text=text, file=file)
    if isinstance(facts, Result):
        return CalibrationState(
            kind=read_message(facts).grade or "held",
            text=result_words(facts),
            verdict=facts.verdict,
            file=file,
        )
    if kind == "header":
        return CalibrationState(kind="empty", text="no plan yet", file=file)
    if kind == "plan":
        return CalibrationState(
            kind="planned", text=f"planned: {counted(facts.count, 'measurement')}", of=facts.count, file=file
        )
    recorded, of = len(facts.shots), _planned(reading, facts, paths["plan"], parts)
    under_way = of is not None and not facts.shots >= set(range(of)) and not reading.runs.ended(file)
    return CalibrationState(
        kind="measuring" if under_way else "measured",
        text=f"measured {recorded} of {of}" if under_way else f"measured: {counted(recorded, 'measurement')}",
        recorded=recorded,
        of=of,
        file=file,
    )


def _result_of(reading: _Reading, run: str, results: list[str]) -> str | None:
    """The newest result of a run."""
    if not results:
        return None
    sha256 = sha256_of(reading.folder.root / run)
    for name in results:
        facts = reading.facts("result", name)
        if isinstance(facts, Result) and facts.inputs.sha256 == sha256:
            return name
    return None


def _planned(reading: _Reading, run: _Facts, plans: list[str], parts: list[_Part]) -> int | None:
    """How many measurements the plan of a run has; None where it is not here."""
    for name in plans:
        if run.plan_sha256 is not None and sha256_of(reading.folder.root / name) == run.plan_sha256:
            facts = reading.facts("plan", name)
            parts.append(facts)
            return facts.count if isinstance(facts, _Facts) else None
    return None


def _robot(
    folder: Folder, facts: list[_Facts], results: list[Result], name: str
) -> tuple[str | None, str | None, str | None]:
    """Name, maker and model of the arm, as far as they are stated."""
    declared = facts[0].robot if facts else results[0].inputs.header.get("robot") if results else None
    if isinstance(declared, dict):
        declared = UrdfRef.model_construct(**declared)
    if isinstance(declared, UrdfRef):
        return clipped(PurePosixPath(str(declared.urdf)).stem, _WIDTH), None, None
    if not isinstance(declared, str):
        return (results[0].inputs.robot if results else None), None, None
    if declared in built_in_robots():
        return declared, *_maker(declared)
    shown = results[0].inputs.robot if results else PurePosixPath(declared).stem
    try:
        path = folder.inside(declared, folder.root / name)
        rows = _ROWS.of(path, read_rows)
    except (BadInput, OSError):
        return clipped(shown, _WIDTH), None, None
    return clipped(rows.name, _WIDTH), rows.vendor, rows.model


@cache
def _maker(name: str) -> tuple[str | None, str | None]:
    """Maker and model of a built-in arm."""
    rows = stated_rows(name, Path())
    return rows.vendor, rows.model


def _instruments(header: Mapping[str, Any]) -> str:
    """The kinds of a header's instruments."""
    try:
        kinds = kinds_of(header)
    except (BadInput, KeyError, TypeError):
        return ""
    return ", ".join(dict.fromkeys(kind.name for kind in kinds.values()))


def _read_header(path: Path) -> _Facts:
    document = read_yaml(path)
    header = validate(Header, document.data, file=path, line=document.line)
    return _Facts(header.robot, _instruments(document.data), _serial(document.data.get("provenance")))


def _read_plan(path: Path) -> _Facts:
    document = read_yaml(path)
    plan = plan_of(document)
    serial = _serial(document.data.get("provenance"))
    return _Facts(plan.header.robot, _instruments(document.data), serial, count=len(plan.postures))


def _read_run(path: Path) -> _Facts:
    """The header of a run and the numbers of its measurements: its readings are not looked at."""
    if path.stat().st_size > _LARGEST_RUN:
        raise BadInput("the run is too long to be looked at here")
    head, _, rest = path.read_bytes().partition(b"\n")
    try:
        header = json.loads(head)
        if header["schema"] != RUN_SCHEMA:
            raise ValueError
        provenance = header.get("provenance") or {}
        plan = provenance.get(PLAN_HASH)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise BadInput("this is no whole header of a run") from None
    return _Facts(
        header.get("robot"),
        _instruments(header),
        _serial(provenance),
        is_simulated(provenance),
        shots=frozenset(int(number) for number in _SHOT.findall(rest)),
        plan_sha256=plan if isinstance(plan, str) else None,
    )


def _read_result(path: Path) -> Result:
    if path.stat().st_size > _LARGEST_RESULT:
        raise BadInput("the result is too large to be looked at here: open it")
    return read_result(path)


def _serial(provenance: object) -> str | None:
    if not isinstance(provenance, Mapping):
        return None
    return clipped(first_entry(by_plain_key(provenance), KEYS[SERIAL]), _WIDTH) or None


_READERS: dict[str, tuple[Kept, Any]] = {
    "header": (_HEADERS, _read_header),
    "plan": (_PLANS, _read_plan),
    "run": (_RUNS, _read_run),
    "result": (_BRIEFS, _read_result),
}
