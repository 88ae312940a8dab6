"""What a person sees of a run under way: each event in the view, and nothing where it is no terminal."""

import io
import sys
import threading
import time
from functools import reduce
from typing import Any

import pytest
from rich.console import Console
from run_events import event_of

from zerobeam.experiments.procedure.events import RunEvent
from zerobeam.reports.output import live_view as live
from zerobeam.reports.output.live_view import UnderWay, drawn, live_view

Json = dict[str, Any]

BEGIN: Json = {
    "event": "begin",
    "rig": "simulated",
    "file": "run.jsonl",
    "postures": 7,
    "recorded": [],
    "tolerance": None,
}
SHOT: Json = {"event": "shot", "shot": 0, "attempt": 1, "time_s": 0.0}
UNTOLD: Json = {
    "event": "recorded",
    "shot": 0,
    "target": "psd",
    "spot_mm": [0.001, -0.002],
    "time_s": 9.2,
    "seconds": 9.2,
    "recorded": 1,
    "std": {"delta2": None, "delta3": 0.0123, "delta4": None},
    "worst_std": None,
    "p_value": None,
    "consistent": True,
}
TOLD: Json = {
    **UNTOLD,
    "shot": 3,
    "time_s": 40.0,
    "seconds": 5.0,
    "recorded": 4,
    "std": {f"delta{i}": 0.0123 * i for i in range(2, 7)},
    "worst_std": 0.0738,
    "p_value": 0.4,
}
RETRY: Json = {
    "event": "retry",
    "shot": 4,
    "attempt": 1,
    "reason": "no signal",
    "found": "no sample of the PSD",
}
REFUSED: Json = {"event": "refused", "shot": 4, "reason": "too weak", "found": "3% of the light arrives"}
STOPPED: Json = {"event": "stopped", "why": "the controller stopped the arm"}


def spot(off: float) -> Json:
    return {"event": "spot", "shot": 0, "off_mm": off, "time_s": 3.0}


def phase(name: str) -> Json:
    return {"event": "phase", "phase": name, "time_s": 2.0}


def seen(*events: Json, width: int = 80) -> str:
    """What stands in the view after these events, blanks that keep words together as plain ones."""
    state = reduce(UnderWay.after, map(event_of, events), UnderWay())
    text = io.StringIO()
    Console(file=text, width=width, highlight=False).print(drawn(state))
    return text.getvalue().replace("\u00a0", " ")


def line(name: str, *events: Json) -> str:
    """The line of the view that begins with `name`, without it."""
    (found,) = [text for text in seen(*events).splitlines() if text.startswith(f"{name} ")]
    return found.removeprefix(name).strip()


def test_at_the_beginning_nothing_is_told() -> None:
    assert seen().strip() == ""
    assert line("run", BEGIN) == "run.jsonl"
    assert line("now", BEGIN) == "—"
    assert line("spot off", BEGIN) == "—"
    assert line("measurements", BEGIN) == "0 recorded, 0 refused, 7 to come"
    assert line("time", BEGIN) == "—, left ?"
    assert line("u, ° or mm", BEGIN) == "not known yet"
    assert line("largest u", BEGIN) == "not known yet"


def test_the_shot_its_attempt_and_its_phase() -> None:
    assert line("now", BEGIN, SHOT) == "measurement 0 (1 of 7)"
    assert line("now", BEGIN, SHOT, phase("servo")) == "measurement 0 (1 of 7): servo"
    again = {**SHOT, "shot": 5, "attempt": 2}
    assert line("now", BEGIN, UNTOLD, REFUSED, again) == "measurement 5 (3 of 7), attempt 2"
    assert line("now", BEGIN, SHOT, UNTOLD) == "—"


def test_the_last_steps_of_the_spot_and_none_of_the_attempt_before() -> None:
    steps = [spot(off) for off in (9.6, 6.6, 0.81, 0.062, 0.0028)]
    assert line("spot off", BEGIN, SHOT, *steps) == "6.6 → 0.81 → 0.062 → 0.0028 mm"
    assert line("spot off", BEGIN, SHOT, *steps, {**SHOT, "attempt": 2}) == "—"


