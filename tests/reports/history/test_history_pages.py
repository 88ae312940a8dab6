"""The page of all arms: the gravest first, all of them counted, no foreign file lost."""

import csv
import json
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, time, timedelta
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arms_over_years import FIRST, LOST, arm_history, happened, over_years
from chromium import PAPER, PHONE, Size, chromium
from matplotlib.dates import date2num
from pages import Page, assert_fetches_nothing

from zerobeam.analysis.answer.answer_message import Action, May, Message
from zerobeam.experiments.history.arm_history import NOT_SOON, STATES, ArmHistory, ArmState, Due, State
from zerobeam.experiments.history.fleet_drift import Fleet, fleet_drift
from zerobeam.model.errors import BadInput
from zerobeam.reports.history import history_folder
from zerobeam.reports.history.history_folder import arm_document, safe_name, write_arm, write_fleet
from zerobeam.reports.history.history_pages import (
    MOST_ROWS,
    arm_headline,
    arm_page,
    calibrations,
    due_bars,
    due_counts,
    fleet_headline,
    fleet_page,
)
from zerobeam.reports.history.history_tables import (
    arms_drift_table,
    drift_blocks,
    fleet_blocks,
    results_table,
)
from zerobeam.reports.history.trend_figure import _dates, offset_panel, trend_pictures
from zerobeam.reports.output.html import html
from zerobeam.reports.style.blocks import Paragraph, Table
from zerobeam.reports.style.canvas import Picture
from zerobeam.reports.style.theme import light
from zerobeam.words import numbers

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
    assert fleet_headline(own).word == "Calibrate now"
    assert "1 overdue, 1 jump without event, 1 jump, 1 misfit, 1 no due date, 2 on schedule" in page.words
    assert page.row("fewer than two results count")[1:] == ["2", "bad and none"]
    assert fleet_headline(fleet(row("fine", due=late))).key == "pass"


def test_no_arm_is_a_page_too(tmp_path: Path) -> None:
    found = written(tmp_path / "out", {})
    assert fleet_headline(found).word == "No arms"
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


LABEL = "J3 (δ3)"


@cache
def pictures(own: ArmHistory) -> dict[str, Picture]:
    return {one.name: one for one in trend_pictures(own.arm, own.events, own.undetermined)}


def shown(own: ArmHistory, *, drawn: bool = False) -> Page:
    return Page(html(arm_page(own), pictures(own) if drawn else {}, "study"))


def points(svg: str) -> int:
    """How many results are drawn: marks of what is identified or assumed, each less its legend's one."""
    inks = map(light, ("identified", "assumed"))
    drawn = [len(re.findall(rf'<use [^>]*style="fill: {ink}; stroke: {ink}', svg)) for ink in inks]
    return sum(max(count - 1, 0) for count in drawn)


def test_what_is_assumed_is_not_shown_as_measured() -> None:
    """However many results there are, an offset that each of them knows by an assumption is assumed."""
    own = arm_history(over_years(3))
    (row,) = [row for row in own.results[0].offsets if row.status == "assumed"]
    assert {one.name: one.status for one in own.arm.offsets if one.status != "identified"} == {
        row.name: "assumed"
    }
    page = arm_page(own)
    (table,) = [one for one in page.sections[2].all if isinstance(one, Table)]
    assert [one.cells[1].mark for one in table.rows] == ["", "", "", "", "assumed"]
    assert "J6 (δ6): assumed. What was assumed is the same in every result" in shown(own).words
    band = light("assumed")
    assert f"fill: {band}; fill-opacity" in pictures(own)["trend"].svg


