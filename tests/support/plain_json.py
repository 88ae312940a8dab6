"""Dataclasses as the plain types that a JSON file would have."""

from typing import Any

from pydantic import TypeAdapter


def plain(value: Any) -> Any:
    return TypeAdapter(type(value)).dump_python(value, mode="json")
