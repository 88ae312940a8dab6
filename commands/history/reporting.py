"""`zerobeam history drift`: what the results of years say together."""

from __future__ import annotations

from typing import Annotated

import typer

from ..console import out, plain, print_json, progress
from ..options import Json
from .shared import Model, Url, opened


def drift(
    serial: Annotated[
        str | None,
        typer.Argument(help="Serial number of one arm (all).", metavar="[SERIAL]", show_default=False),
    ] = None,
    tolerance_mm: Annotated[
        float, typer.Option("--tolerance-mm", min=1e-6, max=1e6, help="TCP error that is tolerated, mm.")
    ] = 0.5,
    model: Model = None,
    db: Url = None,
    as_json: Json = False,
) -> None:
    """Which changes of the offsets are real, how fast they walk, and when the next calibration is due."""
    from ...experiments.history.arm_drift import arm_drift
    from ...experiments.history.store import arms, events, find_arm, results
    from ...reports.history.drift_text import SCHEMA, arms_drift_table, drift_blocks, drift_json
    from ...reports.style.console import print_block

    found = []
    with opened(db) as history, progress("drift") as tell:
        every = (
            [(own.serial, own.model) for own in arms(history) if own.results]
            if serial is None
            else [find_arm(history, serial, model)]
        )
        for number, arm in enumerate(every):
            tell(arm[0], number / len(every))
            found.append(arm_drift(list(results(history, arm)), events(history, arm), tolerance_mm))
    if as_json:
        print_json({"schema": SCHEMA, "arms": [drift_json(own) for own in found]})
    elif serial is None:
        print_block(out, arms_drift_table(found))
    else:
        for own in found:
            out.print(f"{plain(own.serial)}, {plain(own.model)}", markup=False, highlight=False)
            for block in drift_blocks(own):
                print_block(out, block)
