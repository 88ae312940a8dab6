"""`zerobeam history`: a database of results of many arms: kept, listed, copied; their drift, their pages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..model.errors import BadInput, missing_extra
from .console import err, out, plain, print_json, print_json_pieces, progress
from .options import Force, Json, Seed

if TYPE_CHECKING:
    from datetime import datetime

    from ..experiments.history.database import Database
    from ..experiments.history.entry import Entry
    from ..experiments.history.store import Damaged, StoredResult
    from ..reports.history.arm_page import ArmHistory

Url = Annotated[
    str | None,
    typer.Option(
        "--db",
        envvar="ZEROBEAM_HISTORY",
        help="SQLite file, or postgresql://user@host/database. Default: history.sqlite in your data folder.",
        metavar="URL",
        show_default=False,
    ),
]
Serial = Annotated[
    str, typer.Argument(help="Serial number of the arm.", metavar="SERIAL", show_default=False)
]
Model = Annotated[
    str | None,
    typer.Option(help="Model of the arm, where several have this serial number.", show_default=False),
]


@contextmanager
def opened(db: str | None, *, create: bool = False) -> Iterator[Database]:
    if any(find_spec(needed) is None for needed in ("sqlalchemy", "alembic")):
        raise missing_extra("a history", "history")
    from ..experiments.history.database import open_history

    history = open_history(db, create=create)
    try:
        yield history
    finally:
        history.engine.dispose()


@contextmanager
def damage_named() -> Iterator[Damaged]:
    """Damaged results and events are named as errors, the rest goes on; at the end the exit status is 2."""
    errors: list[BadInput] = []

    def name(error: BadInput) -> None:
        errors.append(error)
        err.print(f"error: {plain(error)}", markup=False, soft_wrap=True)

    yield name
    if errors:
        raise typer.Exit(BadInput.exit_status)


histories = typer.Typer(
    help="Results of many arms over the years, in a database: what drifted, and when the next one is due.",
    no_args_is_help=True,
)

_AT_ONCE = 100  # results in one transaction

What = Literal["collision", "motor", "mastering", "other"]


@histories.command("add")
def add(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Results (result.json), runs (.jsonl: solved first), or folders of results.",
            metavar="FILE...",
            show_default=False,
        ),
    ],
    db: Url = None,
    serial: Annotated[
        str | None,
        typer.Option(help="Serial number of the arm, where a run states none.", show_default=False),
    ] = None,
    when: Annotated[
        str | None,
        typer.Option(help="Date of the measurements, where a run states none.", show_default=False),
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace another result of the same run.")
    ] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Add results, each once; runs are solved first. A bad file is named, and the others are added."""
    from ..experiments.history.entry import files_of, is_run, read_entry
    from ..experiments.history.store import add as add_entries
    from ..experiments.history.store import arm_of

    counts: dict[str, int] = dict.fromkeys(("added", "replaced", "already there", "refused"), 0)
    failed: list[dict[str, str]] = []
    waiting: list[tuple[Path, Entry]] = []

    def refuse(path: Path, why: str) -> None:
        failed.append({"file": str(path), "message": why})
        err.print(f"error: {plain(why)}", markup=False, soft_wrap=True)

    def flush() -> None:
        for (path, own), outcome in zip(
            waiting, add_entries(history, [entry for _, entry in waiting], replace=replace), strict=True
        ):
            counts[outcome] += 1
            if outcome == "refused":
                refuse(path, str(_other_result(path, own, replace)))
        waiting.clear()

    with opened(db, create=True) as history:
        paths = list(files_of(files))

        def held(sha256: str) -> tuple[str, str] | None:
            return None if replace else arm_of(history, sha256)

        with progress("history") as tell:
            for number, path in enumerate(paths):
                tell(f"{number} of {len(paths)}", number / len(paths))
                try:
                    entry = read_entry(path, held, serial=serial, when=when, seed=seed)
                except BadInput as error:
                    refuse(path, str(error.at(path, None)))
                    continue
                if entry is None:
                    counts["already there"] += 1
                    continue
                waiting.append((path, entry))
                if len(waiting) >= _AT_ONCE or is_run(path):
                    flush()
            flush()
    if as_json:
        print_json({**{name.replace(" ", "_"): count for name, count in counts.items()}, "failed": failed})
    else:
        told = [f"{count} {name}" for name, count in counts.items() if count or name == "added"]
        if unread := len(failed) - counts["refused"]:
            told.append(f"{unread} not added")
        out.print(f"{', '.join(told)}: {history.name}", soft_wrap=True, markup=False, highlight=False)
    raise typer.Exit(2 if failed or not paths else 0)


