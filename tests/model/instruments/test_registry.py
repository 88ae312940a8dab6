"""Which kind of instrument it is stands in the kind's own file, and nowhere else."""

import io
import tokenize
from pathlib import Path

import pytest

import zerobeam
from zerobeam.model.instruments.kind import Instrument
from zerobeam.model.instruments.registry import KINDS, kind_of, names_of

HOUSE = Path(zerobeam.__file__).parent
ROOMS = ("model", "analysis", "experiments", "reports", "words", "commands", "face", "app", "controller")


def files():
    for room in ROOMS:
        yield from (HOUSE / room).rglob("*.py")


def names_of_kinds(text):
    """The strings of some code that are the name of a kind, with their lines."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.STRING and token.string.strip("\"'") in KINDS:
            yield token.start[0]


def test_no_code_outside_its_own_file_names_a_kind():
    told = [
        f"{path.relative_to(HOUSE)}:{line}"
        for path in files()
        if path.parent != HOUSE / "model" / "instruments"
        for line in names_of_kinds(path.read_text(encoding="utf-8"))
    ]
    assert told == []


@pytest.mark.parametrize("code", ['if kind == "laser":', "x = {'probe': 1}"])
def test_control_such_a_line_would_be_seen(code):
    assert list(names_of_kinds(code)) == [1]


def test_every_file_beside_the_registry_is_a_kind():
    own = {path.stem for path in (HOUSE / "model" / "instruments").glob("*.py")}
    assert own - {"__init__", "kind", "flange_tool", "together", "registry"} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS.values(), ids=str)
def test_a_kind_says_all_of_itself(kind):
    told = [name for name, what in Instrument.__annotations__.items() if what.startswith("ClassVar")]
    assert [name for name in told if not hasattr(kind, name)] == []
    assert kind_of(kind.name) is kind
    assert kind.name in names_of(beam=kind.beam)
    assert kind.name not in names_of(beam=not kind.beam)
