"""The bar of what takes long: it says how far it is, and never goes back."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from zerobeam.commands import console
from zerobeam.commands.console import progress, say


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    text = io.StringIO()
    monkeypatch.setattr(console, "err", Console(file=text, force_terminal=True, width=120))
    return text


def test_the_share_of_the_whole_and_the_time_left(terminal: io.StringIO) -> None:
    with progress("study") as tell:
        tell("case 37/200", 0.185)
    shown = terminal.getvalue()
    assert "study: case 37/200" in shown
    assert " 18%" in shown
    assert "left" in shown


def test_stages_are_parts_of_the_whole(terminal: io.StringIO) -> None:
    """The share that is told is that of the stage: 1, then 3 of 4 parts; an unknown stage is the whole."""
    with progress("analyse", {"fit": 1.0, "posterior": 3.0}) as tell:
        tell("fit", 1.0)
        tell("posterior", 0.0)
        tell("posterior", 0.5)
    assert " 62%" in terminal.getvalue()


def test_the_bar_never_goes_back(terminal: io.StringIO) -> None:
    with progress("study") as tell:
        tell("one", 0.5)
        tell("two", 0.1)
    last = terminal.getvalue().rpartition("two")[2]
    assert " 50%" in last
    assert " 10%" not in terminal.getvalue()


def test_nothing_is_shown_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    text = io.StringIO()
    monkeypatch.setattr(console, "err", Console(file=text))
    with progress("analyse") as tell:
        tell("fit", 0.5)
    assert text.getvalue() == ""


def test_a_name_between_colons_is_no_picture(capsys: pytest.CaptureFixture[str]) -> None:
    say("run a:bug:b.jsonl")
    assert capsys.readouterr().out == "run a:bug:b.jsonl\n"
