"""What a person reads in the terminal: the same words and roundings as HTML and PDF."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...analysis.answer.result import LikelihoodSummary, Result
from ...analysis.solution import ParameterResult
from ...words import numbers
from ...words.geometry_words import worth_sentence
from ...words.judgement import verdict_words
from ...words.message import judged, message
from ...words.verdict import check_headline
from ...words.wording import counted, ended, label, listed, person, sentence, shown
from ..run.fit_section import diagnosis_section, hold_out_section, intervals_section, robust_section
from ..run.geometry_section import geometry_lines
from ..run.next_steps_section import next_steps_section
from ..run.parameter_section import (
    NO_NUMBER,
    errors_sentence,
    offsets_caption,
    offsets_table,
    offsets_worth,
    other_tables,
    rehearsal_section,
    truth_table,
    worth_column,
)
from ..run.placement_section import placements_lines
from ..run.posterior_summary import posterior_sentence
from ..run.predicted_run_section import predicted_run_section
from ..style import blocks
from ..style.rich_console import MARK, STYLE, VERDICT_STYLE, marked, rich_table
from .check_terminal import print_commands, print_directions, print_message, print_notes, print_verdict

if TYPE_CHECKING:
    from ...experiments.plans.make import MadePlan
    from ...experiments.procedure.events import Ended

_MOST_ROWS = 40


def print_result(console: Console, result: Result) -> None:
    """The answer of `analyse`: the message, then parameters, what cannot be determined, fit, second
    opinions. What follows from a wrong model is not shown."""
    print_message(console, message(result))
    wrong = result.misfit is not None
    if (could_be := diagnosis_section(result)) is not None:
        _print_section(console, could_be)
    _print_table(console, offsets_table(result))
    if (worth := offsets_worth(result)) is not None and result.geometry.tolerance is not None:
        console.print(Text(worth))
    if not wrong:
        for line in geometry_lines(result):
            console.print(Text(line))
        for table in other_tables(result.parameters, result.coverage_factor):
            _print_table(console, table)
    if (rehearsal := rehearsal_section(result)) is not None:
        _print_section(console, rehearsal)
    if (steps := next_steps_section(result)) is not None:
        _print_steps(console, steps, values=result.entered_geometry is not None)
    if not wrong:
        print_directions(console, result.identifiability.null_space)
    console.print(Text(_fit_line(result.likelihood)))
    for line in placements_lines(result):
        console.print(Text(line))
    intervals = None if wrong else intervals_section(result)
    held_out = (hold_out_section(result), predicted_run_section(result))
    for section in (robust_section(result), *held_out, intervals):
        if section is not None:
            _print_section(console, section)
    if not wrong:
        posterior = ended(posterior_sentence(result))
        console.print(Text(f"Posterior: {posterior}" if result.posterior.converged else posterior))


def print_proposal(console: Console, made: MadePlan) -> None:
    """The answer of `plan`: verdict, predicted uncertainties, efficiency, travel, what removed candidates."""
    check = made.checked
    if check is None:
        console.print(Text(" ".join(made.sentences)))
        return
    print_verdict(console, check.verdict, check_headline(check, person))
    table = Table(box=None, pad_edge=False)
    table.add_column("name")
    table.add_column("predicted u", justify="right")
    worth, of = worth_column(check.geometry)
    table.add_column(worth, justify="right")
    offsets = [row for row in check.parameters if row.group == "offset"]
    for row in offsets:
        table.add_row(label(row.name), "—" if row.std is None else numbers.spread(row.std, row.unit), of(row))
    console.print(table)
    if (worth_text := worth_sentence(check.geometry, offsets)) is not None:
        console.print(Text(worth_text))
    if made.proposal is not None:
        for line in made.sentences:
            console.print(Text(line))
        console.print(Text(f"{made.removed}.", style="dim"))


def print_carried(console: Console, answer: Ended) -> None:
    """The end of `run`: message, notes, offsets, what was measured and how long it took, what to do next."""
    print_message(console, answer.message)
    print_notes(console, map(sentence, answer.notes))
    if answer.parameters and not answer.verifies:
        caption = offsets_caption(row.status for row in answer.parameters)
        console.print(Text(caption, style="italic"))
        table = Table(box=None, pad_edge=False)
        shown = None if answer.verdict == "misfit" else answer.geometry
        k = answer.coverage_factor
        worth_text = None if shown is None else worth_sentence(shown, answer.parameters, k)
        worth = [] if worth_text is None or shown is None else [worth_column(shown, k)]
        expanded = [] if answer.verdict == "misfit" else [f"U ({numbers.coverage(k)})"]
        for name in ("name", "estimate", *expanded, *(head for head, _ in worth), "status"):
            table.add_column(name, justify="left" if name in ("name", "status") else "right")
        for row in answer.parameters:
            beside = [of(row) for _, of in worth]
            estimate = u = NO_NUMBER
            if row.status != "unidentifiable" and row.estimate is not None and row.std is not None:
                estimate = numbers.estimate(row.estimate, k * row.std, row.unit)
                u = numbers.spread(k * row.std, row.unit)
            cells = [estimate, *([u] if expanded else []), *beside]
            table.add_row(label(row.name), *cells, marked(row.status, row.status))
        console.print(table)
        if worth_text is not None:
            console.print(Text(worth_text))
        table_of_truth = truth_table(answer.true, answer.parameters, k)
        if table_of_truth is not None and answer.verdict != "misfit":
            _print_table(console, table_of_truth)
            console.print(Text(errors_sentence(answer.true, answer.parameters, k)))
    if answer.consistent and answer.p_value is not None and not answer.verifies:
        p_value = numbers.p_value(answer.p_value)
        console.print(Text(f"p-value of the residuals under the stated noise: {p_value}."))
    console.print(Text(_measured(answer)))
    if answer.saved is not None and not answer.missing:
        saved = counted(answer.saved, "measurement")
        console.print(Text(f"Adaptive: {saved} saved; {sentence(answer.why or '')}."))
    if any(answer.seconds.values()):
        phases = [f"{name} {numbers.significant(value, 2)}" for name, value in answer.seconds.items()]
        whole = numbers.significant(sum(answer.seconds.values()), 2, "s")
        console.print(Text(f"This session took {whole}: {', '.join(phases)}."))
    if not answer.verifies:
        console.print(Text("Intervals from the posterior: zerobeam report RUN -o DIR"))


def contradicted(p_value: float | None) -> Text:
    """The warning that measurements do not agree with the model, or a target with itself."""
    measure = "" if p_value is None else f" (p {numbers.p_value(p_value)})"
    return Text("! ", style="bold yellow") + Text(
        f"The measurements contradict the model{measure}: no estimate or uncertainty can be relied on."
    )


def _measured(answer: Ended) -> str:
    """What was found at a refused measurement is in the notes."""
    line = f"{counted(len(answer.shots), 'measurement')} recorded"
    refused = [f"{item.shot} ({shown(item.reason.value)})" for item in answer.refused]
    line += f"; refused: {listed(refused)}" if refused else ", none refused"
    missing = f"; not recorded: {listed([str(i) for i in answer.missing], 99)}" if answer.missing else ""
    return f"{line}{missing}."


def print_side_by_side(console: Console, titles: Sequence[str], results: Sequence[Result]) -> None:
    """Several results next to each other, with the true values where a simulation states them. What has a
    tolerance in all of them is left out."""
    console.print(Text("Offsets and tool: estimate ± U (k = 2), and the true value", style="italic"))
    table = Table()
    table.add_column("")
    for title in titles:
        table.add_column(title)
    rows = [{row.name: row for row in result.parameters if row.group != "target"} for result in results]
    estimated = (name for by_name in rows for name, row in by_name.items() if not row.tolerated)
    for name in dict.fromkeys(estimated):
        table.add_row(
            label(name),
            *(_compared(by_name.get(name), result) for by_name, result in zip(rows, results, strict=True)),
        )
    worth = [(result.verdict, judged(result)) for result in results]
    verdicts = [Text(verdict_words(word, one), style=VERDICT_STYLE[one.grade]) for word, one in worth]
    table.add_section()
    table.add_row("verdict", *verdicts)
    console.print(table)


def _compared(row: ParameterResult | None, result: Result) -> Text:
    if row is None:
        return Text("")
    true = result.inputs.provenance.get(f"true {row.name} ({row.unit})")
    known = isinstance(true, int | float)
    truth = Text(f"\ntrue {numbers.exact(float(str(true)), row.unit)}" if known else "", style="dim")
    style = STYLE[row.status]
    if row.tolerated and row.estimate is None:
        return Text(f"prior only, u {numbers.exact(row.prior_std, row.unit)}", style="dim")
    if row.estimate is None:
        return Text(f"{MARK[row.status]} not determined", style=style) + truth
    if row.std is None:
        return (
            Text(f"{MARK[row.status]} held at {numbers.exact(row.estimate, row.unit)}", style=style) + truth
        )
    u = result.coverage_factor * row.std
    text = f"{numbers.estimate(row.estimate, u)} ± {numbers.spread(u, row.unit)}"
    return Text(f"{MARK[row.status]} {text}", style=style) + truth


def _print_section(console: Console, section: blocks.Section) -> None:
    """A section of the report in the terminal: its paragraphs after its title, then its table."""
    paragraphs = [block.text for block in section.all if isinstance(block, blocks.Paragraph)]
    console.print(Text(f"{section.title}: {' '.join(paragraphs)}"))
    for block in section.all:
        if isinstance(block, blocks.Table):
            _print_table(console, block)
        elif isinstance(block, blocks.Facts):
            console.print(Text("; ".join(f"{name} {text}" for name, text in block.rows), style="dim"))


def _print_steps(console: Console, section: blocks.Section, values: bool) -> None:
    """What to do: a line a step, commands as they are to be typed; with `values` the table of what to enter,
    which is else in that of the offsets."""
    console.print(Text(section.title, style="italic"))
    for block in section.all:
        if isinstance(block, blocks.Paragraph):
            console.print(Text(block.text))
        elif isinstance(block, blocks.Commands):
            print_commands(console, block.lines)
        elif values and isinstance(block, blocks.Table):
            _print_table(console, block)


def _print_table(console: Console, table: blocks.Table) -> None:
    if len(table.rows) > _MOST_ROWS:
        words = f"{table.caption}: {len(table.rows)}, see --json or the report"
        console.print(Text(words, style="italic"))
        return
    console.print(Text(table.caption, style="italic"))
    console.print(rich_table(table))


def _fit_line(fit: LikelihoodSummary) -> str:
    line = (
        f"Fit: residuals {numbers.length_and_angle(fit.rms_mm, fit.rms_deg)} rms"
        f" (before: {numbers.length_and_angle(fit.rms_before_mm, fit.rms_before_deg)})"
    )
    if fit.p_value is not None:
        line += f", χ² {numbers.significant(fit.chi2, 3)}, {fit.dof} dof (p {numbers.p_value(fit.p_value)})"
    if fit.noise_scale is not None:
        line += f", noise {numbers.significant(fit.noise_scale, 3)} times the stated"
    return line + "."
