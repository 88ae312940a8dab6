"""What the terminal shows of an analysis, of a run that ended, and of several results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ...analysis.answer.result import LikelihoodSummary, Result
from ...analysis.solution import ParameterResult
from ...words import numbers
from ...words.entries import MOST_CAUTIONS
from ...words.geometry_words import worth_sentence
from ...words.message import WHAT_ELSE, message, verdict_words
from ...words.provenance import BAND, is_simulated, true_values
from ...words.run_argument import run_argument
from ...words.wording import counted, ended, joints, listed, sentence, shown
from ..style.blocks import (
    Cell,
    Directions,
    Page,
    Paragraph,
    Section,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)
from .fit_section import diagnosis_section, hold_out_section, intervals_section, robust_section
from .front import front, offsets_front, outlook_section
from .geometry_section import geometry_lines
from .parameter_section import (
    errors_sentence,
    offsets_table,
    offsets_worth,
    other_tables,
    rehearsal_section,
    truth_table,
)
from .placement_section import placements_lines, predicted_run_section
from .posterior_summary import posterior_sentence
from .unobservable import direction_words

if TYPE_CHECKING:
    from ...experiments.procedure.events import Ended
from ...words.message import next_steps
from ..style.blocks import Block, Commands


def next_steps_section(result: Result) -> Section | None:
    """The section of the report; None where the message says it all."""
    content = message(result)
    advice = next_steps(result, content)
    blocks: list[Block] = []
    if advice.enter and content.may.enter:
        blocks.append(
            Paragraph("Enter the values of page one: corrected reading = recorded position + value.")
        )
    for step in advice.steps[1:]:
        blocks.append(Paragraph(step.text))
        if step.commands:
            blocks.append(Commands(step.commands))
    return section_of("What to do next", *blocks) if blocks else None


def page_of(
    title: str,
    subtitle: str,
    result: Result,
    sections: Sequence[Section | None] = (),
    *,
    remedies: bool = True,
) -> Page:
    """A page on a result: what is read first, then sections; without `remedies` where those have all."""
    content = message(result)
    first = replace(content, cautions=content.cautions[:MOST_CAUTIONS])
    more = content.cautions[MOST_CAUTIONS:]
    also = section_of(WHAT_ELSE, *map(Paragraph, more)) if more else None
    folds = next((k for k, one in enumerate(sections) if one is not None and one.folded), len(sections))
    present = [*sections[:folds], also, *sections[folds:]]
    return Page(
        title,
        subtitle,
        Verdict(content.grade or "held", "", ""),
        [],
        [section for section in present if section is not None],
        message=first,
        front=front(result, content, remedies=remedies),
        band=BAND if is_simulated(result.inputs.provenance) else "",
    )


def front_page(result: Result, title: str = "", subtitle: str = "") -> Page:
    """The answer of `analyse`: what is read first, and what was asked for besides."""
    besides = [robust_section(result), hold_out_section(result), predicted_run_section(result)]
    return replace(page_of(title, subtitle, result), sections=[each for each in besides if each is not None])


def brief_page(result: Result) -> Page:
    """The same with parameters, what cannot be determined, fit, second opinions: `--full`. What follows from
    a wrong model is not shown."""
    wrong = result.misfit is not None
    worth = offsets_worth(result) if result.geometry.tolerance is not None else None
    details = [] if wrong else other_tables(result.parameters, result.coverage_factor)
    directions = Directions([direction_words(each) for each in result.identifiability.null_space])
    posterior = ended(posterior_sentence(result))
    if result.posterior.converged:
        posterior = f"Posterior: {posterior}"
    sections = [
        diagnosis_section(result),
        section_of("", offsets_table(result), *_paragraphs(worth, *geometry_lines(result)), *details),
        rehearsal_section(result),
        next_steps_section(result),
        outlook_section(result),
        None if wrong or not directions.items else section_of("What cannot be determined", directions),
        section_of(
            "Fit",
            *_paragraphs(_fit_sentence(result.likelihood), *placements_lines(result)),
            *_paragraphs(None if wrong else posterior),
        ),
        robust_section(result),
        hold_out_section(result),
        predicted_run_section(result),
        None if wrong else intervals_section(result),
    ]
    return page_of("", "", result, sections, remedies=False)


def ended_page(answer: Ended) -> Page:
    """The end of `run`: offsets, what was measured and how long it took, what to do next."""
    table = []
    if answer.parameters and not answer.verifies and answer.verdict != "misfit":
        rows = [row for row in answer.parameters if row.name in answer.tolerance]
        limits = {row.unit: answer.tolerance[row.name] for row in rows}
        table = [offsets_front(answer.parameters, answer.coverage_factor, limits)]
    content, geometry, worth = answer.message, answer.geometry, None
    if geometry is not None and geometry.tolerance is None and answer.verdict != "misfit":
        worth = worth_sentence(geometry, answer.parameters, answer.coverage_factor)
    return Page(
        "",
        "",
        Verdict(content.grade or "held", "", ""),
        [sentence(note) for note in answer.notes],
        [
            section_of(
                "",
                *_paragraphs(worth),
                *_rehearsed(answer),
                *_paragraphs(*_measured(answer)),
                *_reported(answer),
            )
        ],
        message=replace(content, cautions=content.cautions[:MOST_CAUTIONS]),
        front=table,
    )


def _rehearsed(answer: Ended) -> list[Paragraph]:
    """Of a simulated arm, whether the true offsets are within U."""
    k = answer.coverage_factor
    if (
        answer.verifies
        or answer.verdict == "misfit"
        or truth_table(answer.true, answer.parameters, k) is None
    ):
        return []
    return _paragraphs(
        f"True offsets of the simulated arm: {errors_sentence(answer.true, answer.parameters, k)}"
    )


def _reported(answer: Ended) -> list[Commands]:
    return [] if answer.verifies else [Commands([f"zerobeam report {run_argument(answer.file)} -o report"])]


def _measured(answer: Ended) -> Iterator[str]:
    """What was measured, a sentence each. What was found at a refused measurement is in the notes."""
    if answer.consistent and answer.p_value is not None and not answer.verifies:
        yield f"p-value of the residuals under the stated noise: {numbers.p_value(answer.p_value)}."
    refused = [f"{item.shot} ({shown(item.reason.value)})" for item in answer.refused]
    missing = f"; not recorded: {listed([str(i) for i in answer.missing], 99)}" if answer.missing else ""
    yield (
        f"{counted(len(answer.shots), 'measurement')} recorded"
        f"{f'; refused: {listed(refused)}' if refused else ', none refused'}{missing}."
    )
    if answer.saved is not None and not answer.missing:
        yield f"Adaptive: {counted(answer.saved, 'measurement')} saved; {sentence(answer.why or '')}."
    if any(answer.seconds.values()):
        phases = [f"{name} {numbers.significant(value, 2)}" for name, value in answer.seconds.items()]
        whole = numbers.significant(sum(answer.seconds.values()), 2, "s")
        yield f"This session took {whole}: {', '.join(phases)}."
    if not answer.verifies:
        yield "Intervals from the posterior:"


def side_by_side(titles: Sequence[str], results: Sequence[Result]) -> Table:
    """The offsets of several results next to each other, beside the true ones where all are simulations of
    one arm."""
    rows = [{row.name: row for row in result.parameters if row.group == "offset"} for result in results]
    true = [true_values(result.inputs.provenance) for result in results]
    alike = {name: value for name, value in true[0].items() if all(one.get(name) == value for one in true)}
    table = [
        row_of(
            *joints([name]),
            *([numbers.fixed(alike[name], 2) if name in alike else ""] if alike else []),
            *(_compared(by_name.get(name), result) for by_name, result in zip(rows, results, strict=True)),
        )
        for name in dict.fromkeys(name for by_name in rows for name in by_name)
    ]
    verdicts = (
        verdict_words(result.verdict, message(result), is_simulated(result.inputs.provenance))
        for result in results
    )
    table.append(row_of("", *([""] if alike else []), *verdicts))
    columns = ["joint", *(["true"] if alike else []), *titles]
    return table_of("Offsets ± U (k = 2), degrees or mm", columns, table, "lr")


def _compared(row: ParameterResult | None, result: Result) -> Cell | str:
    if row is None:
        return ""
    if row.held or row.status == "assumed":
        return Cell(row.status)
    if row.estimate is None or row.std is None:
        return Cell("open", mark=row.status)
    u = result.coverage_factor * row.std
    return Cell(f"{numbers.estimate(row.estimate, u)} ± {numbers.spread(u)}", mark=row.status)


def _paragraphs(*texts: str | None) -> list[Paragraph]:
    return [Paragraph(text) for text in texts if text]


def _fit_sentence(fit: LikelihoodSummary) -> str:
    text = (
        f"Residuals {numbers.length_and_angle(fit.rms_mm, fit.rms_deg)} rms"
        f" (before: {numbers.length_and_angle(fit.rms_before_mm, fit.rms_before_deg)})"
    )
    if fit.p_value is not None:
        text += f", χ² {numbers.significant(fit.chi2, 3)}, {fit.dof} dof (p {numbers.p_value(fit.p_value)})"
    if fit.noise_scale is not None:
        text += f", noise {numbers.significant(fit.noise_scale, 3)} times the stated"
    return text + "."
