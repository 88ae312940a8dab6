"""Records: answers, and parts of them, whose fields state type, unit and description once.

    @record
    class Held:
        placement: Annotated[str, it("its name")]
        rms_mm: Annotated[float | None, it("of its residuals", unit="mm")] = None
        fit: Annotated[object, internal] = None
        message: Annotated[str | None, worded("why there is no test, or null")] = None

        @property
        @key("whether there is a test")
        def tested(self) -> bool: ...

A record is a frozen dataclass. Its JSON, the strict reading of it, its JSON Schema and its table follow from
the fields: no second class repeats them. Times are UTC without a zone, and written with it. A number that is
not finite is an error, never a quiet null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import UTC, datetime
from functools import cache, partial
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar, cast, dataclass_transform, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticOmit, core_schema

from .errors import UnsoundResult

R = TypeVar("R")
Getter = TypeVar("Getter", bound=Callable[[Any], Any])
# By the class of a record and one of its worded keys: what is said, from the record.
Words = Mapping[type, Mapping[str, Callable[[Any], object]]]
_NO_WORDS: Words = MappingProxyType({})


class _Internal:
    """See `internal`."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        nothing = core_schema.no_info_plain_validator_function(lambda _: None)
        return core_schema.with_default_schema(nothing, default=None)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        raise PydanticOmit


internal = _Internal()
"""Marks a field that the document does not have: None in a record that was read."""


class inline(_Internal):
    """Marks a field whose own fields are keys of the document, `kept` or under these names: null where it is
    None.

    As in `mean: Annotated[Mean | None, inline("unit", value="mean", std="mean_std")]`.
    """

    def __init__(self, *kept: str, **names: str) -> None:
        self.names = {name: name for name in kept} | names


class only:
    """Marks a key whose value is a record, or several, of which the document has the keys `names` alone."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def of(self, value: Any) -> Any:
        """These keys of a record, or of each."""
        if value is None or isinstance(value, tuple | list):
            return value and [self.of(item) for item in value]
        kind = _kind(cast(Any, type(value)))
        return {one.name: _shown(value, kind, one, _NO_WORDS) for one in keys(kind) if one.name in self.names}


class _OrNull:
    """See `or_null`."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        text = core_schema.nullable_schema(handler(source))
        return core_schema.no_info_after_validator_function(lambda value: value or "", text)


if_any, or_null = object(), _OrNull()
"""Mark a key that is not written where it is None, and a text that is null where it is empty."""

_WORDED = "worded"


def it(description: str, *, unit: str | None = None, name: str | None = None) -> Any:
    """What a field is, with the `unit` of its number, and its `name` in the document where that is a word of
    Python."""
    return Field(description=description if unit is None else f"{description}, {unit}", alias=name)


def worded(description: str) -> Any:
    """The same of a key that `words` fill when the record is written. A record that was read has the text."""
    about = Field(description=description)
    about.metadata.append(_WORDED)
    return about


def key(description: str, *, name: str | None = None) -> Callable[[Getter], Getter]:
    """Makes a property a key of the document: it follows from the fields, and is not read back."""

    def marked(getter: Getter) -> Getter:
        getter.key_of_document = (name or getter.__name__, description)  # type: ignore[attr-defined]
        return getter

    return marked


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def record(
    cls: type[R] | None = None, /, *, strict_keys: bool = False, needed: tuple[str, ...] = (), **how: Any
) -> Any:
    """Make a class a record; `how` goes to `dataclasses.dataclass`.

    Reading leaves keys out that the record does not have, unless `strict_keys`; it demands those without a
    default, or `needed` alone: earlier versions wrote fewer, and what they lack is None.
    """
    if cls is None:
        return lambda later: record(later, strict_keys=strict_keys, needed=needed, **how)
    made: Any = dataclass(frozen=True, **how)(cls)
    made.__pydantic_config__ = ConfigDict(
        strict=True, extra="forbid" if strict_keys else "ignore", allow_inf_nan=False
    )
    if needed:
        made.__get_pydantic_core_schema__ = classmethod(partial(_lenient, needed=needed))
    made.__get_pydantic_json_schema__ = classmethod(_with_properties)
    return made


