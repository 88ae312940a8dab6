"""What comes late is whole when it comes, for whoever asks for it first."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest
from rich.console import Console

from zerobeam.commands import console
from zerobeam.commands.console import progress, say

START = """
import sys, numpy
from zerobeam.commands.program import when_used
when_used("numpy.testing", "numpy.f2py")
import numpy.testing, scipy.special
assert "unittest" not in sys.modules and "numpy.f2py.f2py2e" not in sys.modules
"""
ATTRIBUTE = "numpy.testing.assert_allclose(1.0, 1.0)"
NAME = "from numpy.testing import assert_allclose as close; close(1.0, 1.0)"
SUBMODULE = "import numpy.f2py.crackfortran; numpy.f2py.crackfortran.crackfortran"
THREADS = """
from concurrent.futures import ThreadPoolExecutor
with ThreadPoolExecutor(8) as pool:
    list(pool.map(lambda k: numpy.testing.assert_allclose(k, k), range(64)))
"""
REAL = """
first = numpy.testing
first.assert_allclose(1.0, 1.0)
assert sys.modules["numpy.testing"] is numpy.testing is not first and numpy.testing.__file__
when_used("numpy.testing")
import numpy.testing
assert numpy.testing.__file__
"""


@pytest.mark.parametrize("program", [ATTRIBUTE, NAME, SUBMODULE, THREADS, REAL])
@pytest.mark.one_in(5)
def test_a_module_comes_when_it_is_used(program: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", START + program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


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
