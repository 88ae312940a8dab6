"""What files may contain, said by pydantic models; their complaints, said in words with file and line."""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from ..errors import BadInput
from .reading import Document, KeyPath, Schema, did_you_mean, read_yaml, require_schema, shown

Model = TypeVar("Model", bound=BaseModel)

# Magnitudes of numbers (docs/files.md): by the unit that ends a key, and without one. Beyond them sums of
# squares overflow, or no digit of a millimetre is left.
LARGEST = {"deg": 1e5, "mm": 1e6}
LARGEST_OTHER = 1e12
SMALLEST = 1e-12  # of what must be above 0, and of the length of a direction
MOST = 10**9  # of what is counted


class FileModel(BaseModel):
    """Base of what is read from files: no unknown keys, no conversion of types, no NaN or infinity, and no
    numbers that nothing physical has."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="after")
    def _within_bounds(self) -> Self:
        for name, value in self.__dict__.items():
            if value is None or type(value) is str:
                continue
            most, of = _largest(name)
            # All parts at once where there may be millions: the joints of a measurement.
            floats = type(value) is tuple and _FLOAT.issuperset(map(type, value))
            if floats and -most <= min(value, default=0.0) and max(value, default=0.0) <= most:
                continue
            inner = value.items() if type(value) is dict and of else ()
            parts = enumerate(value) if type(value) is tuple else inner or ((None, value),)
            for part, number in parts:
                if type(number) is float and not -most <= number <= most:
                    key = (name,) if part is None else (name, part)
                    raise refusal(
                        f"{called(key)} is out of range",
                        key=key,
                        found=f"{number:g}{of}",
                        allowed=f"-{most:g} to {most:g}{of}",
                        remedy="correct the number, or its unit",
                    )
        return self


_FLOAT = frozenset({float})


@cache
def _largest(name: str) -> tuple[float, str]:
    """The largest magnitude of a key's numbers, and the unit that ends the key."""
    unit = "" if "_per_" in name else name.rpartition("_")[2]
    return (LARGEST[unit], f" {unit}") if unit in LARGEST else (LARGEST_OTHER, "")


def refusal(
    what: str,
    *,
    key: KeyPath = (),
    found: object = None,
    allowed: object = None,
    remedy: str | None = None,
) -> PydanticCustomError:
    """An error for a model's own validator to raise; `key` leads from the validated value to the culprit."""
    facts = {"what": what, "key": key, "found": found, "allowed": allowed, "remedy": remedy}
    return PydanticCustomError("refused", "{what}", facts)


def bad_input(refused: PydanticCustomError, file: Path | None) -> BadInput:
    """The error of a `refusal` that was found outside of a model's own validation."""
    facts = dict(refused.context or {})
    facts.pop("key")
    return BadInput(facts.pop("what"), file=file, **facts)


