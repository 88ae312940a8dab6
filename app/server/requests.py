"""What programs and the page send, held to a model; how a refusal and notes are said to them."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, TypeAdapter, create_model

from ...model.errors import BadInput, ZerobeamError
from ...model.parsing.reading import DEEPEST, MOST_VALUES, KeyPath
from ...model.parsing.validation import FileModel, Model, validate
from ...model.records import it, record

Answering = TypeVar("Answering", bound=Callable[..., Any])


@dataclass(frozen=True)
class Precondition:
    """What a request that writes says of the file that is there: the headers If-Match and If-None-Match."""

    match: str | None = None
    none_match: str | None = None

    @classmethod
    def of(cls, headers: Mapping[str, str]) -> Precondition:
        return cls(headers.get("if-match"), headers.get("if-none-match"))


@dataclass(frozen=True)
class EndPoint:
    """`answer` is called with the folder (or the jobs, by the type of its first parameter) and what its other
    parameters say is sent: names in the path, the texts of the query (empty where one is missing), or the
    keys of a JSON object, by a model or each by itself. It returns what is written as JSON, or raises a
    ZerobeamError.

    A coroutine function waits for a process of its own; others are called one at a time. One that has a
    Precondition replaces files: it gets that of the request.
    """

    path: str
    method: str
    says: str
    answer: Callable[..., Any]
    status: int = 200

    @cached_property
    def _function(self) -> Callable[..., Any]:
        function: Callable[..., Any] = inspect.unwrap(self.answer)
        return function

    @cached_property
    def _hints(self) -> Arguments:
        return get_type_hints(self._function, include_extras=True)

    @cached_property
    def of(self) -> object:
        """The type of its first parameter."""
        return self._hints.get(next(iter(inspect.signature(self._function).parameters)))

    @cached_property
    def in_path(self) -> tuple[str, ...]:
        """The names in the path."""
        return tuple(re.findall(r"{(\w+)}", self.path))

    @cached_property
    def _sent(self) -> dict[str, tuple[Any, Any]]:
        """Type and default (...: none) of what else is sent, by the parameter."""
        _, *parameters = inspect.signature(self._function).parameters.values()
        return {
            one.name: (self._hints[one.name], ... if one.default is one.empty else one.default)
            for one in parameters
            if self._hints[one.name] is not Precondition and one.name not in self.in_path
        }

    @property
    def query(self) -> tuple[str, ...]:
        """The names of the query."""
        return tuple(self._sent) if self.method == "GET" else ()

    @cached_property
    def conditional(self) -> bool:
        """Whether it replaces files."""
        return Precondition in self._hints.values()

    @cached_property
    def _model(self) -> type[BaseModel] | None:
        """The model that alone is sent."""
        kinds = [kind for kind, _ in self._sent.values()]
        one = len(kinds) == 1 and isinstance(kinds[0], type) and issubclass(kinds[0], BaseModel)
        return kinds[0] if one else None

    @cached_property
    def sent(self) -> type[BaseModel] | None:
        """The model of what is sent; None where nothing is."""
        if self.method in ("GET", "DELETE") or self._model is not None:
            return self._model
        name = "".join(word.capitalize() for word in re.findall(r"\w+", self.path.removeprefix("/api")))
        fields: Any = self._sent
        return create_model(f"{name}Request", __base__=FileModel, __doc__=self.says, **fields)

    def arguments(self, named: Mapping[str, str], content: Any, headers: Mapping[str, str]) -> Arguments:
        """The arguments of `answer` behind the first, `named` in path and query; Refused with the key of what
        is wrong."""
        arguments: Arguments = {name: named.get(name, "") for name in (*self.in_path, *self.query)}
        if self.sent is not None:
            sent = as_model(self.sent, content)
            arguments |= {next(iter(self._sent)): sent} if self._model is not None else dict(sent)
        if self.conditional:
            arguments["precondition"] = Precondition.of(headers)
        return arguments

    @cached_property
    def returned(self) -> TypeAdapter[Any]:
        """What `answer` returns, by its annotation: how it is written, and its schema."""
        return TypeAdapter(self._hints["return"])


END_POINTS: list[EndPoint] = []
"""In the order in which the modules of the answers are loaded."""


def end_point(route: str, says: str, *, status: int = 200) -> Callable[[Answering], Answering]:
    """Make a function the answer of an end point: `route` is its method and path, `says` what it is for."""
    method, path = route.split()

    def added(answer: Answering) -> Answering:
        END_POINTS.append(EndPoint(path, method, says, answer, status))
        return answer

    return added


Answer = TypeVar("Answer")
Content = dict[str, Any]  # of a YAML file, as it is sent
Arguments = Content  # of a function, by name


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


def wrong(key: KeyPath, what: str, found: object, allowed: object) -> Refused:
    """The refusal of a value that was sent."""
    return refused(BadInput(what, found=found, allowed=allowed), key)


@contextmanager
def at_key(*key: str | int) -> Iterator[None]:
    """Within, bad input is what was sent by this key."""
    try:
        yield
    except BadInput as error:
        same = refused(error, key)
        same.line = error.line
        raise same from error


@record(kw_only=True)
class ErrorFacts:
    """What is wrong."""

    what: str
    found: str | None = None
    allowed: str | None = None
    to_do: str | None = None
    key: Annotated[list[str | int] | None, it("leads to the value in what was sent")] = None


@record(kw_only=True)
class ErrorAnswer:
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