def _lenient(
    cls: type, source: Any, handler: GetCoreSchemaHandler, *, needed: tuple[str, ...]
) -> core_schema.CoreSchema:
    whole = handler(source)
    for one in cast(Any, whole)["schema"]["fields"]:
        if one["name"] not in needed and one["schema"]["type"] != "default":
            one["schema"] = core_schema.with_default_schema(one["schema"], default=None)
    return whole


def _with_properties(
    cls: type, whole: core_schema.CoreSchema, handler: GetJsonSchemaHandler
) -> JsonSchemaValue:
    """All keys, which are always written; those of properties too."""
    answer = handler(whole)
    content = handler.resolve_ref_schema(answer)
    for one in keys(cls):
        if one.name not in content["properties"]:
            shown = handler(cast(Any, TypeAdapter(one.type).core_schema))
            content["properties"][one.name] = {**shown, "description": one.description}
        content["properties"][one.name].pop("default", None)
    content["required"] = [one.name for one in keys(cls) if if_any not in one.marks]
    return answer


class Key(NamedTuple):
    """A key of a document, and the `attribute` that it shows; `worded`: a sentence that `words` say."""

    name: str
    attribute: str
    description: str
    worded: bool
    type: Any
    marks: tuple[Any, ...] = ()


@cache
def keys(cls: type) -> tuple[Key, ...]:
    """The keys of a record or a dataclass in the order of the document: fields, then properties; without
    those that all records of the class lack (`absent`)."""
    absent = getattr(cls, "absent", ())
    without = absent if isinstance(absent, tuple) else ()  # a property: it is of each record
    hints = get_type_hints(cls, include_extras=True)
    answer: list[Key] = []
    for one in fields(cls):
        marks = getattr(hints[one.name], "__metadata__", ())
        if internal in marks:
            continue
        if parts := next((mark for mark in marks if isinstance(mark, inline)), None):
            answer += _inlined(one.name, hints[one.name], parts.names)
            continue
        about = next((mark for mark in marks if isinstance(mark, FieldInfo)), Field())
        name = about.serialization_alias or about.alias or one.name
        answer.append(
            Key(
                name,
                one.name,
                about.description or "",
                _WORDED in about.metadata,
                hints[one.name],
                marks,
            )
        )
    getters: dict[str, Any] = {}  # a subclass may compute a key otherwise
    for name, one in ((name, one) for base in reversed(cls.__mro__) for name, one in vars(base).items()):
        getter = getattr(one, "fget", None) or getattr(one, "func", None)
        if hasattr(getter, "key_of_document"):
            getters[name] = getter
    for attribute, getter in getters.items():
        name, description = getter.key_of_document
        if name in without:
            continue
        returns = get_type_hints(getter, include_extras=True)["return"]
        answer.append(Key(name, attribute, description, False, returns, getattr(returns, "__metadata__", ())))
    return tuple(answer)


def _inlined(name: str, annotated: Any, names: Mapping[str, str]) -> Iterator[Key]:
    whole = get_args(annotated)[0]
    inner = next(kind for kind in (whole, get_origin(whole), *get_args(whole)) if is_dataclass(kind))
    for one in keys(cast(Any, inner)):
        if one.name in names:
            kept = one._replace(name=names[one.name], attribute=f"{name}.{one.attribute}", worded=False)
            yield kept._replace(type=one.type | None)


def to_json(value: object, words: Words = _NO_WORDS) -> Any:
    """The record as dicts, lists, strings, bools, ints and finite floats, with the sentences of `words`.

    Raises
    ------
    UnsoundResult
        A number is not finite, something is no value of JSON, or a sentence is missing.

    Examples
    --------
    >>> from zerobeam.analysis.diagnostics.values_to_enter import TcpError
    >>> to_json(TcpError(1.0, 2.5, (0.5, 1.5)))
    {'median_mm': 1.0, 'p95_mm': 2.5, 'median_band_mm': [0.5, 1.5]}
    """
    answer = _plain(value, words)
    try:
        return json.loads(json.dumps(answer, allow_nan=False))
    except TypeError as error:
        raise _unsound(str(error)) from None
    except ValueError:  # which does not say where
        where, number = next(_not_finite(answer))
        raise _unsound(f"{where} is {number}, not a number") from None


