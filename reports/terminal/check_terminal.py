"""The answer of `check` in the terminal, and what it has in common with other answers."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...analysis.answer.answer_message import Action, Message
from ...analysis.observability.causes import NullDirection
from ...analysis.observability.check import Check, PlanVerdict
from ...words import numbers
from ...words.geometry_words import check_lines
from ...words.numbers import unit_of
from ...words.observability import outlook_lines
from ...words.plan_message import plan_action
from ...words.verdict import VERDICT_WORDS, check_headline, check_notes
from ...words.wording import ended, label, person, sentence
from ..run.parameter_section import worth_column
from ..run.unobservable import direction_words
from ..style.rich_console import VERDICT_STYLE, marked, note


def print_check(console: Console, check: Check) -> None:
    """The answer of `check`: verdict, predicted standard uncertainties, null-space directions, notes."""
    print_verdict(console, check.verdict, check_headline(check, person))
    print_notes(console, [sentence(note) for note in check_notes(check)])
    if check.violations:
        print_action(console, plan_action(check))
    console.print(Text("What this plan will determine", style="italic"))
    table = Table(box=None, pad_edge=False)
    worth, of = worth_column(check.geometry)
    worth = "\n".join(textwrap.wrap(worth, 10))
    for name in ("name", "predicted u", worth, "without prior", "prior", "status"):
        table.add_column(name, justify="left" if name in ("name", "status") else "right")
    for row in check.parameters:
        unit = unit_of(row.unit)
        if row.tolerated:
            continue
        alone = "infinite" if row.data_std is None else numbers.spread(row.data_std, unit)
        table.add_row(
            label(row.name),
            "—" if row.std is None else numbers.spread(row.std, unit),
            of(row) if row.group == "offset" or check.geometry.tolerance is not None else "",
            "—" if row.held else alone,
            numbers.spread(row.prior_std, unit),
            marked(row.status, row.status),
        )
    console.print(table)
    for line in check_lines(check):
        console.print(Text(line))
    print_directions(console, check.identifiability.null_space)
    for line in outlook_lines(check):
        console.print(Text(line))
    off = max(posture.off_mm for posture in check.postures)
    if off > 0.05:
        console.print(
            Text(
                f"The postures point up to {numbers.significant(off, 2, 'mm')} away from the target;"
                " the plan is judged with the wrist turned onto it."
            )
        )


def print_verdict(console: Console, verdict: PlanVerdict, headline: str) -> None:
    """A verdict with its sentence."""
    console.print(
        Text(f"{VERDICT_WORDS[verdict]}. ", style=VERDICT_STYLE[verdict]) + Text(sentence(headline))
    )


def print_message(console: Console, message: Message) -> None:
    """The message of an answer: what is read first. One without a grade is grey."""
    console.print(Text(sentence(message.verdict), style=VERDICT_STYLE[message.grade or "held"]))
    for text in (message.cause, None if message.worst is None else message.worst.text):
        if text is not None:
            console.print(Text(sentence(text)))
    print_action(console, message.action)
    for text in message.basis:
        console.print(Text(sentence(text), style="dim"))
    print_notes(console, message.cautions)


def print_action(console: Console, action: Action) -> None:
    """What to do, and the command that does it."""
    console.print(Text("To do: ", style="bold") + Text(sentence(action.text)))
    if action.command is not None:
        print_commands(console, (action.command,))


def print_commands(console: Console, commands: Iterable[str]) -> None:
    """Commands as they are to be typed."""
    for line in commands:
        width = max(console.width - 8, 20)
        wrapped = textwrap.wrap(line, width, break_long_words=False, break_on_hyphens=False)
        for part in " \\\n     ".join(wrapped).splitlines():
            console.print(Text(f"   {part}"), soft_wrap=True)


def print_notes(console: Console, notes: Iterable[str]) -> None:
    """What a reader must see."""
    for text in notes:
        console.print(note(ended(text)))


def print_directions(console: Console, directions: Sequence[NullDirection]) -> None:
    """What cannot be determined, why, and what to do."""
    for direction in directions:
        words = direction_words(direction)
        console.print(
            Text("✕ " if direction.kind == "exact" else "◆ ", style="bold")
            + Text(f"{words.combination}: {words.kind}")
        )
        facts = Table.grid(padding=(0, 1))
        facts.add_row("  why:", Text(words.reason))
        facts.add_row("  to do:", Text(words.remedy))
        console.print(facts)
