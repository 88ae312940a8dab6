"""An entry a finding: how grave it is, what it says, what to do, what it silences; and the message that is
chosen by a table of them, from the gravest down, and by nothing else. `catalogue.py` has the table of runs,
`plan_catalogue.py` that of plans.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

from ..analysis.answer.answer_message import Action, Grade, May, Message, WorstOffset
from ..analysis.observability.causes import AsGoodAs, NullDirection, worst_direction
from ..analysis.observability.check import PlanVerdict
from ..analysis.status import Status
from ..model.instruments.kind import Assumption
from .geometry_words import by_tolerances
from .observability import reason
from .wording import WEAK, Namer, capital, ended, joints, listed, person, sentence

VERDICT_WORDS: dict[PlanVerdict, str] = {
    "pass": "Pass",
    "weak": capital(WEAK),
    "degenerate": "Degenerate",
    "misfit": "Misfit",
    "violated": "Constraints violated",
}
_MOST_SAID = 7
MOST_CAUTIONS = 3  # on page one
_MOST_REASONS = 2
NONE_ESTIMATED = "No offset is estimated: all are held."


def said_word(word: str, simulated: bool) -> str:
    """The word of a verdict, of a simulated run as such."""
    return f"Simulated: {word.lower()}" if simulated else word


# `stop`: no value of the answer is relied on. `doubt`: none is entered yet. `note`: it is said.
Gravity = Literal["stop", "doubt", "note"]
Standing = Literal["cause or caution", "cause", "caution", "before the cause", "nowhere"]
About = Literal["model", "measurements", "values", "file"]


class _Answer(Protocol):
    @property
    def findings(self) -> Sequence[object]: ...
    @property
    def verdict(self) -> PlanVerdict: ...


A = TypeVar("A", bound=_Answer)


@dataclass(frozen=True)
class FindingEntry(Generic[A]):
    """`finding` is its type, or a name for what `found` finds in an answer.

    `sentence`, `remedy` and `command` are made of a finding and the answer that has it; a remedy may always
    be the same. Without `sentence` a text says itself, all else nothing. The sentence of a note is a caution;
    of what is graver it is the cause of an answer that has nothing graver yet, else a caution; `place` is
    another place. `silences` is what nothing is said about beside it, `colour` the grade of a pass that has
    it first.
    """

    finding: type | str
    grade: Gravity
    sentence: Callable[[Any, A], str | None] | None = None
    remedy: Callable[[Any, A], str] | str | None = None
    command: Callable[[Any, A], str | None] | None = None
    place: Standing | None = None
    about: About = "values"
    silences: frozenset[About] = frozenset()
    colour: Grade | None = None
    found: Callable[[A], Iterable[Any]] | None = None

    def of(self, answer: A) -> Iterable[Any]:
        """The findings of an answer that this is the entry of."""
        if self.found is not None:
            return self.found(answer)
        return (one for one in answer.findings if type(one) is self.finding)


class FindingRow(NamedTuple):
    """A finding of an answer with its entry."""

    entry: FindingEntry[Any]
    finding: Any

    @property
    def stands(self) -> Standing:
        return self.entry.place or ("caution" if self.entry.grade == "note" else "cause or caution")

    def sentence(self, answer: Any) -> str | None:
        """What is said of it, without a full stop at its end."""
        if self.entry.sentence is not None:
            return self.entry.sentence(self.finding, answer)
        return self.finding if isinstance(self.finding, str) else None

    def action(self, answer: Any) -> Action | None:
        """What to do about it, and the command that does it."""
        remedy, command = self.entry.remedy, self.entry.command
        if remedy is None:
            return None
        text = remedy if isinstance(remedy, str) else remedy(self.finding, answer)
        return Action(text, None if command is None else command(self.finding, answer))


def rows_of(answer: A, table: Sequence[FindingEntry[A]]) -> list[FindingRow]:
    """What is found in an answer, in the order of the table, without what is silenced."""
    rows = [FindingRow(entry, one) for entry in table for one in entry.of(answer)]
    silent = frozenset[About]().union(*(row.entry.silences for row in rows))
    return [row for row in rows if row.entry.about not in silent]


def graded(rows: Sequence[FindingRow], verdict: PlanVerdict) -> tuple[Grade, May]:
    """How an answer with these findings is coloured, and what may be done with it."""
    grades = {row.entry.grade for row in rows}
    colour: Grade = next((row.entry.colour for row in rows if row.entry.colour), "pass")
    certain = "stop" not in grades
    may = May(enter=verdict == "pass" and grades <= {"note"}, certify=certain, export=certain)
    return (colour if verdict == "pass" or verdict == "violated" else verdict), may


def message_by(
    answer: A, table: Sequence[FindingEntry[A]], verdict: str, worst: WorstOffset | None
) -> Message:
    rows = rows_of(answer, table)
    grade, may = graded(rows, answer.verdict)
    cause, cautions = sentences_of(rows, answer)
    return Message(
        verdict=verdict,
        worst=worst,
        cause=cause,
        action=next(action for row in rows if (action := row.action(answer)) is not None),
        cautions=tuple(ended(sentence(text)) for text in cautions)[:_MOST_SAID],
        grade=grade,
        may=may,
    )


def sentences_of(rows: Sequence[FindingRow], answer: object) -> tuple[str | None, list[str]]:
    """The cause, and the cautions: the sentences of what is found, each in its place."""
    causes, cautions, whole = list[str](), list[str](), False
    for row in rows:
        text = row.sentence(answer)
        if text is None:
            continue
        if not whole and row.stands in ("before the cause", "cause", "cause or caution"):
            causes.append(text)
            whole = row.stands != "before the cause"
        elif row.stands in ("caution", "cause or caution"):
            cautions.append(text)
    return (ended(sentence(capital(" ".join(causes)))) if causes else None), cautions


def worst_of(rows: Sequence[Any], k: float, value: Callable[[Any], str]) -> WorstOffset | None:
    """The least well determined of the offsets that are more than assumed, with its expanded uncertainty."""
    row = max(rows, key=lambda row: (row.std is None, row.std or 0.0), default=None)
    if row is None:
        return None
    u = None if row.std is None else k * row.std
    return WorstOffset(row.name, u, row.unit, f"Least well determined: {person(row.name)}, {value(row)}.")


# What tables have in common


def if_(holds: Callable[[A], bool]) -> Callable[[A], Iterator[A]]:
    """A finding that an answer as a whole is."""
    return lambda answer: iter((answer,) if holds(answer) else ())


class Open(NamedTuple):
    """The least well determined offset of a status, and the direction that the measurements leave open; the
    `others` of that status with theirs."""

    row: Any
    direction: NullDirection
    others: tuple[Open, ...] = ()


def open_directions(
    rows: Iterable[Any], null_space: Sequence[NullDirection], status: Status
) -> Iterator[Open]:
    if of_status := [row for row in rows if row.status == status]:
        row = max(of_status, key=lambda row: row.std or 0.0)
        each = {one.name: Open(one, worst_direction(null_space, one.name)) for one in of_status}
        yield each.pop(row.name)._replace(others=tuple(each.values()))


def why_open(one: Open, name: Namer) -> str:
    cause = one.direction.cause
    return by_tolerances(cause, one.row.tolerance_share) or reason(cause, name)


def why_each(one: Open, name: Namer, *, named: bool = False) -> str:
    """The same of all offsets of its status. Where they have several reasons each is said of its offsets, at
    most `_MOST_REASONS`; one reason of all is said of none, or of the first (`named`)."""
    names: dict[str, list[str]] = {}
    for each in (one, *one.others):
        names.setdefault(why_open(each, name), []).append(each.row.name)
    if len(names) == 1:
        (text,) = names
        return f"{name(one.row.name)}: {text}" if named else text
    parts = [f"{listed(joints(of, name))}: {text}" for text, of in names.items()]
    more = [each for of in list(names.values())[_MOST_REASONS:] for each in of]
    rest = [f"{listed(joints(more, name))} for other reasons"] if more else []
    return "; ".join([*parts[:_MOST_REASONS], *rest])


def assumed_of(rows: Iterable[Any]) -> list[tuple[Assumption, ...]]:
    """What each offset rests on that nobody stated or measured."""
    causes = (row.cause for row in rows if row.status == "assumed")
    return [cause.of for cause in causes if isinstance(cause, AsGoodAs)]


def holding(text: str) -> Callable[[str, object], str]:
    return lambda subject_to, answer: f"{text} {subject_to}"


def some(text: str | None) -> Iterable[str]:
    return () if text is None else (text,)