def _other_result(path: Path, own: Entry, replace: bool) -> BadInput:
    remedy = "name one arm for it" if replace else "--replace takes this one instead, for the same arm"
    return BadInput(
        "the history has another result of the same run",
        found=f"run {own.run}, SHA-256 {own.sha256[:12]}…",
        allowed="one result of each run",
        remedy=remedy,
        file=path,
    )


@histories.command("list")
def list_arms(db: Url = None, as_json: Json = False) -> None:
    """List the arms with their last results; with --json every result."""
    from ..experiments.history.store import arms, results
    from ..reports.history.lists import arms_table, history_text
    from ..reports.style.console import print_block

    with damage_named() as damaged, opened(db) as history:
        if as_json:
            print_json_pieces(history_text(results(history, damaged=damaged)))
        else:
            print_block(out, arms_table(arms(history, damaged)))


@histories.command("show")
def show(serial: Serial, model: Model = None, db: Url = None, as_json: Json = False) -> None:
    """Show the results and events of an arm, in the order of time."""
    from ..experiments.history.store import events, find_arm, results
    from ..reports.history.lists import SCHEMA, event_json, events_table, result_json, results_table
    from ..reports.style.console import print_block

    with damage_named() as damaged:
        with opened(db) as history:
            arm = find_arm(history, serial, model)
            found, happened = list(results(history, arm, damaged)), events(history, arm, damaged)
        if as_json:
            print_json(
                {
                    "schema": SCHEMA,
                    "serial": arm[0],
                    "model": arm[1],
                    "results": [result_json(own) for own in found],
                    "events": [event_json(own) for own in happened],
                }
            )
            return
        out.print(f"{plain(arm[0])}, {plain(arm[1])}", markup=False, highlight=False)
        for block in (results_table(found), events_table(happened)):
            if block is not None:
                print_block(out, block)


@histories.command("event")
def event(
    serial: Serial,
    date: Annotated[str, typer.Option(help="When it happened (ISO 8601).", show_default=False)],
    what: Annotated[
        What,
        typer.Option(
            help="collision, motor (changed), mastering (new zeros in the controller) or other.",
            show_default=False,
        ),
    ],
    note: Annotated[str, typer.Option(help="What is to be remembered of it.", show_default=False)] = "",
    model: Model = None,
    db: Url = None,
) -> None:
    """Log what happened to an arm."""
    from ..experiments.history.entry import moment
    from ..experiments.history.store import Event, add_event, find_arm

    with opened(db) as history:
        arm = find_arm(history, serial, model)
        new = add_event(history, Event(*arm, moment(date), what, note))
    out.print("logged" if new else "already there")


@histories.command("export")
def export(
    file: Annotated[
        Path, typer.Option("-o", "--out", help="File to write: .csv or .json.", show_default=False)
    ],
    serial: Annotated[
        str | None,
        typer.Argument(help="Serial number of one arm.", metavar="[SERIAL]", show_default=False),
    ] = None,
    model: Model = None,
    db: Url = None,
    force: Force = False,
) -> None:
    """Write the results as a table (a row for each offset) or as JSON."""
    from ..experiments.history.store import events, find_arm, results
    from ..model.files.whole_file import write_whole
    from ..reports.history.lists import history_text, offset_rows
    from ..words.spreadsheet import csv_lines

    if file.suffix not in (".csv", ".json"):
        raise BadInput("no table of this kind is written", found=file.name, allowed=".csv or .json")
    with opened(db) as history:
        arm = None if serial is None else find_arm(history, serial, model)
        count = 0

        def found() -> Iterator[StoredResult]:
            nonlocal count
            for count, own in enumerate(results(history, arm), start=1):  # noqa: B007 - told below
                yield own

        csv = file.suffix == ".csv"
        text = csv_lines(offset_rows(found())) if csv else history_text(found(), events(history, arm))
        write_whole(file, text, force=force)
    out.print(f"{count} results: {file}", soft_wrap=True, markup=False, highlight=False)


@histories.command("backup")
def backup(
    file: Annotated[Path, typer.Argument(help="SQLite file to write.", show_default=False)],
    db: Url = None,
    force: Force = False,
) -> None:
    """Copy the whole history into one SQLite file, while others go on working with it."""
    from ..experiments.history.database import back_up

    with opened(db) as history:
        count = back_up(history, file, force=force)
    out.print(f"{count} results: {file}", soft_wrap=True, markup=False, highlight=False)


@histories.command("restore")
def restore(
    file: Annotated[Path, typer.Argument(help="A backup.", show_default=False)],
    db: Url = None,
) -> None:
    """Copy a backup into an empty history, of SQLite or PostgreSQL."""
    from ..experiments.history.database import restore as copy_back

    with opened(db, create=True) as history:
        count = copy_back(file, history)
        out.print(f"{count} results: {history.name}", soft_wrap=True, markup=False, highlight=False)


