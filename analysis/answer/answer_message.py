"""The one message of an answer, as a value: what is shown first everywhere. `words/message.py` makes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..status import Verdict

# How an answer is coloured: a pass is one of a robot that was measured, that meets what it must, and that
# nothing speaks against. `held`: no robot was measured, or no offset is estimated.
Grade = Verdict | Literal["held"]


@dataclass(frozen=True)
class WorstOffset:
    """The least well determined offset: `value` is its expanded uncertainty U in `unit`, None where it is not
    determined; `text` says so."""

    name: str
    value: float | None
    unit: str
    text: str


@dataclass(frozen=True)
class Action:
    """What to do next: one imperative sentence, and the command that does it (None where there is none)."""

    text: str
    command: str | None


@dataclass(frozen=True)
class May:
    """What may be done with an answer: values entered in a controller, a certificate signed,
    files written."""

    enter: bool = False
    certify: bool = False
    export: bool = False


@dataclass(frozen=True)
class Message:
    """What is known (`verdict`), how well (`worst`, None for a misfit), what is wrong or limits it (`cause`,
    None where nothing is), what to do, and what a reader must not miss, the gravest first. `basis`: what was
    stated, and what was assumed with what it does to U. `grade` and `may` follow from the findings
    (`words/catalogue.py`); they are None and nothing in results of earlier versions, and of a plan nothing
    may be entered."""

    verdict: str
    worst: WorstOffset | None
    cause: str | None
    action: Action
    cautions: tuple[str, ...]
    basis: tuple[str, ...] = ()
    grade: Grade | None = None
    may: May = May()
