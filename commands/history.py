"""`zerobeam history`: a database of results of many arms: kept, listed, exported, certified; drift, pages."""

from __future__ import annotations

import getpass
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer

from ..experiments.command_options import AddOptions, HistoryPageOptions, Model, SerialOrAll, ToleranceMm, Url
from ..model.errors import BadInput, missing_extra
from ..model.options import Option, argument
from ..reports.style.blocks import plain_page
from ..words.wording import csv_lines
from .console import err, print_json, print_json_pieces, progress, say, show_answer
from .shared_options import Force, Group, Json

if TYPE_CHECKING:
    from ..experiments.history.arm_history import ArmHistory
    from ..experiments.history.database import Database
    from ..experiments.history.store import Damaged
    from ..experiments.history.stored_result import Entry, Event, StoredResult
    from ..reports.history.certificate import SignatureCheck

OfArm = TypeVar("OfArm", "Event", "StoredResult")
Serial = Annotated[str, argument("Serial number of the arm.", metavar="SERIAL")]


@contextmanager
def opened(db: str | None, *, create: bool = False) -> Iterator[Database]:
    if find_spec("sqlalchemy") is None:
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
        say(f"error: {error}", to=err)

    yield name
    if errors:
        raise typer.Exit(BadInput.exit_status)


histories = Group(
    help="Results of many arms over the years, in a database: what drifted, and when the next one is due.",
    no_args_is_help=True,
)

_AT_ONCE = 100  # results in one transaction

What = Literal["collision", "motor", "mastering", "other"]


@histories.of_options("add")
def add(
    files: Annotated[
        list[Path],
        argument(
            "Results (result.json), runs (.jsonl: solved first), or folders of results.", metavar="FILE..."
        ),
    ],
    *,
    options: AddOptions,
    as_json: Json = False,
) -> None:
    """Add results, each once; runs are solved first. A bad file is named, and the others are added."""
    from ..experiments.history.store import add as add_entries
    from ..experiments.history.store import result_of
    from ..experiments.history.stored_result import files_of, is_run, read_entry

    counts: dict[str, int] = dict.fromkeys(("added", "replaced", "already there", "refused"), 0)
    failed: list[dict[str, str]] = []
    waiting: list[tuple[Path, Entry]] = []

    def refuse(path: Path, why: str) -> None:
        failed.append({"file": str(path), "message": why})
        say(f"error: {why}", to=err)

    def flush() -> None:
        outcomes = add_entries(history, [entry for _, entry in waiting], replace=options.replace)
        for (path, entry), outcome in zip(waiting, outcomes, strict=True):
            counts[outcome] += 1
            if outcome == "refused":
                refuse(path, str(_other_result(path, entry, result_of(history, entry.sha256))))
        waiting.clear()

    with opened(options.db, create=True) as history:
        paths = list(files_of(files))

        def held(sha256: str) -> tuple[str, str, datetime | None] | None:
            return None if options.replace else result_of(history, sha256)

        with progress("history") as tell:
            for number, path in enumerate(paths):
                tell(f"{number} of {len(paths)}", number / len(paths))
                try:
                    entry = read_entry(
                        path, held, serial=options.serial, when=options.when, seed=options.seed
                    )
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
        parts = [f"{count} {name}" for name, count in counts.items() if count or name == "added"]
        if unread := len(failed) - counts["refused"]:
            parts.append(f"{unread} not added")
        say(f"{', '.join(parts)}: {history.name}")
    raise typer.Exit(2 if failed or not paths else 0)


def _other_result(path: Path, entry: Entry, held: tuple[str, str, datetime | None] | None) -> BadInput:
    run = f"run {entry.run}, SHA-256 {entry.sha256[:12]}…"
    if held is not None and held[:2] != (entry.serial, entry.model):
        serial, model, _ = held
        return BadInput(
            f"the history has this run under another arm: serial {serial}, {model}",
            found=f"{run}, for serial {entry.serial}, {entry.model}",
            allowed="one arm for each run",
            remedy=f"if it is of {serial}, nothing is to be added; if not, no command moves it: begin a new"
            " history with --db, and add all results with their right --serial",
            file=path,
        )
    if held is not None and held[2] is not None and held[2] != entry.measured_at:
        run += f", of {held[2].isoformat()} (UTC) there, of {entry.measured_at.isoformat()} here"
    return BadInput(
        "the history has another result of the same run",
        found=run,
        allowed="one result of each run",
        remedy="--replace takes this one instead",
        file=path,
    )