def test_simulated_results_are_said_to_be_and_count_where_no_other_is() -> None:
    """list, show, drift, the page of an arm and the certificate's headline said a plain pass."""
    results = tuple(replace(one, simulated=True) for one in over_years(3))
    own = arm_history(results)
    page = arm_page(own)
    assert page.band == "Simulated: no robot was measured"
    assert (page.verdict.key, page.verdict.word) == ("held", "Simulated: on schedule")
    verdicts = [one.cells[1].text for one in calibrations(own).rows]
    assert verdicts == ["Simulated: pass"] * 3
    assert next(iter(drift_blocks(own.arm))) == Paragraph("Simulated: no robot was measured.")
    assert "Simulated: pass" in str(results_table(results, own.judged))
    assert "Simulated: " in str(arms_drift_table([own.arm]).rows)
    assert arm_document(own)["results"][0]["simulated"] is True
    # In the history of an arm that was measured they have no part in its drift.
    mixed = arm_history((*results[:2], *over_years(4)[2:]))
    assert [one.simulated for one in mixed.arm.used] == [False, False]
    assert [one.reason for one in mixed.arm.left_out] == [
        "simulated, and other results are not: no robot was measured"
    ] * 2
    assert "Simulated" not in arm_headline(mixed).word
    other = arm_history(over_years(3, serial="A-2"))
    together = fleet_drift([own.arm, other.arm])
    assert [one.serial for one in together.arms] == ["A-2"]


@pytest.mark.parametrize(("offset", "said"), [(-1, True), (0, False)])
def test_a_change_of_what_is_assumed_may_be_that_of_its_mounting(offset: int, said: bool) -> None:
    page = arm_page(arm_history(over_years(4, jump=(2, offset, 1.0))))
    notes = [note for note in page.notes if "mounted anew" in note]
    assert (
        notes
        == ["J6 (δ6): assumed. Its change is the arm's only if tool and instrument were not mounted anew"]
        * said
    )


@pytest.mark.long
def test_the_due_date_comes_first_and_every_calibration_is_listed() -> None:
    own = arm_history(over_years(6, walk=0.01, psd="Hamamatsu 17", who="J. Doe"))
    due = own.arm.due
    assert due is not None
    said = arm_headline(own)
    assert (said.key, said.word) == ("pass", "On schedule")
    assert f"Next calibration due: {due:%Y-%m-%d}" in said.sentence
    page = shown(own, drawn=True)
    assert page.words.index(f"{due:%Y-%m-%d}") < page.words.index("Calibrations")
    dates = [row[0] for row in page.rows if row[1:2] == ["Pass"]]
    assert dates == [f"{one.measured_at:%Y-%m-%d}" for one in reversed(own.results)]
    assert page.row(dates[0])[3:] == ["Hamamatsu 17", "J. Doe", own.results[0].document_sha256[:10]]
    assert f"due {due:%Y-%m-%d}" in page.words
    assert_fetches_nothing(page)


@pytest.mark.long
def test_a_result_has_no_point_for_what_it_does_not_determine() -> None:
    whole, partly = (arm_history(over_years(6, walk=0.01, lost=lost)) for lost in ((), (2, 3)))
    of_whole, of_partly = (pictures(own)["trend"] for own in (whole, partly))
    assert (points(of_whole.svg), points(of_partly.svg)) == (6 * 5, 6 * 5 - 2)
    assert f"{LABEL} in 4 results" in of_partly.alt
    (row,) = [row for row in shown(partly).rows if row[0] == f"{partly.results[3].measured_at:%Y-%m-%d}"]
    assert row[1:3] == ["Degenerate", f"{LABEL} not determined"]


@pytest.mark.parametrize("lost", [(), (2, 3, 4, 5)], ids=str)
@pytest.mark.long
def test_no_band_is_cut_off(lost: tuple[int, ...]) -> None:
    """The widest is that of an offset that the last results do not determine; the forecast has room."""
    results = [
        replace(
            one,
            without_prior=replace(
                one.without_prior,
                covariance=(np.array(one.without_prior.covariance) / 400).tolist(),
                by_geometry=(0 * np.array(one.without_prior.by_geometry)).tolist(),
            ),
        )
        for one in over_years(6, walk=0.05, lost=lost)
        if one.without_prior is not None
    ]
    own = arm_history(results)
    assert own.arm.drift is not None
    last = date2num(results[-1].measured_at)
    for name in own.arm.drift.series.names:
        panel = offset_panel(own.arm, own.arm.drift, (), name)
        drawn = [one for one in panel.curves if one.band]
        (low, high), ends = panel.y.ends, [one.xs[-1] for one in drawn]
        first = date2num(results[0].measured_at)
        assert max(ends) - last > 0.18 * (last - first)
        assert drawn
        for band in drawn:
            assert low < min(band.low)
            assert max(band.high) < high