def as_tuple(value: object) -> object:
    """A list of a file as the tuple that a frozen model keeps; anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


def tuple_of(size: int, meaning: str | None = None) -> BeforeValidator:
    """Refuse what is not a list of `size` values; `meaning` says in the message what they are."""

    def check(value: object) -> object:
        if not isinstance(value, list | tuple) or len(value) != size:
            actual = f"{len(value)} values" if isinstance(value, list | tuple) else shown(value)
            raise refusal(f"a list of {size} values is required", found=actual, allowed=meaning)
        return tuple(value)

    return BeforeValidator(check)


def _name(value: object) -> object:
    """A name that can stand in a table, in JSON and in front of '.x'."""
    if isinstance(value, str) and (not value or value != value.strip() or not value.isprintable()):
        raise refusal(
            "this cannot be a name",
            found=shown(value),
            allowed="printable text that neither begins nor ends with a blank",
        )
    return value


def _target_name(value: object) -> object:
    if value == "tool":
        # Parameters of targets and of the tool are both called <name>.x.
        raise refusal("a target cannot be called 'tool'", remedy="give it another name")
    return _name(value)


def _not_vanishing(value: float, key: KeyPath = ()) -> float:
    if 0 < value < SMALLEST:
        actual, least = f"{value:g}", f"at least {SMALLEST:g}"
        raise refusal(
            "a number is too small", key=key, found=actual, allowed=least, remedy="correct its unit"
        )
    return value


def positive_or_list(what: str) -> BeforeValidator:
    """One positive number, or one for each joint; `what` it is begins the message of a wrong one."""

    def check(value: object) -> object:
        values = value if isinstance(value, list | tuple) else [value]
        for i, item in enumerate(values):
            key = (i,) if isinstance(value, list | tuple) else ()
            if isinstance(item, bool) or not isinstance(item, int | float) or not item > 0:
                raise refusal(
                    f"{what} cannot be used",
                    key=key,
                    found=shown(item),
                    allowed="one number above 0, or a list of them, one for each joint",
                )
            _not_vanishing(item, key)
        return as_tuple(value)

    return BeforeValidator(check)


Vector = Annotated[tuple[float, float, float], tuple_of(3, "[x, y, z]")]


def without_length(value: Any) -> bool:
    """Whether three numbers are no direction; what is no number at all is left to others to refuse."""
    try:
        return math.hypot(*value) < SMALLEST
    except (TypeError, OverflowError):
        return False


def with_length(what: str, allowed: str = "any vector but zero") -> AfterValidator:
    """A vector of any length but zero; `what` it is begins the message of a wrong one."""

    def check(value: tuple[float, float, float]) -> tuple[float, float, float]:
        if without_length(value):
            raise refusal(f"{what} has no length", found=shown(value), allowed=allowed)
        return value

    return AfterValidator(check)


Positive = Annotated[float, Field(gt=0), AfterValidator(_not_vanishing)]
Name = Annotated[str, BeforeValidator(_name)]
TargetName = Annotated[str, BeforeValidator(_target_name)]
PositiveOrList = Positive | tuple[Positive, ...]
NotNegative = Annotated[float, Field(ge=0), AfterValidator(_not_vanishing)]
Fraction = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=1, le=MOST)]
NumberPair = Annotated[tuple[float, float], tuple_of(2)]


class SourcedModel(FileModel):
    """Base of a file's content that is checked again later, against a plan: it knows where its keys are."""

    _document: Document | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """The file that this was read from, if any."""
        return None if self._document is None else self._document.file

    @property
    def folder(self) -> Path:
        """The folder that paths in the file are relative to."""
        return Path() if self._document is None else self._document.file.parent

    @property
    def sha256(self) -> str | None:
        """SHA-256 of the file's bytes; None for what was not read from a file."""
        return None if self._document is None else self._document.sha256

    def line(self, key: KeyPath) -> int | None:
        """The line of a key, None for what was not read from a file."""
        return None if self._document is None else self._document.line(key)

    def refuse(
        self,
        key: KeyPath,
        what: str,
        *,
        found: object = None,
        allowed: object = None,
        remedy: str | None = None,
    ) -> BadInput:
        """An error about the key at `place`, with file and line if this was read from a file."""
        return BadInput(
            what, found=found, allowed=allowed, remedy=remedy, file=self.file, line=self.line(key)
        )


def read_model(model: type[Model], path: Path | str, schema: Schema | None = None) -> Model:
    """A YAML file as the model; BadInput, with file and line, for another `schema` or an invalid content."""
    document = read_yaml(Path(path))
    if schema is not None:
        require_schema(document.data, schema, file=document.file, line=document.line(("schema",)))
    content = validate(model, document.data, file=document.file, line=document.line)
    if isinstance(content, SourcedModel):
        content._document = document
    return content


