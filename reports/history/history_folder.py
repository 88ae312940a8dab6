"""The folders of a history: an arm's page, and that of all arms with a folder for each."""

from __future__ import annotations

import hashlib
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from ...experiments.history.arm_history import ARM_SCHEMA, ArmDrift, ArmHistory, ArmState
from ...experiments.history.fleet_drift import FLEET_SCHEMA, Fleet, fleet_drift
from ...experiments.processes import side_by_side
from ...model.records import to_json
from ..output import whole_folder
from ..output.whole_folder import LITTER, FolderContents, Kind, write_answer, write_files, write_folder
from .history_pages import MOST_ROWS, arm_headline, arm_page, fleet_page
from .history_tables import offset_rows
from .trend_figure import trend_pictures

ARM_PAGE, FLEET_PAGE = "arm.html", "fleet.html"
_ARM_TABLE, _FLEET_TABLE, _ARMS = "offsets.csv", "fleet.csv", "arms"
_ARM = Kind.of_answer("page of an arm", "arm.json", ARM_SCHEMA, _ARM_TABLE)
_FLEET = Kind.of_answer("page of all arms", "fleet.json", FLEET_SCHEMA, _FLEET_TABLE, _ARMS)
_LONGEST_NAME = 40
_SEVERAL = 8  # arms: fewer are written sooner than processes start
_OF_ARMS = 0.9  # of the time: the pages of the arms


def write_arm(folder: Path, history: ArmHistory) -> None:
    """Write arm.html, arm.pdf, arm.json, offsets.csv and the figures. Raises as `write_answer`."""
    write_answer(folder, _ARM, _of_arm(history))


def write_fleet(
    folder: Path,
    arms: Sequence[tuple[str, str]],
    of: Callable[[tuple[str, str]], ArmHistory],
    tolerance_mm: float,
    as_of: datetime | None,
    tell: Callable[[str, float], None],
) -> Fleet:
    """Write fleet.html, fleet.pdf, fleet.json and fleet.csv, and in arms/ a page for each of the `arms`; of
    more than 1,000, for the gravest. `of` gives an arm by serial number and model.

    One arm is in memory as a whole at a time, and of each what their fleet's drift needs. Whole or not at
    all, as `write_arm`.
    """
    check_fleet_target(folder)
    return write_folder(
        folder, _FLEET, lambda new_folder: _write_fleet(new_folder, arms, of, tolerance_mm, as_of, tell)
    )


def check_arm_target(folder: Path) -> None:
    """Raise BadInput unless the page of an arm may be written to `folder`."""
    whole_folder.check_target(folder, _ARM)


def check_fleet_target(folder: Path) -> None:
    """Raise BadInput unless the page of all arms may be written to `folder`, what is in arms/ included."""
    whole_folder.check_target(folder, _FLEET)
    inside = folder / _ARMS
    if inside.is_dir():
        for path in sorted(inside.iterdir()):
            if path.name not in LITTER:
                whole_folder.check_target(path, _ARM)


def arm_document(history: ArmHistory) -> Any:
    """`arm.json` of an arm."""
    return to_json(history, {ArmHistory: {"headline": lambda one: arm_headline(one).sentence}})


def state_row(state: ArmState) -> dict[str, object]:
    """A row of fleet.csv."""
    row = to_json(state)
    jump, due = row.pop("clearest_jump") or {}, row.pop("due")
    del row["page"]
    return {
        **row,
        "clearest_jump": jump.get("offset"),
        "clearest_jump_before": jump.get("before"),
        "clearest_jump_p": jump.get("p_value"),
        "due": due["date"],
        "due_reason": due["reason"],
    }


def safe_name(serial: str, model: str) -> str:
    """A folder's name for an arm: what is plain of its serial number, and a hash that no two arms share."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "-", serial)[:_LONGEST_NAME].strip("-")
    digest = hashlib.sha256(f"{serial}\0{model}".encode()).hexdigest()[:12]
    return f"{plain}-{digest}" if plain else digest


def _of_arm(history: ArmHistory) -> FolderContents:
    pictures = trend_pictures(history.arm, history.events, history.undetermined)
    tables = {_ARM_TABLE: offset_rows(history.results)}
    return FolderContents(arm_document(history), arm_page(history), pictures, tables)


def _write_fleet(
    folder: Path,
    arms: Sequence[tuple[str, str]],
    of: Callable[[tuple[str, str]], ArmHistory],
    tolerance_mm: float,
    as_of: datetime | None,
    tell: Callable[[str, float], None],
) -> Fleet:
    rows: list[ArmState] = []
    drifts: list[ArmDrift] = []
    few = len(arms) <= MOST_ROWS

    def every() -> Iterator[ArmHistory]:
        for number, arm in enumerate(arms):
            tell(f"{number} of {len(arms)}", _OF_ARMS * number / len(arms) / (1 if few else 2))
            history = of(arm)
            rows.append(history.row)
            drifts.append(history.arm.without_states())
            yield history

    def gravest() -> Iterator[ArmHistory]:
        for number, row in enumerate(shown):
            tell(f"page {number} of {len(shown)}", _OF_ARMS * (0.5 + number / len(shown) / 2))
            yield of((row.serial, row.model))

    if few:
        _write_beside(folder, every(), len(arms))
    else:
        deque(every(), maxlen=0)
    rows.sort(key=lambda row: row.order)
    shown = rows[:MOST_ROWS]
    if not few:
        _write_beside(folder, gravest(), len(shown))
    pages = [f"{_ARMS}/{safe_name(row.serial, row.model)}/{ARM_PAGE}" for row in shown]
    drift = fleet_drift(drifts, lambda stage, share: tell(stage, _OF_ARMS + (1 - _OF_ARMS) * share))
    leading = (replace(row, page=page) for row, page in zip(shown, pages, strict=True))
    fleet = Fleet(tolerance_mm=tolerance_mm, drift=drift, arms=(*leading, *rows[MOST_ROWS:]), asked=as_of)
    tables = {_FLEET_TABLE: map(state_row, fleet.arms)}
    contents = FolderContents(to_json(fleet), fleet_page(fleet), tables=tables)
    write_files(folder, _FLEET, contents)
    return fleet


def _write_beside(folder: Path, arms: Iterator[ArmHistory], count: int) -> None:
    """The pages of arms, by several processes where it is worth starting them."""
    jobs = ((folder / _ARMS / safe_name(one.arm.serial, one.arm.model), one) for one in arms)
    with closing(side_by_side(_written, jobs, None if count >= _SEVERAL else 1)) as done:
        deque(done, maxlen=0)


def _written(job: tuple[Path, ArmHistory]) -> None:
    folder, history = job
    folder.mkdir(parents=True)
    write_files(folder, _ARM, _of_arm(history))