@pytest.mark.long
def test_an_offset_that_no_result_determines_is_named_and_never_drawn_as_known() -> None:
    own = arm_history(over_years(4, lost=range(4)))
    assert own.undetermined == (LOST,)
    assert own.state == "no due date"
    said = arm_headline(own)
    assert said.word == "No due date"
    assert LABEL in said.sentence
    picture = pictures(own)["trend"]
    assert f"{LABEL} is determined by no result" in picture.alt
    assert "no result determines it" in picture.svg
    assert points(picture.svg) == 4 * 4
    page = shown(own)
    assert LABEL not in [row[0] for row in page.rows]
    assert f"Determined by no result that counts: {LABEL}" in page.words


@pytest.mark.long
def test_after_a_mastering_nothing_is_known_of_what_no_result_determines_since() -> None:
    results = over_years(8, lost=(5, 6, 7))
    mastering = happened("mastering", results[4].measured_at + timedelta(days=5))
    own = arm_history(results, [mastering])
    assert own.state == "no due date"
    assert f"no result since the last mastering determines {LABEL}" in arm_headline(own).sentence
    page = shown(own, drawn=True)
    (row,) = [row for row in page.rows if row[0] == LABEL]
    assert row[1] == "not determined since the mastering"
    assert f"Not determined since the last mastering: {LABEL}" in page.words
    assert "mastering" in page.words
    assert points(pictures(own)["trend"].svg) == 8 * 5 - 3


@pytest.mark.long
def test_a_jump_is_tied_to_what_was_logged_or_asks_what_happened() -> None:
    results = over_years(8, jump=(5, 1, 0.5))
    alone = arm_history(results)
    assert alone.state == "jump without event"
    assert "no event is logged in between" in arm_headline(alone).sentence
    bump = happened("collision", results[4].measured_at + timedelta(days=3), "table 3")
    told = arm_history(results, [bump])
    assert told.state == "jump"
    assert f"logged in between: collision of {bump.at:%Y-%m-%d}" in arm_headline(told).sentence
    page = shown(told)
    assert "collision" in page.row(LABEL)[-1]
    assert "table 3" in page.words
    svg = pictures(told)["trend"].svg
    assert (">collision<" in svg, ">jump<" in svg) == (True, True)


@pytest.mark.parametrize("what", ["collision", "motor", "mastering"])
def test_what_happened_after_the_last_result_makes_a_calibration_due(what: str) -> None:
    results = over_years(4)
    own = arm_history(results, [happened(what, results[-1].measured_at + timedelta(days=2))])
    assert own.state == "overdue"
    assert arm_headline(own).word == "Calibrate now"
    assert f"{what} on {results[-1].measured_at + timedelta(days=2):%Y-%m-%d}" in arm_headline(own).sentence
    other = arm_history(results, [happened("other", results[-1].measured_at + timedelta(days=2))])
    assert other.state == "on schedule"


def test_overdue_is_said_of_the_day_that_is_asked_about() -> None:
    results = over_years(4, walk=0.01)
    due = arm_history(results).arm.due
    assert due is not None
    late = arm_history(results, as_of=due + timedelta(days=1))
    assert late.state == "overdue"
    assert f"Overdue on {due + timedelta(days=1):%Y-%m-%d}." in arm_headline(late).sentence
    assert arm_history(results, as_of=due - timedelta(days=1)).state == "on schedule"
    midnight = datetime.combine(due, time())
    for today in (midnight, midnight + timedelta(hours=23)):
        own = arm_history(results, as_of=today)
        assert own.state == "overdue", "a due date is a day: from its beginning to its end"
        assert arm_headline(own).word == "Calibrate now"
        assert f"Due on {due:%Y-%m-%d}. " in arm_headline(own).sentence