def validate(
    model: type[Model], data: object, *, file: Path | None, line: Callable[[KeyPath], int | None]
) -> Model:
    """`data` as the model, or BadInput of the most telling of the model's complaints.

    An unknown key comes before a missing one (it is that one, misspelt), and both before values.
    `line` gives the line of a place.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        try:
            complaints = error.errors(include_url=False)
        except UnicodeEncodeError as broken:
            raise BadInput(
                "a name holds half a letter (a lone surrogate)",
                found=ascii(broken.object),
                allowed="text that can be written in UTF-8",
                remedy="write the name anew",
                file=file,
                line=line(()),
            ) from None
    order = {"extra_forbidden": 0, "missing": 1}
    worst = min(complaints, key=lambda complaint: order.get(complaint["type"], 2))
    raise _bad_input(model, data, worst, file, line)


def _bad_input(
    model: type[BaseModel],
    data: object,
    complaint: ErrorDetails,
    file: Path | None,
    line: Callable[[KeyPath], int | None],
) -> BadInput:
    """The BadInput of a complaint of pydantic's, with its line."""
    kind, facts = complaint["type"], complaint.get("ctx", {})
    path = _key_path(data, complaint["loc"], kind)
    value = complaint["input"]

    if kind == "refused":
        path = (*path, *facts["key"])
        details = {name: facts[name] for name in ("found", "allowed", "remedy")}
        return BadInput(facts["what"], **details, file=file, line=line(path))
    if kind == "extra_forbidden":
        key, allowed = str(path[-1]), _keys_at(model, path[:-1])
        return BadInput(
            f"unknown key {key!r}{_inside(path[:-1])}",
            found=f"{key}: {shown(value)}",
            allowed=", ".join(allowed),
            remedy=did_you_mean(key, allowed) or "remove it",
            file=file,
            line=line(path),
        )
    if kind == "missing":
        key = str(path[-1])
        present = ", ".join(value) if isinstance(value, dict) and value else "no keys at all"
        return BadInput(
            f"the key {key!r} is missing{_inside(path[:-1])}",
            found=present,
            remedy=f"add {key!r}",
            file=file,
            line=line(path),
        )
    what, allowed_text = _in_words(kind, facts, str(complaint["msg"]))
    known = re.findall(r"'([^']*)'", str(facts["expected"])) if kind == "literal_error" else []
    near = did_you_mean(value, known) if isinstance(value, str) else None
    at = line(path)
    return BadInput(
        f"{called(path)} {what}", found=shown(value), allowed=allowed_text, remedy=near, file=file, line=at
    )


KINDS = {
    "float_type": "a number",
    **dict.fromkeys(("int_type", "int_from_float"), "a whole number"),
    "string_type": "text",
    "bool_type": "true or false",
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "keys and values"),
}
BOUNDS = {"greater_than": ("gt", ">"), "greater_than_equal": ("ge", ">="), "less_than_equal": ("le", "<=")}


def _in_words(kind: str, facts: Mapping[str, Any], message: str) -> tuple[str, str | None]:
    if kind in KINDS:
        return f"is not {KINDS[kind]}", KINDS[kind]
    if kind in BOUNDS:
        name, sign = BOUNDS[kind]
        return "is out of range", f"{sign} {facts[name]:g}"
    if kind == "literal_error":
        return "is not one of the allowed words", str(facts["expected"])
    if kind == "finite_number":
        return "is not finite", "a finite number"
    if kind == "too_long":
        return "is too long", f"at most {facts['max_length']}"
    if kind in ("string_too_short", "too_short"):
        return "is empty" if facts["min_length"] == 1 else "is too short", f"at least {facts['min_length']}"
    return f"cannot be used: {message}", None


def called(path: KeyPath) -> str:
    """A place in words: ('targets', 'psd', 'guess_mm', 1) is 'item 2 of targets.psd.guess_mm'."""
    if not path:
        return "the content"
    if isinstance(path[-1], int):
        return f"item {path[-1] + 1} of {called(path[:-1])}"
    names = [str(part) if isinstance(part, str) else f"[{part + 1}]" for part in path]
    return ".".join(names).replace(".[", "[")


def _inside(path: KeyPath) -> str:
    return f" in {called(path)}" if path else ""


def _key_path(data: object, loc: tuple[int | str, ...], kind: str) -> KeyPath:
    """pydantic's location without the names of the alternatives that it tried on the way."""
    path: list[str | int] = []
    for i, part in enumerate(loc):
        keys = data if isinstance(data, dict) else range(len(data)) if isinstance(data, list | tuple) else ()
        if part in keys:
            data = data[part]  # type: ignore[index]
        elif i < len(loc) - 1 or kind != "missing":
            continue
        path.append(part)
    return tuple(path)


def _keys_at(model: type[BaseModel], path: KeyPath) -> list[str]:
    """Names of the keys that the model allows at a place."""
    models: list[type[BaseModel]] = [model]
    for part in path:
        inner: list[type[BaseModel]] = []
        for candidate in models:
            for name, field in candidate.model_fields.items():
                if (field.alias or name) == part:
                    inner += _models_in(field.annotation)
        # An item of a list or a name in a mapping: the models in question stay the same.
        models = inner or models
    return list(
        dict.fromkeys(
            field.alias or name for candidate in models for name, field in candidate.model_fields.items()
        )
    )


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and not get_origin(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Annotated, Union, types.UnionType, tuple, list, dict):
        return [model for inner in get_args(annotation) for model in _models_in(inner)]
    return []