@histories.of_options("list")
def list_arms(db: Url = None, as_json: Json = False) -> None:
    """List the arms with their last results; with --json every result."""
    from ..experiments.history.store import arms, message_of, results
    from ..reports.history.history_tables import arms_table, history_text

    with damage_named() as damaged, opened(db) as history:
        if as_json:
            stored = results(history, damaged=damaged)
            print_json_pieces(history_text((one, message_of(history, one.sha256)) for one in stored))
        else:
            rows = arms(history, damaged)
            table = arms_table(rows, [message_of(history, row.sha256) for row in rows])
            show_answer(False, rows, lambda: plain_page("", table))


@histories.of_options("show")
def show(serial: Serial, model: Model = None, db: Url = None, as_json: Json = False) -> None:
    """Show the results and events of an arm, in the order of time."""
    from ..experiments.history.arm_history import HistoryList
    from ..experiments.history.store import events, find_arm, message_of, results
    from ..reports.history.history_tables import events_table, results_table, worth

    with damage_named() as damaged:
        with opened(db) as history:
            arm = find_arm(history, serial, model)
            stored, logged = list(results(history, arm, damaged)), events(history, arm, damaged)
            judged = [message_of(history, one.sha256) for one in stored]
        answer = HistoryList(
            serial=arm[0], model=arm[1], results=tuple(map(worth, stored, judged)), events=tuple(logged)
        )
        blocks = results_table(stored, judged), events_table(logged)
        show_answer(as_json, answer, lambda: plain_page(", ".join(arm), *blocks))


@histories.of_options("event")
def event(
    serial: Serial,
    date: Annotated[str, Option("When it happened (ISO 8601).")],
    what: Annotated[
        What, Option("collision, motor (changed), mastering (new zeros in the controller) or other.")
    ],
    note: Annotated[str, Option("What is to be remembered of it.")] = "",
    model: Model = None,
    db: Url = None,
) -> None:
    """Log what happened to an arm."""
    from ..experiments.history.store import add_event, find_arm
    from ..experiments.history.stored_result import Event, moment

    with opened(db) as history:
        arm = find_arm(history, serial, model)
        new = add_event(history, Event(*arm, moment(date), what, note))
    say("logged" if new else "already there")


@histories.of_options("export")
def export(
    file: Annotated[Path, Option("File to write: .csv or .json.", "-o --out")],
    serial: Annotated[str | None, argument("Serial number of one arm.", metavar="[SERIAL]")] = None,
    model: Model = None,
    db: Url = None,
    force: Force = False,
) -> None:
    """Write the results as a table (a row for each offset) or as JSON."""
    from ..experiments.history.store import events, find_arm, message_of, results
    from ..model.files.whole_file import write_whole
    from ..reports.history.history_tables import history_text, offset_rows

    if file.suffix not in (".csv", ".json"):
        raise BadInput("no table of this kind is written", found=file.name, allowed=".csv or .json")
    with opened(db) as history:
        arm = None if serial is None else find_arm(history, serial, model)
        count = 0

        def counted_results() -> Iterator[StoredResult]:
            nonlocal count
            for count, result in enumerate(results(history, arm), start=1):  # noqa: B007 - told below
                yield result

        csv = file.suffix == ".csv"
        text = (
            csv_lines(offset_rows(counted_results()))
            if csv
            else history_text(
                ((one, message_of(history, one.sha256)) for one in counted_results()), events(history, arm)
            )
        )
        write_whole(file, text, force=force)
    say(f"{count} results: {file}")


def _by_arm(of_all: Iterable[OfArm]) -> dict[tuple[str, str], list[OfArm]]:
    by_arm: dict[tuple[str, str], list[OfArm]] = {}
    for one in of_all:
        by_arm.setdefault((one.serial, one.model), []).append(one)
    return by_arm


@histories.of_options("drift")
def drift(
    serial: SerialOrAll = None,
    tolerance_mm: ToleranceMm = 0.5,
    model: Model = None,
    db: Url = None,
    as_json: Json = False,
) -> None:
    """Which changes of the offsets are real, how fast they walk, and when the next calibration is due."""
    from ..experiments.history.arm_history import arm_drift
    from ..experiments.history.fleet_drift import DriftOfArms, drift_of_each, fleet_drift
    from ..experiments.history.store import events, find_arm, results
    from ..reports.history.history_tables import arms_drift_table, drift_blocks, fleet_blocks

    with opened(db) as history, progress("drift") as tell:
        arm, fleet = None, None
        if serial is None:
            stored, logged = _by_arm(results(history)), _by_arm(events(history))
            jobs = [(each, of_arm, logged.get(each, [])) for each, of_arm in stored.items()]
            drifts = drift_of_each(jobs, tolerance_mm, lambda stage, share: tell(stage, share / 2))
            fleet = fleet_drift(drifts, lambda stage, share: tell(stage, (1 + share) / 2))
        else:
            arm = find_arm(history, serial, model)
            tell(serial, 0.0)
            drifts = [arm_drift(arm, list(results(history, arm)), events(history, arm), tolerance_mm)]
    blocks = drift_blocks(drifts[0]) if fleet is None else (arms_drift_table(drifts), *fleet_blocks(fleet))
    answer = DriftOfArms(arms=tuple(drifts), fleet=fleet)
    show_answer(as_json, answer, lambda: plain_page(", ".join(arm or ()), *blocks))


