"""What a plan will determine: the verdict, the predicted uncertainties, what remains open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ...analysis.answer.answer_message import Message
from ...analysis.observability.check import Check, CheckedParameter
from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.observability.outlook import COVERAGE
from ...words import numbers
from ...words.entries import MOST_CAUTIONS, VERDICT_WORDS
from ...words.geometry_words import check_lines, worth_sentence
from ...words.numbers import unit_of
from ...words.observability import outlook_lines, remaining
from ...words.plan_catalogue import check_notes, plan_headline, plan_message, planned_anew
from ...words.trust import tolerances_of, trusted
from ...words.wording import joints, label, person, sentence, status_words
from ..run.front import outlook_blocks
from ..run.parameter_section import worth_column
from ..run.unobservable import direction_words
from ..style.blocks import (
    Block,
    Cell,
    Directions,
    Page,
    Paragraph,
    Row,
    Table,
    Verdict,
    plain_page,
    row_of,
    section_of,
    table_of,
)

if TYPE_CHECKING:
    from ...experiments.plans.make import MadePlan

NOT_DETERMINED = "unidentifiable from these measurements"


def check_page(check: Check, *, full: bool = False) -> Page:
    """The answer of `check`: what is read first; if `full` also notes, predicted uncertainties, directions
    and what would help."""
    return _page(check, *predicted_blocks(check), full=True) if full else _page(check)


def predicted_blocks(check: Check, *, alone: bool = False) -> list[Block]:
    """Predicted uncertainties, what would make the plan better, what a run of it detects; unless `alone` also
    the commands that make it better, and the directions that it leaves open."""
    off = max(posture.off_mm for posture in check.postures)
    aimed = (
        f"The postures point up to {numbers.significant(off, 2, 'mm')} away from the target; the plan is"
        " judged with the wrist rotated onto it."
    )
    directions = [direction_words(each) for each in check.identifiability.null_space]
    return [
        predicted_table(check, (row for row in check.parameters if not row.tolerated)),
        *outlook_blocks(check.outlook, check.parameters, None if alone else planned_anew(check), brief=False),
        *map(Paragraph, check_lines(check)),
        *([] if alone else [Directions(directions)]),
        *map(Paragraph, [*outlook_lines(check), *([aimed] if off > 0.05 else [])]),
    ]


def proposal_page(made: MadePlan, *, full: bool = False) -> Page:
    """The answer of `plan`: what is read first, efficiency and travel; if `full` also predicted
    uncertainties, what removed candidates, and what can be hidden beyond the cautions."""
    check, sentences = made.checked, list(made.sentences)
    if check is None:
        return plain_page("", *map(Paragraph, sentences))
    offsets = [row for row in check.parameters if row.group == "offset"]
    worth = worth_sentence(check.geometry, offsets)
    if not full:
        cautioned = remaining(check.power)
        return _page(check, *(Paragraph(each) for each in sentences if each not in cautioned))
    if made.proposal is not None:
        sentences.append(f"{made.removed}.")
    return _page(
        check,
        predicted_table(check, offsets),
        *outlook_blocks(check.outlook, check.parameters, planned_anew(check), brief=False),
        *map(Paragraph, [*([] if worth is None else [worth]), *sentences]),
        full=True,
    )


def _page(check: Check, *blocks: Block, full: bool = False) -> Page:
    """All remedies are among the `blocks` of a `full` page, and said once."""
    notes = [sentence(note) for note in check_notes(check)]
    sections = [section_of("", *blocks)] if blocks else []
    front = check_front(check, remedies=not full)
    return Page("", "", verdict_on(check), notes, sections, message=first_words(check), front=front)


def first_words(check: Check) -> Message:
    """The message with as many cautions as page one has."""
    content = plan_message(check)
    return replace(content, cautions=content.cautions[:MOST_CAUTIONS])


def check_front(check: Check, *, remedies: bool = True) -> list[Block]:
    """The one table and, with `remedies`, what would make the plan better."""
    rows = [row for row in check.parameters if row.group == "offset"]
    columns = ["joint", f"predicted U ({numbers.coverage(COVERAGE)})", "trusted"]
    tolerances = tolerances_of(check.aimed.plan.header.model_dump(include={"tolerance"}))
    table = table_of("", columns, [_front_row(row, tolerances) for row in rows], "lrl")
    better = outlook_blocks(check.outlook, check.parameters, planned_anew(check), brief=True)
    return [table, *better] if remedies else [table]


def _front_row(row: CheckedParameter, tolerances: Mapping[str, float]) -> Row:
    why = Cell(trusted(row, COVERAGE, tolerances), mark=row.status)
    known = not row.held and row.std is not None
    u = numbers.spread(COVERAGE * row.std, unit_of(row.unit)) if known and row.std else "—"
    return row_of(*joints([row.name]), u, why, tone=row.status)


def verdict_on(check: Check) -> Verdict:
    """The verdict on a plan, as a page has it."""
    text = sentence(plan_headline(check, person))
    return Verdict(plan_message(check).grade or "held", VERDICT_WORDS[check.verdict], text)


def predicted_table(check: Check, rows: Iterable[CheckedParameter]) -> Table:
    """The standard uncertainties that a plan will give."""
    columns = ["name", "status", "predicted u", worth_column(check.geometry)[0], "without prior", "prior"]
    caption = "Standard uncertainties u that these measurements will give"
    # The status second, so that a phone shows it without scrolling.
    return table_of(caption, columns, [_predicted_row(row, check.geometry) for row in rows], "llr")


def _predicted_row(row: CheckedParameter, geometry: GeometryResult) -> Row:
    """One unknown. Where it is unidentifiable its row has no number that could be taken for one."""
    status, unit = row.status, unit_of(row.unit)
    name, word = label(row.name), Cell(status_words(status), mark=status)
    if row.held:
        return row_of(name, word, Cell("not estimated", span=4), tone=status)
    if row.std is None:
        return row_of(name, word, Cell(NOT_DETERMINED, span=4), tone=status)
    alone = "infinite" if row.data_std is None else numbers.spread(row.data_std, unit)
    before = numbers.spread(row.prior_std, unit)
    worth = worth_column(geometry)[1](row) if row.group == "offset" or geometry.tolerance is not None else ""
    return row_of(name, word, numbers.spread(row.std, unit), worth, alone, before, tone=status)
