"""The page of all arms: the gravest first, all of them counted, no foreign file lost."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from arms_over_years import FIRST, arm_history, over_years
from pages import Page

from zerobeam.analysis.answer.answer_message import Action, May, Message
from zerobeam.experiments.history.arm_drift import NOT_SOON, Due
from zerobeam.experiments.history.arm_history import STATES, ArmHistory, ArmState, State
from zerobeam.experiments.history.fleet_drift import Fleet, fleet_drift
from zerobeam.model.errors import BadInput
from zerobeam.reports.history import history_folder
from zerobeam.reports.history.fleet_page import (
    MOST_ROWS,
    due_bars,
    due_counts,
    fleet_page,
    headline,
)
from zerobeam.reports.history.history_folder import write_arm, write_fleet
from zerobeam.reports.history.history_tables import fleet_blocks
from zerobeam.reports.output.html import html
from zerobeam.reports.style.blocks import Table

AS_OF = datetime(2026, 4, 15)
PASSED = Message("Pass", None, None, Action("", None), (), grade="pass", may=May(True, True, True))
Arm = tuple[str, str]


def row(serial: str, state: State = "on schedule", due: datetime | None = None, reason: str = "") -> ArmState:
    return ArmState(
        serial=serial,
        model="irb1600",
        state=state,
        results=3,
        counted=3,
        last=FIRST,
        verdict="pass",
        judged=PASSED,
        jumps=0,
        next_due=Due(0.5, due, reason),
    )


def fleet(*rows: ArmState) -> Fleet:
    arms = tuple(sorted(rows, key=lambda own: own.order))
    return Fleet(tolerance_mm=0.5, drift=fleet_drift([]), arms=arms, asked=AS_OF)


def pages(found: Fleet) -> dict[Arm, str]:
    return {(own.serial, own.model): own.page for own in found.arms if own.page is not None}


def plant(given: dict[str, ArmHistory]) -> tuple[list[Arm], Callable[[Arm], ArmHistory]]:
    return [(serial, "irb1600") for serial in given], lambda arm: given[arm[0]]


def written(folder: Path, given: dict[str, ArmHistory]) -> Fleet:
    arms, of = plant(given)
    return write_fleet(folder, arms, of, 0.5, AS_OF, lambda stage, share: None)


def test_what_is_assumed_of_all_arms_is_not_shown_as_measured() -> None:
    """J6 rests on the laser's mounting in every result: so do its drift, its biases and its jumps."""
    of_arms = [
        arm_history(over_years(6, serial=serial, jump=(3, 4, 9.0), psd=psd))
        for serial, psd in (("A", "old"), ("B", "new"))
    ]
    together = fleet_drift([own.arm for own in of_arms])
    models, fastest = [block for block in fleet_blocks(together) if isinstance(block, Table)][:2]
    for table, column in ((models, 0), (fastest, 1)):
        cells = [row.cells[column] for row in table.rows]
        assert {cell.mark for cell in cells if cell.text == "J6 (δ6)"} == {"assumed"}
        assert {cell.mark for cell in cells if cell.text != "J6 (δ6)"} == {""}
    words = "J6 (δ6): assumed. Its drift is the arms' only if tool and instrument were not mounted anew."
    assert words in [getattr(block, "text", "") for block in fleet_blocks(together)]
    page = fleet_page(
        Fleet(tolerance_mm=0.5, drift=together, arms=tuple(own.row for own in of_arms), asked=AS_OF)
    )
    assert "J6 (δ6) (assumed), " in Page(html(page, {}, "study")).words


def test_the_gravest_come_first() -> None:
    early, late = AS_OF + timedelta(days=40), AS_OF + timedelta(days=400)
    own = fleet(
        row("fine", due=late),
        row("sooner", due=early),
        row("none", "no due date", reason="fewer than two results count"),
        row("bad", "misfit", reason="fewer than two results count"),
        row("known", "jump", due=late),
        row("unknown", "jump without event", due=late),
        row("now", "overdue", due=AS_OF),
    )
    page = Page(html(fleet_page(own), {}, "study"))
    names = [one[0] for one in page.rows if len(one) == 6][1:]
    assert names == ["now", "unknown", "known", "bad", "none", "sooner", "fine"]
    assert list(own.states) == list(STATES)
    assert headline(own).word == "Calibrate now"
    assert "1 overdue, 1 jump without event, 1 jump, 1 misfit, 1 no due date, 2 on schedule" in page.words
    assert page.row("fewer than two results count")[1:] == ["2", "bad and none"]
    assert headline(fleet(row("fine", due=late))).key == "pass"


def test_no_arm_is_a_page_too(tmp_path: Path) -> None:
    found = written(tmp_path / "out", {})
    assert headline(found).word == "No arms"
    page = Page((tmp_path / "out" / "fleet.html").read_text(encoding="utf-8"))
    assert "The history has no arm yet" in page.words
    assert json.loads((tmp_path / "out" / "fleet.json").read_text())["arms"] == []
    assert (tmp_path / "out" / "fleet.pdf").read_bytes().startswith(b"%PDF")