@pytest.mark.parametrize(("jump", "state"), [(0.15, "undecided"), (2.0, "jump without event")])
@pytest.mark.one_in(2)
def test_a_large_change_between_two_results_is_never_no_jump(jump: float, state: str) -> None:
    own = arm_history(over_years(2, jump=(1, 1, jump), every=timedelta(days=183)), tolerance_mm=1.0)
    page, said = shown(own), arm_headline(own).sentence
    between = f"between {own.results[0].measured_at:%Y-%m-%d} and {own.results[1].measured_at:%Y-%m-%d}"
    assert f"{LABEL} changed by " in said
    assert between in said
    assert "No jump" not in page.words
    told = pictures(own)["trend"].alt
    assert "No jump" not in told
    if state == "undecided":
        assert "too few results to distinguish a jump from drift" in said
        assert "Jump or drift (" not in page.words, "said once"
        assert f"Jump or drift: {LABEL} before" in told
        row = page.row(LABEL)
        assert row[1].endswith(f"{own.results[1].measured_at:%Y-%m-%d}")
        assert row[-1] == "none logged"
        (change,) = arm_document(own)["drift"]["undecided"]
        assert change["offset"] == LOST
        assert abs(change["size"]) < change["least_jump"]
        assert own.row.undecided == 1
    else:
        assert own.state == state
        assert arm_document(own)["drift"]["undecided"] == []


def test_two_results_that_agree_say_nothing_of_jumps() -> None:
    page = shown(arm_history(over_years(2)))
    assert "No change from one result to the next exceeds their uncertainty." in page.words
    assert "No jump" not in page.words
    drifting = arm_history(over_years(12, walk=0.1))
    assert "No jump was found: drift at a rate that other results show" in shown(drifting).words


def test_an_arm_of_misfits_alone_says_so() -> None:
    own = arm_history(over_years(3, misfits=(0, 1, 2)))
    said = arm_headline(own)
    assert (said.key, said.word) == ("misfit", "Misfit")
    assert said.sentence.startswith("All 3 results are misfits: the model does not describe")
    assert own.state == "misfit"
    assert pictures(own) == {}
    page = shown(own)
    assert [row[1:3] for row in page.rows if row[1:2] == ["Misfit"]] == [["Misfit", "unvalidated"]] * 3
    assert "Offsets now" not in page.words


def test_a_misfit_at_the_end_is_said_first_and_does_not_count() -> None:
    own = arm_history(over_years(5, misfits=(4,)), tolerance_mm=2.0)
    assert arm_headline(own).word == "Misfit"
    assert "is a misfit and does not count. Next calibration" in arm_headline(own).sentence
    assert "the model does not describe the measurements" in shown(own).words


def test_no_due_date_where_the_tcp_rotates_with_an_assumed_offset() -> None:
    """A tool beside axis 6, whose offset is as good as the laser's mounting: it is never entered."""
    on_axis = over_years(3, walk=0.02)
    assert on_axis[-1].sensitivity_mm2 is not None
    assert arm_history(on_axis, tolerance_mm=1.0).row.due is not None
    square = np.array(on_axis[-1].sensitivity_mm2)
    square[5, 5] = 25.0  # 5 mm a degree
    beside = [replace(one, sensitivity_mm2=tuple(map(tuple, square.tolist()))) for one in on_axis]
    own = arm_history(beside, tolerance_mm=1.0)
    assert own.row.due is None
    assert own.arm.due_reason == "the TCP depends on offsets that are assumed: delta6"


def test_one_result_says_nothing_of_drift() -> None:
    own = arm_history(over_years(1))
    assert own.state == "no due date"
    assert arm_headline(own).sentence.startswith("One result counts: a drift needs two. ")
    assert pictures(own) == {}
    page = shown(own)
    assert "Offsets over time" not in page.words
    # What it says of the offsets is there all the same, with what its status allows.
    rows = {row.name: row for row in own.results[0].offsets if not row.held}
    assert page.row("J6 (δ6)")[1:] == [page.row("J6 (δ6)")[1], "assumed"]
    assert rows["delta4"].std is not None
    assert page.row("J4 (δ4)")[1].endswith(f"± {numbers.spread(rows['delta4'].std, 'deg')}")
    lost = shown(arm_history(over_years(1, lost=(0,))))
    assert lost.row(LABEL)[1:] == ["not determined", "unidentifiable"]


def test_an_arm_with_events_alone_has_a_page() -> None:
    own = arm_history((), [happened("collision", FIRST)])
    assert arm_headline(own).word == "No results"
    assert own.state == "no due date"
    assert "collision" in shown(own).words