@histories.of_options("report")
def report(
    folder: Annotated[Path, Option("Folder for the pages.", "-o --out")],
    options: HistoryPageOptions,
    as_json: Json = False,
) -> None:
    """Write the page of an arm, or of all arms with a page for each: HTML, PDF, JSON, CSV."""
    from ..experiments.history.arm_history import ArmHistory, arm_drift
    from ..experiments.history.store import arms, events, find_arm, message_of, results
    from ..experiments.history.stored_result import moment
    from ..model.records import to_json
    from ..reports.history.history_folder import (
        ARM_PAGE,
        FLEET_PAGE,
        arm_document,
        check_arm_target,
        check_fleet_target,
        write_arm,
        write_fleet,
    )
    from ..reports.history.history_pages import arm_headline, fleet_headline

    serial, tolerance_mm, model = options.serial, options.tolerance_mm, options.model
    when = None if options.as_of is None else moment(options.as_of)
    (check_fleet_target if serial is None else check_arm_target)(folder)
    with opened(options.db) as history, progress("report") as tell:
        every = arms(history)
        when = when or max((arm.last for arm in every if arm.last is not None), default=None)

        def of(arm: tuple[str, str]) -> ArmHistory:
            stored, logged = tuple(results(history, arm)), tuple(events(history, arm))
            judged = tuple(
                message_of(history, one.sha256) if one.verdict == "pass" else None for one in stored
            )
            drift = arm_drift(arm, stored, logged, tolerance_mm)
            return ArmHistory(arm=drift, results=stored, judged=judged, events=logged, asked=when)

        if serial is not None:
            arm_history = of(find_arm(history, serial, model))
            tell("writing", 0.5)
            write_arm(folder, arm_history)
            summary, page = arm_headline(arm_history), ARM_PAGE
            answer = arm_document(arm_history)
        else:
            named = [(one.serial, one.model) for one in every if model in (None, one.model)]
            fleet = write_fleet(folder, named, of, tolerance_mm, when, tell)
            summary, page, answer = fleet_headline(fleet), FLEET_PAGE, to_json(fleet)
    if as_json:
        print_json(answer)
    else:
        say(f"{summary.word}. {summary.sentence}")
        say(f"Report: {folder / page}")


VARIABLE = "ZEROBEAM_KEY_PASSPHRASE"
_LONGEST = 1000  # bytes of a passphrase


@histories.of_options("certify")
def certify(
    serial: Serial,
    private: Annotated[Path, Option("Private key to sign with.", "--key", metavar="FILE")],
    folder: Annotated[Path, Option("Folder for the certificate.", "-o --out")],
    run: Annotated[str | None, Option("The run, by the beginning of its SHA-256.", metavar="SHA256")] = None,
    date: Annotated[str | None, Option("The run, by its date or time (ISO 8601). Default: the last.")] = None,
    verification: Annotated[
        Path | None,
        Option(
            "Report of the corrected robot (zerobeam verify -o DIR): the certificate states it as left.",
            metavar="DIR",
        ),
    ] = None,
    model: Model = None,
    db: Url = None,
) -> None:
    """Write a certificate of a result (JSON, HTML, PDF), each file signed."""
    from ..experiments.history.certified import grouped, private_key, require_library

    require_library()
    with opened(db) as history:
        from ..experiments.history.store import choose, find_arm, results, whole_answer
        from ..reports.history.certificate import write_certificate

        stored = choose(list(results(history, find_arm(history, serial, model))), run, date)
        result = whole_answer(history, stored)
        today = datetime.now().astimezone().date()
        signing = private_key(private, _passphrase)
        by = write_certificate(folder, stored, result, signing, today, verification)
    verdict = f"verdict {stored.verdict}{', simulated' * stored.simulated}"
    say(f"Certificate of {stored.run}, {stored.measured_at:%Y-%m-%d}, {verdict}: {folder}")
    say(f"Signed by: {grouped(by)}")