_SerialOrAll = Annotated[
    str | None,
    typer.Argument(help="Serial number of one arm (all).", metavar="[SERIAL]", show_default=False),
]
_Tolerance = Annotated[
    float, typer.Option("--tolerance-mm", min=1e-6, max=1e6, help="TCP error that is tolerated, mm.")
]


@histories.command("drift")
def drift(
    serial: _SerialOrAll = None,
    tolerance_mm: _Tolerance = 0.5,
    model: Model = None,
    db: Url = None,
    as_json: Json = False,
) -> None:
    """Which changes of the offsets are real, how fast they walk, and when the next calibration is due."""
    from ..experiments.history.arm_drift import arm_drift
    from ..experiments.history.fleet_drift import drift_of_each, fleet_drift
    from ..experiments.history.store import arms, events, find_arm, results
    from ..reports.history.drift_text import (
        SCHEMA,
        arms_drift_table,
        drift_blocks,
        drift_json,
        fleet_blocks,
        fleet_drift_json,
    )
    from ..reports.style.console import print_block

    with opened(db) as history, progress("drift") as tell:
        fleet = None
        if serial is None:
            every = [(own.serial, own.model) for own in arms(history) if own.results]
            jobs = ((arm, list(results(history, arm)), events(history, arm)) for arm in every)
            found = drift_of_each(jobs, len(every), tolerance_mm, lambda stage, share: tell(stage, share / 2))
            fleet = fleet_drift(found, lambda stage, share: tell(stage, (1 + share) / 2))
        else:
            arm = find_arm(history, serial, model)
            tell(serial, 0.0)
            found = [arm_drift(arm, list(results(history, arm)), events(history, arm), tolerance_mm)]
    if as_json:
        answer = {"schema": SCHEMA, "arms": [drift_json(own) for own in found]}
        print_json(answer if fleet is None else {**answer, "fleet": fleet_drift_json(fleet)})
    elif fleet is not None:
        for block in (arms_drift_table(found), *fleet_blocks(fleet)):
            print_block(out, block)
    else:
        for own in found:
            out.print(f"{plain(own.serial)}, {plain(own.model)}", markup=False, highlight=False)
            for block in drift_blocks(own):
                print_block(out, block)


@histories.command("report")
def report(
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the pages.", show_default=False)],
    serial: _SerialOrAll = None,
    tolerance_mm: _Tolerance = 0.5,
    as_of: Annotated[
        str | None,
        typer.Option(
            help="Day for which it is said what is overdue (default: of the last result in the history).",
            show_default=False,
        ),
    ] = None,
    model: Model = None,
    db: Url = None,
    as_json: Json = False,
) -> None:
    """Write the page of an arm, or of all arms with a page for each: HTML, PDF, JSON, CSV."""
    from ..experiments.history.entry import moment
    from ..experiments.history.store import arms, find_arm
    from ..reports.history.arm_page import headline as arm_headline
    from ..reports.history.fleet_page import headline as fleet_headline
    from ..reports.history.history_folder import (
        ARM_PAGE,
        FLEET_PAGE,
        arm_json,
        check_arm_target,
        check_fleet_target,
        fleet_json,
        write_arm,
        write_fleet,
    )

    when = None if as_of is None else moment(as_of)
    (check_fleet_target if serial is None else check_arm_target)(folder)
    with opened(db) as history, progress("report") as tell:
        every = arms(history)
        when = when or max((own.last for own in every if own.last is not None), default=None)

        def of(arm: tuple[str, str]) -> ArmHistory:
            return _history_of(history, arm, tolerance_mm, when)

        if serial is not None:
            own = of(find_arm(history, serial, model))
            tell("writing", 0.5)
            write_arm(folder, own)
            said, answer, page = arm_headline(own), arm_json(own), ARM_PAGE
        else:
            named = [(one.serial, one.model) for one in every if model in (None, one.model)]
            fleet = write_fleet(folder, named, of, tolerance_mm, when, tell)
            said, answer, page = fleet_headline(fleet), fleet_json(fleet), FLEET_PAGE
    if as_json:
        print_json(answer)
    else:
        out.print(plain(f"{said.word}. {said.sentence}"), soft_wrap=True, markup=False, highlight=False)
        out.print(f"Report: {folder / page}", soft_wrap=True, markup=False, highlight=False)


def _history_of(
    history: Database, arm: tuple[str, str], tolerance_mm: float, as_of: datetime | None
) -> ArmHistory:
    from ..experiments.history.arm_drift import arm_drift
    from ..experiments.history.store import events, results
    from ..reports.history.arm_page import ArmHistory

    found, happened = tuple(results(history, arm)), tuple(events(history, arm))
    return ArmHistory(arm_drift(arm, found, happened, tolerance_mm), found, happened, as_of)
