from pathlib import Path

import pytest
from pydantic import Field

from zerobeam.model.files.validation import FileModel, validate


class Inner(FileModel):
    length_mm: float
    count: int = 1


class Outer(FileModel):
    name: str
    inner: Inner
    many: dict[str, Inner] = Field(default={})


def judge(refused, data):
    return refused(validate, Outer, data, file=Path("f"), line=lambda place: 10 + len(place))


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
    ("inner", "what", "found"),
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
def test_wrong_values_are_told_in_words(refused, inner, what, found):
    error = judge(refused, {"name": "x", "inner": inner})
    assert what in error.what
    assert found is None or error.found == found
    assert "pydantic" not in str(error)