@histories.of_options("key")
def key(
    file: Annotated[Path, argument("File for the private key; the public one is FILE.pub.")],
    passphrase: Annotated[
        bool, Option(f"Encrypt the private key: the passphrase is asked for, or taken from {VARIABLE}.")
    ] = False,
) -> None:
    """Make a pair of keys (Ed25519) to sign certificates with; no file is ever replaced."""
    from ..experiments.history.certified import grouped, make_key, public_file, require_library

    require_library()
    made = make_key(file, _passphrase(twice=True) if passphrase else None)
    if passphrase:
        say(f"Private key, encrypted: {file}. Keep it to yourself.")
    else:
        say(f"Private key: {file}. Keep it to yourself: whoever can read it can sign.")
    say(f"Public key: {public_file(file)}. Give it to whoever is to verify.")
    say(f"Fingerprint: {grouped(made)}")


@histories.of_options("verify")
def verify(
    files: Annotated[
        list[Path],
        argument(
            "Signed files (the signature is beside each, FILE.sig), or folders of certificates.",
            metavar="FILE...",
        ),
    ],
    public: Annotated[Path, Option("Public key of the signer (.pub).", "--key", metavar="FILE")],
    db: Annotated[
        str | None,
        Option("A history (SQLite file or URL): does it still hold the certified results?", metavar="URL"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check the signatures of certificates, whether the files of each state one result, and with --db whether
    the history still holds it."""
    from ..experiments.history.certified import (
        fingerprint,
        grouped,
        public_key,
        read_signed,
        require_library,
        why_not_signed,
    )
    from ..model.records import to_json
    from ..reports.history.certificate import SignatureChecks, files_of_certificate

    require_library()
    by = public_key(public)
    read = {file: read_signed(file) for path in files for file in files_of_certificate(path)}
    checks = [_verdict(file, why_not_signed(*signed, by)) for file, signed in read.items()]
    signed = {
        file: content for (file, (content, _)), row in zip(read.items(), checks, strict=True) if row.valid
    }
    checks += _of_one_result(signed)
    if db is not None:
        checks += _against_history(db, list(read), signed)
    if as_json:
        print_json(to_json(SignatureChecks(fingerprint=fingerprint(by), checks=tuple(checks))))
    else:
        say(f"Key: {grouped(fingerprint(by))}")
        for row in checks:
            words = f"NOT VALID: {row.reason}" if not row.valid else "valid"
            say(f"{row.file}, {row.check}: {words}")
    raise typer.Exit(0 if all(row.valid for row in checks) else 1)


def _verdict(
    file: Path, reason: str | None, check: Literal["signature", "certificate", "history"] = "signature"
) -> SignatureCheck:
    from ..reports.history.certificate import SignatureCheck

    return SignatureCheck(file=str(file), check=check, valid=reason is None, reason=reason)


def _of_one_result(signed: dict[Path, bytes]) -> list[SignatureCheck]:
    """Of each file beside a certificate.json whether it is of that certificate."""
    from ..reports.history.certificate import JSON, read_certificate, why_not_of_certificate

    beside = {
        file.parent: read_certificate(content, file) for file, content in signed.items() if file.name == JSON
    }
    return [
        _verdict(file, why_not_of_certificate(beside[file.parent], file.name, content), "certificate")
        for file, content in signed.items()
        if file.parent in beside and file.name != JSON
    ]


def _against_history(db: str, files: list[Path], signed: dict[Path, bytes]) -> list[SignatureCheck]:
    """Of each certificate.json whether the history agrees; what is not signed is not asked about."""
    from ..reports.history.certificate import read_certificate, why_history_differs

    if not any(file.suffix == ".json" for file in files):
        raise BadInput(
            "none of the files can be held against a history",
            found=", ".join(map(str, files)),
            allowed="a certificate.json among them",
        )
    with opened(db) as history:
        return [
            _verdict(file, why_history_differs(history, read_certificate(content, file)), "history")
            for file, content in signed.items()
            if file.suffix == ".json"
        ]


def _passphrase(*, twice: bool = False) -> str:
    """From the environment, or asked for on the terminal."""
    passphrase = os.environ.get(VARIABLE)
    if passphrase is None:
        if not sys.stdin.isatty():
            raise BadInput(
                "the private key needs its passphrase, and there is no terminal to ask for it",
                remedy=f"state it in the environment variable {VARIABLE}",
            )
        passphrase = _typed("Passphrase of the private key: ")
        if twice and _typed("Again: ") != passphrase:
            raise BadInput("the two passphrases differ", remedy="the same command asks again")
    if not 0 < len(passphrase.encode()) <= _LONGEST:
        raise BadInput(
            "the passphrase cannot be used",
            found=f"{len(passphrase.encode())} bytes",
            allowed=f"1 to {_LONGEST} bytes",
        )
    return passphrase


def _typed(question: str) -> str:
    try:
        return getpass.getpass(question)
    except EOFError:  # Ctrl-D
        return ""