def test_what_the_data_cannot_tell_is_not_shown_as_known() -> None:
    assert line("u, ° or mm", BEGIN, UNTOLD).replace("(", "").replace(")", "").split() == [
        *("J2", "δ2", "—"),
        *("J3", "δ3", "0.012"),
        *("J4", "δ4", "—"),
    ]
    assert line("largest u", BEGIN, UNTOLD) == "not known yet"
    assert line("largest u", BEGIN, TOLD) == "0.074"
    assert line("largest u", BEGIN, TOLD, UNTOLD) == "not known yet", "an older number is not kept"
    assert line("largest u", {**BEGIN, "tolerance": 0.05}, TOLD) == "0.074 (tolerance 0.05)"


def test_time_left_is_the_mean_of_the_recorded_shots_times_the_postures_left() -> None:
    assert line("time", BEGIN, SHOT, phase("move")) == "2 s simulated, left ?"
    assert line("time", BEGIN, UNTOLD) == "9 s simulated, left 55 s", "6 of 9.2 s"
    assert line("time", BEGIN, UNTOLD, TOLD) == "40 s simulated, left 21 s", "3 of 7.1 s"
    assert line("time", BEGIN, UNTOLD, TOLD, REFUSED) == "40 s simulated, left 14 s", "2 of 7.1 s"
    slow = {**UNTOLD, "seconds": 63.0, "time_s": 63.0}
    assert line("time", BEGIN, slow) == "1 min 3 s simulated, left 6 min 18 s"
    assert line("time", {**BEGIN, "tolerance": 0.05}, UNTOLD).endswith("left at most 55 s")
    assert line("time", {**BEGIN, "rig": "replay"}, UNTOLD).startswith("9 s as recorded,")


def test_a_run_that_goes_on_has_its_shots_but_no_time_of_them() -> None:
    resumed = {**BEGIN, "recorded": [0, 1, 2]}
    assert line("measurements", resumed) == "3 recorded, 0 refused, 4 to come"
    assert line("time", resumed, {**SHOT, "shot": 3, "time_s": 31.0}) == "31 s simulated, left ?"
    assert line("now", resumed, {**SHOT, "shot": 3}) == "measurement 3 (4 of 7)"


def test_a_shot_made_by_hand_has_no_seconds() -> None:
    by_hand = {key: value for key, value in UNTOLD.items() if key != "seconds"} | {"time_s": None}
    assert line("measurements", BEGIN, by_hand) == "1 recorded, 0 refused, 6 to come"
    assert line("time", BEGIN, by_hand) == "—, left ?"


def test_the_last_trouble_stands_with_its_reason() -> None:
    assert "!" not in seen(BEGIN, SHOT, TOLD)
    retried = seen(BEGIN, SHOT, RETRY)
    assert "! measurement 4, attempt 1 refused (no signal): no sample of the PSD" in retried
    refused = seen(BEGIN, RETRY, REFUSED)
    assert "! measurement 4 given up (too weak): 3% of the light arrives" in refused
    assert "no signal" not in refused
    assert line("measurements", BEGIN, RETRY, REFUSED) == "0 recorded, 1 refused, 6 to come"
    assert "! stopped: the controller stopped the arm" in seen(BEGIN, SHOT, STOPPED)


def test_shots_that_contradict_the_model_are_warned_of() -> None:
    assert "contradict" not in seen(BEGIN, TOLD)
    bad = seen(BEGIN, {**TOLD, "p_value": 1e-5, "consistent": False})
    assert "! The measurements contradict the model or each other" in bad
    assert "relied on (p-value below 0.001)." in bad
    assert "relied on." in seen(BEGIN, {**TOLD, "p_value": None, "consistent": False})
    assert "contradict" not in seen(BEGIN, {**TOLD, "consistent": False}, TOLD), "the last word counts"


def test_an_event_of_another_kind_changes_nothing() -> None:
    before = reduce(UnderWay.after, map(event_of, [BEGIN, SHOT, TOLD, RETRY]), UnderWay())
    assert before.after(RunEvent()) == before
    assert before.after(event_of(STOPPED)) != before


