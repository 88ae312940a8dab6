"""A study in the terminal: the same words and roundings as HTML and PDF."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...experiments.studies.answer import StudyAnswer
from ...experiments.studies.coverage import CoveragePlan, CoverageStudy, Estimator
from ...words.wording import clipped, counted, label, listed, sentence, shown
from ..style.rich_console import LONGEST_NAME, MARK, STYLE, marked, note, print_block
from .coverage_page import OVERVIEW, comparison
from .kinds import study_page
from .study_blocks import (
    BY_CHANCE,
    NOT_DETERMINED,
    Marked,
    percent,
    share,
    share_interval,
    standing,
    undetermined,
    worst_at,
)


def print_study(out: Console, answer: StudyAnswer) -> None:
    """Verdict and notes, then the first section of the study's page, or what it has of its own for this."""
    page = study_page(answer)
    verdict = page.verdict
    style = "bold blue" if verdict.key == "pass" else "bold yellow"
    out.print(Text(f"{verdict.word}. ", style=style) + Text(verdict.sentence))
    for text in page.notes:
        out.print(note(text))
    if isinstance(answer, CoverageStudy):
        _print_coverage(out, answer)
        return
    for block in page.sections[0].all:
        print_block(out, block)


# ── coverage ──────────────────────────────────────────────────────────────────────────────────


def _print_coverage(out: Console, answer: CoverageStudy) -> None:
    """For each plan and estimator the worst-covered parameter of each level."""
    out.print(Text(f"{OVERVIEW}, with its 95 % binomial interval", style="italic"))
    out.print(Text(BY_CHANCE, style="dim"))
    levels = answer.settings.levels
    for plan in answer.plans:
        out.print()
        out.print(Text(f"Plan {clipped(plan.name, 60)}", style="bold") + Text(_about(plan)))
        out.print(_coverage(plan, levels))
        if without := undetermined(plan.estimators):
            style = STYLE["unidentifiable"]
            out.print(
                Text(f"{MARK['unidentifiable']} {NOT_DETERMINED}: ", style=style) + Text(listed(without))
            )
        for part in plan.sbc:
            # The sentence says what the ranks are; the mark, whether that is as it must be.
            ranks = Text(f"Ranks, {clipped(part.name, LONGEST_NAME)}: ")
            out.print(ranks + _standing(part) + Text(f". {sentence(part.sentence)}"))
    if text := comparison(answer.plans):
        out.print()
        out.print(Text(text))


def _about(plan: CoveragePlan) -> str:
    failed = f", {plan.failed} targets not hit" if plan.failed else ""
    return (
        f": {sentence(plan.words)} ({counted(plan.shots, 'measurement')} of {shown(plan.robot)},"
        f" {plan.data_sets} data sets{failed})"
    )


def _coverage(plan: CoveragePlan, levels: Sequence[float]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("estimator")
    for level in levels:
        table.add_column(percent(level), justify="right", no_wrap=True)
    for estimator in plan.estimators:
        name = Text(clipped(estimator.name, LONGEST_NAME) + "\n") + _standing(estimator)
        table.add_row(name, *(_worst(estimator, level) for level in levels))
    return table


def _worst(estimator: Estimator, level: float) -> Text:
    worst = worst_at(estimator, level)
    if worst is None:
        return Text(NOT_DETERMINED, style=STYLE["unidentifiable"])
    row, entry = worst
    style = "" if entry.agrees else STYLE["held" if estimator.control else "weak"]
    return Text(
        f"{label(row.name, 6)}: {share(entry)}\n{share_interval(entry.low, entry.high, entry.of)}",
        style=style,
    )


def _standing(part: Marked) -> Text:
    mark, words = standing(part)
    return marked(mark, words)
