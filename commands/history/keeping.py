"""`zerobeam history`: results added to a database, listed, shown, copied."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ...model.errors import BadInput
from ..console import err, out, plain, print_json, print_json_pieces, progress
from ..options import Force, Json, Seed
from .shared import Model, Serial, Url, damage_named, opened

if TYPE_CHECKING:
    from ...experiments.history.entry import Entry
    from ...experiments.history.store import StoredResult

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
    from ...experiments.history.entry import files_of, is_run, read_entry
    from ...experiments.history.store import add as add_entries
    from ...experiments.history.store import arm_of

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
    from ...experiments.history.store import arms, results
    from ...reports.history.lists import arms_table, history_text
    from ...reports.style.console import print_block

    with damage_named() as damaged, opened(db) as history:
        if as_json:
            print_json_pieces(history_text(results(history, damaged=damaged)))
        else:
            print_block(out, arms_table(arms(history, damaged)))


@histories.command("show")
def show(serial: Serial, model: Model = None, db: Url = None, as_json: Json = False) -> None:
    """Show the results and events of an arm, in the order of time."""
    from ...experiments.history.store import events, find_arm, results
    from ...reports.history.lists import SCHEMA, event_json, events_table, result_json, results_table
    from ...reports.style.console import print_block

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
    from ...experiments.history.entry import moment
    from ...experiments.history.store import Event, add_event, find_arm

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
    from ...experiments.history.store import events, find_arm, results
    from ...model.files.whole_file import write_whole
    from ...reports.history.lists import history_text, offset_rows
    from ...words.spreadsheet import csv_lines

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
    from ...experiments.history.database import back_up

    with opened(db) as history:
        count = back_up(history, file, force=force)
    out.print(f"{count} results: {file}", soft_wrap=True, markup=False, highlight=False)


@histories.command("restore")
def restore(
    file: Annotated[Path, typer.Argument(help="A backup.", show_default=False)],
    db: Url = None,
) -> None:
    """Copy a backup into an empty history, of SQLite or PostgreSQL."""
    from ...experiments.history.database import restore as copy_back

    with opened(db, create=True) as history:
        count = copy_back(file, history)
        out.print(f"{count} results: {history.name}", soft_wrap=True, markup=False, highlight=False)