def test_every_arm_leads_to_its_page(tmp_path: Path) -> None:
    serials = ("A-1", "<script>", "Ж" * 99)
    given = {serial: arm_history(over_years(1, serial=serial)) for serial in serials}
    out = tmp_path / "out"
    found = written(out, given)
    page = Page((out / "fleet.html").read_text(encoding="utf-8"))
    links = [str(a["href"]) for tag, a in page.tags if tag == "a" and "href" in a]
    assert len(links) == 3
    for link in links:
        assert (out / link).is_file()
    assert set(links) == set(pages(found).values())
    assert not page.scripts
    rows = list(csv.DictReader((out / "fleet.csv").read_text(encoding="utf-8").splitlines()))
    answer = json.loads((out / "fleet.json").read_text(encoding="utf-8"))
    assert [one["serial"] for one in rows] == [one["serial"] for one in answer["arms"]]
    assert {one["page"] for one in answer["arms"]} == set(links)
    assert written(out, given).arms == found.arms  # over its own


@pytest.mark.long
def test_models_and_instruments_are_on_the_page(tmp_path: Path) -> None:
    given = {
        serial: arm_history(over_years(4, serial=serial, psd=psd))
        for serial, psd in (("A", "no. 1"), ("B", "no. 1"), ("C", "no. 2"))
    }
    out = tmp_path / "out"
    written(out, given)
    text = Page((out / "fleet.html").read_text(encoding="utf-8")).words
    answer = json.loads((out / "fleet.json").read_text(encoding="utf-8"))["drift"]
    assert [own["arms"] for own in answer["models"]] == [3] * 5
    assert "A bias that all instruments have in common is never determined." in text
    assert text.index("All arms") < text.index("Models, joints and instruments")


def test_every_row_of_every_table_has_a_cell_for_each_column() -> None:
    arms = [arm_history(over_years(3, serial=serial, psd="no. 1")).arm for serial in ("A", "B")]
    alone = fleet_drift(arms)
    biased = replace(alone, models=tuple(replace(own, biased=("no. 2",)) for own in alone.models))
    for found in (alone, biased):
        for block in fleet_blocks(found):
            if isinstance(block, Table):
                assert {len(own.cells) for own in block.rows} == {len(block.columns)}, block.caption


def test_what_is_not_ours_in_the_folder_of_the_arms_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    given = {"A-1": arm_history(over_years(1))}
    found = written(out, given)
    (page,) = pages(found).values()
    for name in ("arms/mine.txt", str(Path(page).parent / "mine.txt")):
        (out / name).write_text("keep")
        with pytest.raises(BadInput, match=r"mine\.txt|other things"):
            written(out, given)
        assert (out / name).read_text() == "keep"
        (out / name).unlink()
    written(out, given)


def test_of_more_than_a_thousand_the_gravest_have_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_folder, "MOST_ROWS", 2)
    given = {f"A-{n}": arm_history(over_years(1, serial=f"A-{n}")) for n in range(3)}
    given["A-3"] = arm_history(over_years(2, serial="A-3", misfits=(0, 1)))
    found = written(tmp_path / "out", given)
    assert len(list((tmp_path / "out" / "arms").iterdir())) == 2
    assert [one.serial for one in found.arms] == ["A-3", "A-0", "A-1", "A-2"]
    assert set(pages(found)) == {("A-3", "irb1600"), ("A-0", "irb1600")}
    assert len(json.loads((tmp_path / "out" / "fleet.json").read_text())["arms"]) == 4


def test_the_page_is_bounded() -> None:
    own = fleet(*(row(f"A-{n}", "no due date", reason=f"reason {n}") for n in range(MOST_ROWS + 5)))
    page = Page(html(fleet_page(own), {}, "study"))
    assert len([one for one in page.rows if len(one) == 6]) == MOST_ROWS + 1
    assert "The first 1,000 of 1,005: fleet.csv and fleet.json have all" in page.words
    assert len([one for one in page.rows if one[0].startswith("reason")]) == 50


def test_due_dates_are_counted_by_month() -> None:
    rows = [
        row("a", "overdue", AS_OF - timedelta(days=3)),
        row("b", due=datetime(2026, 4, 30)),
        row("c", due=datetime(2028, 3, 31)),
        row("d", due=datetime(2028, 4, 1)),
        row("e", reason=NOT_SOON),
        row("f", "no due date", reason="fewer than two results count"),
        row("g", "jump", due=datetime(2026, 5, 1)),
    ]
    overdue, months, later = due_counts(rows, AS_OF)
    assert (overdue, later) == (1, 2)
    assert [month for month in months if month[2]] == [(2026, 4, 1), (2026, 5, 1), (2028, 3, 1)]
    assert len(months) == 24
    bars = due_bars(fleet(*rows))
    assert bars is not None
    assert [(bar.name, bar.value) for bar in bars.rows] == [
        ("overdue", 1),
        ("Apr 2026", 1),
        ("May 2026", 1),
        ("Mar 2028", 1),
        ("later", 2),
    ]
    assert due_bars(fleet(*rows[5:6])) is None


@pytest.mark.long
def test_several_processes_write_the_same_pages_as_one(tmp_path: Path) -> None:
    given = {f"A-{n}": arm_history(over_years(3, serial=f"A-{n}", walk=0.01)) for n in range(9)}
    found = written(tmp_path / "all", given)
    for (serial, _), page in pages(found).items():
        alone = tmp_path / "alone" / serial
        write_arm(alone, given[serial])
        for path in sorted(alone.rglob("*.*")):
            assert (
                (tmp_path / "all" / page).parent / path.relative_to(alone)
            ).read_bytes() == path.read_bytes()
