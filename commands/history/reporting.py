"""`zerobeam history drift` and `report`: what the results of years say together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..console import out, plain, print_json, progress
from ..options import Json
from .shared import Model, Url, opened

if TYPE_CHECKING:
    from datetime import datetime

    from ...experiments.history.database import Database
    from ...reports.history.arm_page import ArmHistory

_SerialOrAll = Annotated[
    str | None,
    typer.Argument(help="Serial number of one arm (all).", metavar="[SERIAL]", show_default=False),
]
_Tolerance = Annotated[
    float, typer.Option("--tolerance-mm", min=1e-6, max=1e6, help="TCP error that is tolerated, mm.")
]


def drift(
    serial: _SerialOrAll = None,
    tolerance_mm: _Tolerance = 0.5,
    model: Model = None,
    db: Url = None,
    as_json: Json = False,
) -> None:
    """Which changes of the offsets are real, how fast they walk, and when the next calibration is due."""
    from ...experiments.history.arm_drift import arm_drift
    from ...experiments.history.fleet_drift import drift_of_each, fleet_drift
    from ...experiments.history.store import arms, events, find_arm, results
    from ...reports.history.drift_text import SCHEMA, arms_drift_table, drift_blocks, drift_json
    from ...reports.history.fleet_text import fleet_blocks, fleet_drift_json
    from ...reports.style.console import print_block

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
    from ...experiments.history.entry import moment
    from ...experiments.history.store import arms, find_arm
    from ...reports.history.arm_page import headline as arm_headline
    from ...reports.history.fleet_page import headline as fleet_headline
    from ...reports.history.history_folder import (
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
    from ...experiments.history.arm_drift import arm_drift
    from ...experiments.history.store import events, results
    from ...reports.history.arm_page import ArmHistory

    found, happened = tuple(results(history, arm)), tuple(events(history, arm))
    return ArmHistory(arm_drift(arm, found, happened, tolerance_mm), found, happened, as_of)