def _plain(value: object, words: Words) -> object:
    if value is None or isinstance(value, str | int | float):  # most values, before what is slow to ask
        return value
    if is_dataclass(value):
        kind = _kind(cast(Any, type(value)))
        return {one.name: _plain(_shown(value, kind, one, words), words) for one in _present(value, kind)}
    if isinstance(value, datetime):
        return value.replace(tzinfo=UTC).isoformat()
    if isinstance(value, Mapping):
        return {name: _plain(item, words) for name, item in value.items()}
    if isinstance(value, BaseModel):
        about = type(value).model_fields
        return {
            (about[name].alias or name) if name in about else name: _plain(item, words)
            for name, item in value
            if item is not None or name not in about or if_any not in about[name].metadata
        }
    return [_plain(item, words) for item in value] if isinstance(value, list | tuple) else value


@cache
def _kind(cls: type) -> type:
    """The record that it is: a subclass may have more than its document, and words of its own."""
    return next((one for one in cls.__mro__ if "__pydantic_config__" in vars(one)), cls)


def _present(value: Any, kind: type) -> Iterator[Key]:
    """The keys, without those that the record says it does not have (`absent`), or has no value of."""
    without = getattr(value, "absent", ())
    return (
        one
        for one in keys(kind)
        if one.name not in without and not (if_any in one.marks and getattr(value, one.attribute) is None)
    )


def _shown(value: object, kind: type, one: Key, words: Words) -> object:
    shown: Any = value
    for name in one.attribute.split(".") if "." in one.attribute else (one.attribute,):
        shown = None if shown is None else getattr(shown, name)
    for mark in one.marks:
        if isinstance(mark, PlainSerializer):
            return mark.func(shown)  # type: ignore[call-arg]
        if isinstance(mark, only):
            return mark.of(shown)
    if or_null in one.marks:
        return shown or None
    if not one.worded or shown is not None or not words:  # without words a record says what it has
        return shown
    sentences = next((words[of] for of in kind.__mro__ if of in words), {})
    if one.attribute not in sentences:
        raise _unsound(f"nothing says {one.name} of {kind.__name__}")
    return sentences[one.attribute](value)


def _unsound(what: str) -> UnsoundResult:
    return UnsoundResult(f"the result is unsound and was not written: {what}")


def _not_finite(value: object, where: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield where, value
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _not_finite(item, f"{where}.{name}".lstrip("."))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _not_finite(item, f"{where}[{i}]")


@cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    return TypeAdapter(cls)


def read(cls: type[R], content: object) -> R:
    """The record of a JSON text, or of plain values; ValueError says where and why it is none."""
    try:
        text = content if isinstance(content, str | bytes) else json.dumps(content)
        record: R = _adapter(cast(Any, cls)).validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")) from None
    except UnsoundResult as error:
        raise ValueError(str(error)) from None
    return record


def schema(cls: Any) -> dict[str, Any]:
    """Its JSON Schema; every key that is written is in it."""
    return _adapter(cls).json_schema(by_alias=True)


def dumps(answer: dict[str, Any]) -> str:
    """The text of `result.json`: keys in their given order, floats to the last digit, UTF-8 safe."""
    # One line for each item of the second level: C writes them, and with an indent Python would.
    text = _item_by_item(answer, "", lambda value: _item_by_item(value, " ", _LINE.encode))
    return _encodable(text) + "\n"


def one_line(value: object) -> str:
    """The same of a part, on one line."""
    return _encodable(_LINE.encode(value))


def _encodable(text: str) -> str:
    """A lone surrogate cannot be encoded in UTF-8, but its escape is legal JSON and says the same."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


_LINE = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def _item_by_item(value: object, margin: str, write: Callable[[Any], str]) -> str:
    """A dict or list with a line for each item behind `margin`, as `write` writes them."""
    if not value or not isinstance(value, dict | list | tuple):
        return _LINE.encode(value)
    if isinstance(value, dict):
        ends, rows = "{}", [f"{_LINE.encode(key)}: {write(item)}" for key, item in value.items()]
    else:
        ends, rows = "[]", [write(item) for item in value]
    inner = f"\n{margin} "
    return f"{ends[0]}{inner}{f',{inner}'.join(rows)}\n{margin}{ends[1]}"
