"""The base of the parts of `result.json` and of a check: plain finite values out, strict types in.

JSON has no NaN and no infinity: such a number is an error, never a quiet null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any, Self

from pydantic import BaseModel, ConfigDict

from ...model.errors import UnsoundResult
from ...model.files.json_document import keys_of

Interval = tuple[float, float]
Number = float | None


class DocumentPart(BaseModel):
    """Part of a document. Types are held to when it is read, and keys of other versions are left out."""

    model_config = ConfigDict(
        strict=True,
        extra="ignore",
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,
    )

    @classmethod
    def filled(cls, value: object, **others: Any) -> Self:
        """With the attributes of `value` of the same names; `others` are its other keys."""
        return cls.model_construct(**keys_of(cls, value, others))

    def to_json(self) -> dict[str, Any]:
        """As dicts, lists, strings, bools, ints and finite floats; UnsoundResult names what is neither."""
        answer = _keys(self)
        try:
            plain: dict[str, Any] = json.loads(json.dumps(answer, allow_nan=False))
        except TypeError as error:
            raise _unsound(str(error)) from None
        except ValueError:  # which does not say where
            where, number = next(_not_finite(answer))
            raise _unsound(f"{where} is {number}, not a number") from None
        return plain


def _keys(value: object) -> object:
    """Parts of a document and dataclasses as dicts. `model_dump` gives the same, but builds a serializer of
    the whole document first: that takes as long as three figures."""
    if isinstance(value, DocumentPart):
        names = {name: field.alias or name for name, field in type(value).model_fields.items()}
        return {names[name]: _keys(item) for name, item in value if name in value.model_fields_set}
    if is_dataclass(value):
        return {field.name: _keys(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {name: _keys(item) for name, item in value.items()}
    return [_keys(item) for item in value] if isinstance(value, list | tuple) else value


def _unsound(what: str) -> UnsoundResult:
    return UnsoundResult(f"the result is unsound and was not written: {what}")


def _not_finite(value: object, where: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield where, value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _not_finite(item, f"{where}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _not_finite(item, f"{where}[{i}]")
