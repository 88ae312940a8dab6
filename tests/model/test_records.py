"""Records: what is written follows from the fields, what is read is strict, and no number is quietly null."""

import math
from dataclasses import field
from datetime import UTC, datetime
from typing import Annotated, Any, ClassVar

import pytest

from zerobeam.model.errors import UnsoundResult
from zerobeam.model.records import (
    if_any,
    inline,
    internal,
    it,
    key,
    only,
    or_null,
    read,
    record,
    schema,
    to_json,
    worded,
)


@record
class Spread:
    std: Annotated[float, it("of the runs", unit="mm")]
    ends: Annotated[tuple[float, float], it("95 % interval")]


@record
class Placed:
    of: Annotated[str, it("its name", name="for")]
    rms_mm: Annotated[float | None, it("of its residuals", unit="mm")]
    spread: Annotated[Spread | None, inline(std="std_mm")]
    fit: Annotated[object, internal]
    at: datetime
    note: Annotated[str, it("null where there is none"), or_null] = ""
    rows: tuple[Spread, ...] = ()
    late: Annotated[int | None, it("rarely there"), if_any] = None
    why: Annotated[str | None, worded("in words")] = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.rms_mm is not None and self.rms_mm < 0:
            raise UnsoundResult(f"{self.of} is {self.rms_mm} mm off")

    @property
    @key("whether it was measured")
    def measured(self) -> bool:
        return self.rms_mm is not None


@record
class Judged(Placed):
    """A key that is computed otherwise, and one of which the document has a part alone."""

    @property
    def measured(self) -> bool:
        return False

    @property
    @key("of each row")
    def stds(self) -> Annotated[tuple[Spread, ...], only("std")]:
        return self.rows


@record(needed=("a",), strict_keys=True)
class Grown:
    a: int
    b: int


WORDS = {Placed: {"why": lambda one: f"{one.of} is near"}}
NOON = datetime(2026, 3, 1, 12)


def placed(**changes: Any) -> Placed:
    stated = {"of": "left", "rms_mm": 0.5, "spread": Spread(0.1, (0.0, 0.2)), "fit": object(), "at": NOON}
    return Placed(**{**stated, **changes})


def test_each_key_is_written_in_the_order_of_the_fields() -> None:
    assert to_json(placed(rows=(Spread(1.0, (0.5, 2.0)),)), WORDS) == {
        "for": "left",
        "rms_mm": 0.5,
        "std_mm": 0.1,
        "at": "2026-03-01T12:00:00+00:00",
        "note": None,
        "rows": [{"std": 1.0, "ends": [0.5, 2.0]}],
        "why": "left is near",
        "measured": True,
    }
    assert list(to_json(placed(late=3), WORDS)) == [
        *("for", "rms_mm", "std_mm", "at", "note", "rows", "late", "why", "measured")
    ]
    assert to_json(placed(spread=None))["std_mm"] is None


def test_a_key_is_computed_otherwise_and_of_a_record_some_keys_are_written() -> None:
    written = to_json(Judged("left", 0.5, None, None, NOON, rows=(Spread(1.0, (0.5, 2.0)),)))
    assert (written["measured"], written["stds"]) == (False, [{"std": 1.0}])


def test_what_is_written_is_read_back_but_for_what_is_internal() -> None:
    first = placed(rms_mm=None, rows=(Spread(1.0, (0.5, 2.0)),), note="cold")
    again = read(Placed, to_json(first, WORDS))
    assert (again.of, again.rms_mm, again.rows, again.note) == ("left", None, first.rows, "cold")
    assert again.at == NOON.replace(tzinfo=UTC)
    assert (again.fit, again.spread, again.why) == (None, None, "left is near")
    assert to_json(again, WORDS)["why"] == "left is near"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rms_mm": "0.5"}, "rms_mm"),
        ({"rms_mm": True}, "rms_mm"),
        ({"rows": [{"std": 1.0, "ends": [1.0]}]}, r"rows\.0\.ends"),
        ({"rms_mm": -1.0}, "left is -1.0 mm off"),
        ({"for": None}, "for"),
    ],
)
def test_reading_is_strict(changes: dict[str, Any], message: str) -> None:
    content = to_json(placed(), WORDS) | changes
    with pytest.raises(ValueError, match=message):
        read(Placed, content)


def test_keys_of_other_versions() -> None:
    assert read(Placed, to_json(placed(), WORDS) | {"later": 1}).of == "left"
    assert read(Grown, {"a": 1}).b is None
    with pytest.raises(ValueError, match="a: Field required"):
        read(Grown, {"b": 1})
    with pytest.raises(ValueError, match="c: Unexpected keyword argument"):
        read(Grown, {"a": 1, "b": 2, "c": 3})


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_an_error_that_says_where(bad: float) -> None:
    with pytest.raises(UnsoundResult, match=r"rows\[1\]\.ends\[0\] is (nan|inf), not a number"):
        to_json(placed(rows=(Spread(1.0, (0.0, 1.0)), Spread(1.0, (bad, 1.0)))), WORDS)
    with pytest.raises(ValueError, match="std"):
        read(Spread, '{"std": NaN, "ends": [0, 1]}')


def test_a_sentence_that_nobody_says_is_an_error() -> None:
    with pytest.raises(UnsoundResult, match="nothing says why of Placed"):
        to_json(placed(), {Spread: {}})
    assert to_json(placed())["why"] is None


def test_a_subclass_is_written_as_the_record_that_it_is() -> None:
    class Shown(Placed):
        pass

    assert to_json(Shown("left", None, None, None, NOON), WORDS) == to_json(
        placed(rms_mm=None, spread=None), WORDS
    )


def test_the_schema_has_every_key_with_its_description() -> None:
    told = schema(Placed)
    assert list(told["properties"]) == [
        *("for", "rms_mm", "at", "note", "rows", "late", "why", "std_mm", "measured")
    ]
    assert told["properties"]["rms_mm"]["description"] == "of its residuals, mm"
    assert told["properties"]["measured"] == {"type": "boolean", "description": "whether it was measured"}
    assert set(told["properties"]) - set(told["required"]) == {"late"}


@record
class Bare(Placed):
    absent: ClassVar[tuple[str, ...]] = ("measured",)


def test_what_all_records_of_a_class_lack_is_neither_written_nor_in_its_schema() -> None:
    bare = Bare("left", 0.5, None, None, NOON)
    assert set(to_json(placed(), WORDS)) - set(to_json(bare)) == {"measured"}
    assert set(schema(Placed)["properties"]) - set(schema(Bare)["properties"]) == {"measured"}
    assert read(Bare, to_json(bare)).rms_mm == 0.5