@pytest.mark.parametrize("width", [40, 60, 80, 200])
@pytest.mark.parametrize("joints", [5, 12])
def test_the_view_keeps_within_the_terminal(width: int, joints: int) -> None:
    many = {**TOLD, "std": {f"delta{i}": 0.00123 * i for i in range(1, joints + 1)}, "consistent": False}
    steps = [spot(off) for off in (120.0, 0.0042, 0.062, 0.0028)]
    text = seen(BEGIN, many, RETRY, {**SHOT, "attempt": 3}, phase("settle"), *steps, width=width)
    assert max(len(row) for row in text.splitlines()) <= width
    for i in range(1, joints + 1):
        assert f"J{i} (δ{i}) " in text
    assert ("120 → 0.0042 → 0.062 → 0.0028 mm" in text) == (width > 40)


def test_names_give_the_terminal_no_commands() -> None:
    hostile = "[bold red]beware[/bold red] \x1b[2J\u202e"
    text = seen(
        {**BEGIN, "file": hostile}, {**RETRY, "found": hostile}, {**TOLD, "std": {hostile: 0.1}}, width=200
    )
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert text.count("[bold red]beware[/bold red] \\x1b[2J") == 1
    assert "[bold red]bewa" in text.splitlines()[0]


def heard(console: Console) -> None:
    with live_view(console) as hear:
        for event in (BEGIN, SHOT, phase("servo"), spot(0.5), RETRY, REFUSED, UNTOLD, TOLD, STOPPED):
            hear(event_of(event))
        hear(RunEvent())


def test_nothing_is_written_where_it_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    text = io.StringIO()
    heard(Console(file=text, width=60))
    assert text.getvalue() == ""
    monkeypatch.setenv("TERM", "dumb")
    heard(Console(file=text, width=60, force_terminal=True))
    assert text.getvalue() == ""


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> tuple[Console, io.StringIO]:
    """A terminal of 60 columns and what is written to it."""
    monkeypatch.setenv("TERM", "xterm")
    text = io.StringIO()
    return Console(file=text, width=60, height=24, force_terminal=True), text


def test_in_a_terminal_it_is_drawn_and_taken_away(terminal: tuple[Console, io.StringIO]) -> None:
    console, text = terminal
    heard(console)
    written = text.getvalue()
    assert "4 recorded, 1 refused, 2 to come" in written
    erased = written.rsplit("to come", 1)[1]
    # One line up and cleared, for each line of the view.
    assert erased.count("\x1b[1A\x1b[2K") == written.count("\n")
    assert "\x1b[?25h" in erased, "the cursor is shown again"


def test_no_event_waits_for_the_view(
    terminal: tuple[Console, io.StringIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is drawn at its own pace by a thread of its own, however many events there are."""
    console, _ = terminal
    by: list[int] = []

    def watched(now: UnderWay) -> Any:
        by.append(threading.get_ident())
        return drawn(now)

    monkeypatch.setattr(live, "drawn", watched)
    began = time.monotonic()
    with live_view(console) as hear:
        before = by.count(threading.get_ident())
        while time.monotonic() - began < 0.5:
            hear(event_of(spot(0.5)))
        assert by.count(threading.get_ident()) == before
    others = len(by) - by.count(threading.get_ident())
    assert 1 <= others <= 8 * (time.monotonic() - began) + 1


def test_an_interruption_leaves_no_view_behind(terminal: tuple[Console, io.StringIO]) -> None:
    console, text = terminal

    def interrupted() -> None:
        with live_view(console) as hear:
            hear(event_of(BEGIN))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert text.getvalue().endswith("\x1b[1A\x1b[2K")
    assert "\x1b[?25h" in text.getvalue()


def test_lines_that_are_piped_elsewhere_stay_out_of_the_terminal(
    terminal: tuple[Console, io.StringIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    console, text = terminal
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stdout", pipe)
    with live_view(console) as hear:
        hear(event_of(BEGIN))
        sys.stdout.write('{"event": "begin"}\n')
    assert pipe.getvalue() == '{"event": "begin"}\n'
    assert "{" not in text.getvalue()
