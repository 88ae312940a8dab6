"""Base of the JSON documents that zerobeam writes: one model writes each, reads it, and makes its schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict


def is_none(value: object) -> bool:
    """Of a field that is absent, and not null, where it has no value: `Field(exclude_if=is_none)`."""
    return value is None


def keys_of(model: type[BaseModel], value: object, others: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes of `value` that have the names of the model's fields, and `others` in their place."""
    names = model.model_fields.keys() & set(dir(value)) - others.keys()
    return {name: getattr(value, name) for name in names} | dict(others)


class JsonDocument(BaseModel):
    """A document, or a part of one: its keys are the fields, in their order."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False, defer_build=True
    )

    @classmethod
    def filled(cls, value: object, **others: Any) -> Self:
        """With the attributes of `value` of the same names; `others` are its other keys."""
        return cls(**keys_of(cls, value, others))

    def to_json(self) -> dict[str, Any]:
        """Plain values: dicts, lists, texts, numbers, true, false and None."""
        return self.model_dump(mode="json", by_alias=True)

    @classmethod
    def from_json(cls, content: object) -> Self:
        """The document of plain values; pydantic's ValidationError, a ValueError, where they are of none."""
        return cls.model_validate(content)
