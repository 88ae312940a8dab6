"""Which kind of instrument it is stands in the kind's own file, and nowhere else."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import zerobeam
from zerobeam.model.instruments.kind import Instrument, faces_at, station_at, target_at
from zerobeam.model.instruments.registry import KINDS, TOOLS, kind_of, names_of

HOUSE = Path(zerobeam.__file__).parent
ROOMS = ("model", "analysis", "experiments", "reports", "words", "commands", "face", "app")
# Kinds whose names are words of robots, drawings and controllers as well.
WORDS = {"pose", "plane", "sphere", "dial"}


def files():
    for room in ROOMS:
        yield from (HOUSE / room).rglob("*.py")


def strings(node):
    """The strings in some code, with their lines."""
    for each in ast.walk(node):
        if isinstance(each, ast.Constant) and isinstance(each.value, str):
            yield each.value, each.lineno


def about_kinds(node):
    return re.search("kind|instrument|station|tool", ast.unparse(node), re.IGNORECASE) is not None


def judged(node):
    """The parts of some code that tell kinds apart: comparisons, matches, look-ups and calls that speak of
    kinds or instruments, and the keys of dictionaries that have two kinds or are called after them."""
    match node:
        case ast.Compare(left, _, others) if any(map(about_kinds, [left, *others])):
            return [left, *others]
        case ast.Match(subject, branches) if about_kinds(subject):
            return [each.pattern for each in branches]
        case ast.Subscript(value, index) if about_kinds(value):
            return [index]
        case ast.Call(function, arguments) if about_kinds(function):
            return arguments
        case ast.Assign([target], ast.Dict(keys)) | ast.AnnAssign(target, _, ast.Dict(keys)) if about_kinds(
            target
        ):
            return [key for key in keys if key is not None]
        case ast.Dict(keys):
            known = [key for key in keys if isinstance(key, ast.Constant) and key.value in KINDS]
            return known if len(known) > 1 else []
    return []


def names_of_kinds(text):
    """The lines of some code that name a kind. A word that means something else as well counts where kinds
    are told apart."""
    if not any(f"{quote}{name}{quote}" in text for name in KINDS for quote in "\"'"):
        return
    tree = ast.parse(text)
    for name, line in strings(tree):
        if name in KINDS.keys() - WORDS:
            yield line
    for node in ast.walk(tree):
        for part in judged(node):
            yield from (line for name, line in strings(part) if name in WORDS)


def test_no_code_outside_its_own_file_names_a_kind():
    told = [
        f"{path.relative_to(HOUSE)}:{line}"
        for path in files()
        if path.parent != HOUSE / "model" / "instruments"
        for line in names_of_kinds(path.read_text(encoding="utf-8"))
    ]
    assert told == []


@pytest.mark.parametrize(
    "code",
    [
        'if kind == "laser":\n    pass',
        "x = {'probe': 1}",
        "x = {'sphere': 1, 'plane': 2}",
        "of_kinds = {'sphere': 1}",
        "of_kinds: dict[str, int] = {'sphere': 1}",
        "y = tool.name in ('dial', 'other')",
        "match instrument.name:\n    case 'plane':\n        pass",
        "x = KINDS['pose']",
        "kind_of('pose')",
    ],
)
def test_control_such_a_line_would_be_seen(code):
    assert len(set(names_of_kinds(code))) == 1


@pytest.mark.parametrize(
    "code", ["ca.Function('pose', inputs)", "if tree.data == 'pose':\n    pass", "x = {'pose': 1}"]
)
def test_control_another_meaning_of_the_word_is_not_seen(code):
    assert list(names_of_kinds(code)) == []


def test_every_file_beside_the_registry_has_a_kind():
    files = {path.stem for path in (HOUSE / "model" / "instruments").glob("*.py")}
    shared = {"kind", "frames", "together", "registry"}
    assert files - shared - {"__init__"} == {kind.__module__.rpartition(".")[2] for kind in KINDS.values()}


@pytest.mark.parametrize("kind", KINDS.values(), ids=str)
def test_a_kind_says_all_of_itself(kind):
    told = [name for name, what in Instrument.__annotations__.items() if what.startswith("ClassVar")]
    assert [name for name in told if not hasattr(kind, name)] == []
    assert kind_of(kind.name) is kind
    assert (kind.name in names_of(beam=kind.beam)) == (kind.name in TOOLS)
    assert kind.name not in names_of(beam=not kind.beam)


@pytest.mark.parametrize(
    ("reach", "station"), [(1000.0, [2200.0, 350.0, 500.0]), (400.0, [880.0, 140.0, 200.0])]
)
def test_a_station_is_out_of_reach_and_grows_with_the_arm(reach, station):
    assert station_at(reach) == station
    assert np.linalg.norm(station) > reach


def test_a_station_is_stated_to_the_millimetre():
    assert station_at(901.3) == [1983.0, 315.0, 451.0]


def test_targets_and_faces_are_where_they_are_stated():
    assert target_at((1.23456, -0.0, 3)) == {"guess_mm": [1.235, 0.0, 3.0], "sigma_mm": 30.0}
    faces = faces_at((600.0, 10.0, 300.0), ["top", "back", "side"])
    assert [face["guess_mm"] for face in faces.values()] == [
        [600.0, 10.0, 350.0],
        [550.0, 10.0, 300.0],
        [600.0, -40.0, 300.0],
    ]
