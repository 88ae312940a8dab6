"""What programs and the page send, held to a model; how a refusal and notes are said to them."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from pydantic import BaseModel, Field, TypeAdapter

from ...model.errors import BadInput, ZerobeamError
from ...model.files.json_document import JsonDocument
from ...model.parsing.reading import DEEPEST, MOST_VALUES, KeyPath
from ...model.parsing.validation import Model, validate


@dataclass(frozen=True)
class EndPoint:
    """`answer` is called with the folder, and with what was sent as the model `sent`, or with the texts of
    the query by the names in `query` (empty where one is missing). It returns a model, or raises a
    ZerobeamError.
    A coroutine function waits for a process of its own; others are called one at a time. One that is
    `conditional` replaces files: it is also called with the Precondition of the request.
    """

    path: str
    method: str
    says: str
    answer: Callable[..., Any]
    sent: type[BaseModel] | None = None
    query: tuple[str, ...] = ()
    conditional: bool = False
    status: int = 200

    @cached_property
    def returned(self) -> TypeAdapter[Any]:
        """What `answer` returns, by its annotation: how it is written, and its schema."""
        hints = get_type_hints(inspect.unwrap(self.answer))
        return TypeAdapter(hints["return"])

    def plain(self, answer: object) -> Any:
        """An answer as JSON has it."""
        return self.returned.dump_python(answer, mode="json", by_alias=True)


Answer = TypeVar("Answer")
Content = dict[str, Any]  # of a YAML file, as it is sent


class Refused(BadInput):
    """Bad input of which the key is known: `key` leads to the value in what was sent."""

    key: KeyPath = ()


def require_plain(content: Any) -> None:
    """BadInput where what was sent is deeper or has more values than a file may, or text that is no UTF-8."""
    level, count = [content], 0
    for _ in range(DEEPEST):
        below: list[Any] = []
        for value in level:
            below += value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
            for text in value if isinstance(value, dict) else (value,):
                if isinstance(text, str) and not _in_utf8(text):
                    raise BadInput(
                        "a text holds half a letter (a lone surrogate)",
                        found=ascii(text[:50]),
                        allowed="text that can be written in UTF-8",
                    )
        level, count = below, count + len(below)
        if count > MOST_VALUES:
            raise BadInput(f"what was sent holds more than {MOST_VALUES} values")
    if level:
        raise BadInput("the values are nested too deeply")


def _in_utf8(text: str) -> bool:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def as_model(model: type[Model], data: Any) -> Model:
    """What was sent, as the model; Refused with the key of what is wrong."""
    return keyed(data, lambda line: validate(model, data, file=None, line=line))


def keyed(
    data: Any, use: Callable[[Callable[[KeyPath], int | None]], Answer], before: KeyPath = ()
) -> Answer:
    """What `use` makes of `data`; it is given what finds the line of a place, as if each had one of its own.

    A BadInput with a line is raised again as Refused, with the place that the line stands for.
    """
    all_keys: list[KeyPath] = []

    def enter(value: Any, keys: KeyPath) -> None:
        all_keys.append(keys)
        inner = (
            value.items() if isinstance(value, dict) else enumerate(value if isinstance(value, list) else ())
        )
        for key, item in inner:
            enter(item, (*keys, key))

    enter(data, ())
    lines = {keys: number for number, keys in enumerate(all_keys, start=1)}

    def line(keys: KeyPath) -> int | None:
        return next((lines[keys[:n]] for n in range(len(keys), -1, -1) if keys[:n] in lines), None)

    try:
        return use(line)
    except BadInput as error:
        raise refused(error, (*before, *all_keys[error.line - 1]) if error.line else before) from error


def refused(error: BadInput, key: KeyPath) -> Refused:
    """The same error with the key of what is wrong, and without the line that stood for it."""
    same = Refused(error.what, found=error.found, allowed=error.allowed, remedy=error.remedy, file=error.file)
    same.key = key
    return same


class ErrorFacts(JsonDocument):
    """What is wrong."""

    what: str
    found: str | None = None
    allowed: str | None = None
    to_do: str | None = None
    key: list[str | int] | None = Field(default=None, description="leads to the value in what was sent")


class ErrorAnswer(JsonDocument):
    """A refusal."""

    error: ErrorFacts


def error_answer(error: ZerobeamError, say: Callable[[str], str] = str) -> ErrorAnswer:
    """An error as the page gets it; `say` has the last word on every text."""
    if not isinstance(error, BadInput):
        return ErrorAnswer(error=ErrorFacts(what=say(str(error))))
    file = None if error.file is None or Path(error.file).name == NOWHERE else error.file
    where = "" if file is None else f"{file}: " if error.line is None else f"{file}, line {error.line}: "
    facts = {"found": error.found, "allowed": error.allowed, "to_do": error.remedy}
    return ErrorAnswer(
        error=ErrorFacts(
            what=say(f"{where}{error.what}"),
            key=list(error.key) or None if isinstance(error, Refused) else None,
            **{name: None if fact is None else say(str(fact)) for name, fact in facts.items()},
        )
    )


NOWHERE = "plan"  # what a plan that is in no file is called


@contextmanager
def noted() -> Iterator[list[str]]:
    """The notes of our own that are given within, for the page instead of the terminal."""
    notes: list[str] = []
    ours = __package__.partition(".")[0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield notes
    notes += [str(note.message) for note in caught if note.category.__module__.startswith(ours)]
