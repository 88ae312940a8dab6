"""tests/model/parsing/test_validation.py."""

from pathlib import Path
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from zerobeam.model.parsing.reading import line_numbers
from zerobeam.model.parsing.validation import (
    LARGEST,
    LARGEST_OTHER,
    SMALLEST,
    FileModel,
    PositiveOrList,
    Vector,
    positive_or_list,
    validate,
)


class Inner(FileModel):
    length_mm: float
    count: int = 1


class Outer(FileModel):
    name: str
    inner: Inner
    many: dict[str, Inner] = Field(default={})


def judge(refused, data):
    return refused(validate, Outer, data, file=Path("f"), line=lambda position: 10 + len(position))


def test_an_unknown_key_tells_the_allowed_ones_of_its_place(refused):
    error = judge(refused, {"name": "x", "inner": {"lenght_mm": 1.0}})
    assert error.what == "unknown key 'lenght_mm' in inner"
    assert error.allowed == "length_mm, count"
    assert error.remedy == "did you mean 'length_mm'?"
    assert error.line == 12
    error = judge(refused, {"name": "x", "inner": {"length_mm": 1.0}, "many": {"y": {"zzz": 1}}})
    assert error.what == "unknown key 'zzz' in many.y"
    assert error.allowed == "length_mm, count"
    assert judge(refused, {"name": "x", "inner": {"length_mm": 1.0}, "nam": 1}).allowed == "name, inner, many"


@pytest.mark.parametrize(
    ("inner", "what", "result"),
    [
        ({}, "the key 'length_mm' is missing in inner", "no keys at all"),
        ({"length_mm": "1"}, "inner.length_mm is not a number", '"1"'),
        ({"length_mm": True}, "inner.length_mm is not a number", "true"),
        ({"length_mm": None}, "inner.length_mm is not a number", "null"),
        ({"length_mm": 1.0, "count": 1.5}, "inner.count is not a whole number", "1.5"),
        ({"length_mm": 10**400}, "inner.length_mm", None),
        ([1.0], "inner is not keys and values", "[1.0]"),
    ],
)
def test_wrong_values_are_told_in_words(refused, inner, what, result):
    error = judge(refused, {"name": "x", "inner": inner})
    assert what in error.what
    assert result is None or error.found == result
    assert "pydantic" not in str(error)


class Numbers(FileModel):
    a_mm: float = 0.0
    turn_deg: float = 0.0
    ratio: float = 0.0
    point_mm: Vector = (0.0, 0.0, 0.0)
    sigma_mm: Annotated[PositiveOrList, positive_or_list("a sigma")] = 1.0
    offsets_deg: dict[str, float] = Field(default={})


@pytest.mark.parametrize(
    ("content", "what", "result", "allowed"),
    [
        ({"a_mm": 1e30}, "a_mm is out of range", "1e+30 mm", "-1e+06 to 1e+06 mm"),
        ({"turn_deg": -1e6}, "turn_deg is out of range", "-1e+06 deg", "-100000 to 100000 deg"),
        ({"ratio": 1e160}, "ratio is out of range", "1e+160", "-1e+12 to 1e+12"),
        ({"point_mm": [0, 1e7, 0]}, "item 2 of point_mm is out of range", "1e+07 mm", "-1e+06 to 1e+06 mm"),
        ({"sigma_mm": [1, 1e7]}, "item 2 of sigma_mm is out of range", "1e+07 mm", "-1e+06 to 1e+06 mm"),
        ({"offsets_deg": {"x": 1e6}}, "offsets_deg.x is out of range", "1e+06 deg", None),
        ({"sigma_mm": 1e-160}, "a number is too small", "1e-160", "at least 1e-12"),
        ({"sigma_mm": [1, 1e-13]}, "a number is too small", "1e-13", "at least 1e-12"),
    ],
)
def test_numbers_that_nothing_physical_has_are_refused(refused, content, what, result, allowed):
    error = refused(validate, Numbers, content, file=Path("f"), line=lambda position: 10 + len(position))
    assert (error.what, error.found) == (what, result)
    assert allowed is None or error.allowed == allowed
    whole = not isinstance(next(iter(content.values())), list | dict)
    assert error.line == 10 + (1 if whole else 2)


def test_the_bounds_themselves_are_allowed():
    widest = {
        "a_mm": -LARGEST["mm"],
        "turn_deg": LARGEST["deg"],
        "ratio": LARGEST_OTHER,
        "point_mm": [1e-300, 0.0, 0.0],
        "sigma_mm": [SMALLEST, LARGEST["mm"]],
    }
    validate(Numbers, widest, file=None, line=lambda _: None)


@given(st.text(alphabet="a\n\r é", max_size=60))
def test_every_place_of_any_text(text):
    line_of = line_numbers(text)
    for place in range(len(text) + 1):
        assert line_of(place) == text.count("\n", 0, place) + 1