def test_a_rate_that_the_results_say_nothing_of_has_no_number() -> None:
    own = arm_history(over_years(4, lost=(1, 2, 3)))
    row = shown(own).row(LABEL)
    assert row[2:] == ["not determined", ""]
    assert shown(own).row("J4 (δ4)")[2].endswith("°")


@pytest.mark.parametrize(
    "serial", ["<script>alert(1)</script>", "../../etc", "Ж" * 300, "名\u202eabc\x00", "CON", "a b", ""]
)
def test_names_hold_anything(serial: str, tmp_path: Path) -> None:
    own = arm_history(over_years(1, serial=serial, who="<b>中</b>"))
    write_arm(tmp_path / safe_name(serial, "irb1600"), own)
    (folder,) = tmp_path.iterdir()
    assert re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_-]*-)?[0-9a-f]{12}", folder.name)
    assert {one.name for one in folder.iterdir()} == {"arm.html", "arm.pdf", "arm.json", "offsets.csv"}
    page = Page((folder / "arm.html").read_text(encoding="utf-8"))
    assert not page.scripts
    assert "<b>中</b>" in page.words
    assert json.loads((folder / "arm.json").read_text(encoding="utf-8"))["serial"] == serial
    assert (folder / "arm.pdf").read_bytes().startswith(b"%PDF")


def test_names_of_folders_differ_where_arms_do() -> None:
    same = {safe_name(*arm) for arm in (("a-1", "x"), ("A-1", "x"), ("a-1", "y"), ("a 1", "x"), ("a", "1x"))}
    assert len({name.casefold() for name in same}) == 5
    assert len(safe_name("x" * 10_000, "y" * 10_000)) <= 60


@pytest.mark.long
def test_dates_at_the_edges_of_the_calendar() -> None:
    for first in (datetime(1, 1, 1), datetime(9990, 1, 1)):
        moved = tuple(
            one.__class__(**{**one.__dict__, "measured_at": first + timedelta(days=400 * t)})
            for t, one in enumerate(over_years(2))
        )
        assert shown(arm_history(moved), drawn=True).words


@pytest.mark.long
def test_two_hundred_results() -> None:
    results = over_years(200, every=timedelta(days=30), walk=0.002, jump=(150, 3, 0.1), misfits=(30, 31))
    own = arm_history(results)
    assert points(pictures(own)["trend"].svg) == 198 * 5
    page = shown(own, drawn=True)
    assert len([row for row in page.rows if row[1:2] in (["Pass"], ["Misfit"])]) == 200
    assert any(tag == "details" for tag, _ in page.tags)
    assert [one.offset for one in own.arm.jumps] == ["delta5"]


@pytest.mark.long
@pytest.mark.browser
@pytest.mark.parametrize("size", [PHONE, Size(820, 1180), Size(1440, 900), PAPER], ids=str)
def test_the_pages_fit_every_screen_and_everybody_can_read_them(tmp_path: Path, size: Size) -> None:
    results = over_years(30, jump=(8, 1, 0.3), misfits=(5,), lost=(3,), serial="Ж" * 300, who="J. Doe")
    bump = happened("collision", results[20].measured_at, "table 3, " * 40, results[0].serial)
    arms = [arm_history(results, [bump]), arm_history(over_years(4, lost=range(4), serial="A-1"))]
    given = {(own.arm.serial, own.arm.model): own for own in arms}
    found = write_fleet(
        tmp_path / "out", list(given), given.__getitem__, 0.5, datetime(2031, 1, 1), lambda stage, share: None
    )
    for file in ("fleet.html", *(row.page for row in found.arms)):
        with chromium().opened(tmp_path / "out" / file, size) as tab:
            assert tab.overflow() == 0
            assert tab.accessibility() == []
            assert tab.console == []


def test_dates_have_ticks_whatever_the_span() -> None:
    begin = datetime(2024, 2, 29, 13)
    for hours in (1, 5, 30, 47, *range(48, 24 * 1200, 97), 24 * 4000, 24 * 30000):
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a locator that finds no interval
            scale = _dates(begin, begin + timedelta(hours=hours))
        assert 1 <= len(scale.ticks) == len(scale.names) <= 5, hours
