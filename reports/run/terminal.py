"""What a person reads in the terminal: the same words and roundings as HTML and PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ...analysis.status import Verdict
from ...experiments.procedure.events import Ended, KnownOffset
from ..style import blocks
from ..words import numbers
from ..words.wording import clipped, counted, label, listed, sentence, shown
from .view import view
from .view_parameters import unit_of
from .view_unknown import advice_words, direction_kind, over_target_words

Json = dict[str, Any]

STYLE = {"identified": "blue", "weak": "yellow", "unidentifiable": "magenta", "held": "dim"}
MARK = {"identified": "●", "weak": "◆", "unidentifiable": "✕", "held": "■"}
_VERDICT_STYLE = {"pass": "bold blue", "weak": "bold yellow", "degenerate": "bold magenta"}
_VERDICT_WORD = {"pass": "Pass", "weak": "Weak", "degenerate": "Degenerate"}
_MOST_ROWS = 40


def print_result(console: Console, result: Json) -> None:
    """The answer of `analyse`: verdict, notes, parameters, what cannot be known, fit, second opinions."""
    told = view(result)
    print_verdict(console, result)
    for note in told["notes"]:
        console.print(Text("! ", style="bold yellow") + Text(note))
    for table in (told["offsets"], *told["others"]):
        _print_table(console, table)
    _print_directions(console, result["identifiability"]["null_space"])
    console.print(Text(_fit_line(result["fits"])))
    if told["robust"] is not None:
        console.print(Text("Robust fit: " + " ".join(told["robust"]["sentences"])))
        if told["robust"]["table"] is not None:
            _print_table(console, told["robust"]["table"])
    if told["hold_out"] is not None:
        console.print(Text(_held_out_line(result["hold_out"], told["hold_out"]["sentences"])))
    if told["intervals"] is not None:
        _print_table(console, told["intervals"]["table"])
        console.print(Text(told["intervals"]["sentence"], style="dim"))
    console.print(Text("Posterior: " + sentence(result["posterior"]["message"]).rstrip(".") + "."))


def print_check(console: Console, answer: Json) -> None:
    """The answer of `check`: verdict, predicted standard deviations, null directions, notes."""
    print_verdict(console, answer)
    for note in answer["notes"]:
        console.print(Text("! ", style="bold yellow") + Text(sentence(note)))
    console.print(Text("What this plan will tell", style="italic"))
    table = Table(box=None, pad_edge=False)
    for name in ("name", "predicted std", "from the data alone", "known before", "status"):
        table.add_column(name, justify="left" if name in ("name", "status") else "right")
    for row in answer["parameters"]:
        table.add_row(
            label(row["name"]),
            "—" if row["std"] is None else numbers.spread(row["std"], unit_of(row)),
            _data_std(row),
            numbers.spread(row["prior_std"], unit_of(row)),
            _status(row["status"]),
        )
    console.print(table)
    _print_directions(console, answer["identifiability"]["null_space"])
    if answer["advice"] is not None:
        console.print(Text(advice_words(answer["advice"])))
    if answer["over_target"] is not None:
        console.print(Text(over_target_words(answer["over_target"])))
    off = [posture["off_mm"] for posture in answer["postures"]]
    if max(off) > 0.05:
        console.print(
            Text(
                f"The postures point up to {numbers.significant(max(off), 2, 'mm')} beside the target;"
                " the plan is judged with the wrist turned onto it."
            )
        )


def print_proposal(console: Console, answer: Json) -> None:
    """The answer of `plan`: verdict, predicted stds, efficiency, travel, what removed candidates."""
    if answer["check"] is None:
        console.print(
            Text(
                f"No plan of up to {answer['max_shots']} shots brings every standard deviation within"
                f" {numbers.exact(answer['tolerance'])}; with {answer['curve'][-1]['shots']} shots the worst"
                f" is {numbers.spread(answer['curve'][-1]['worst_std'])}. What limits is {answer['limit']}."
            )
        )
        return
    print_verdict(console, answer["check"])
    table = Table(box=None, pad_edge=False)
    table.add_column("name")
    table.add_column("predicted std", justify="right")
    for name, std in answer["predicted_std"].items():
        table.add_row(label(name), "—" if std is None else numbers.spread(std, answer["units"][name]))
    console.print(table)
    if answer["efficiency"] is not None:
        travel = (
            "" if answer["travel_s"] is None else f"; travel {numbers.significant(answer['travel_s'], 2)} s"
        )
        console.print(
            Text(
                f"{answer['shots']} shots by the {answer['criterion']}-criterion: at least"
                f" {answer['efficiency']:.1%} as good as the best choice from {answer['candidates']}"
                f" candidates{travel}."
            )
        )
        console.print(Text(answer["removed"] + ".", style="dim"))


def print_carried(console: Console, answer: Ended) -> None:
    """The end of `run`: verdict, notes, offsets, what was measured and how long it took, what to do next."""
    _print_verdict(console, answer.verdict, answer.headline)
    if not answer.consistent:
        console.print(contradicted(answer.p_value))
    for note in answer.notes:
        console.print(Text("! ", style="bold yellow") + Text(sentence(note)))
    if answer.parameters:
        console.print(Text("Joint offsets, to be added to the recorded joint positions", style="italic"))
        table = Table(box=None, pad_edge=False)
        for name in ("name", "estimate", "std", "status"):
            table.add_column(name, justify="left" if name in ("name", "status") else "right")
        for row in answer.parameters:
            table.add_row(label(row.name), *_estimate_and_std(row), _status(row.status))
        console.print(table)
    if answer.consistent and answer.p_value is not None:
        chance = numbers.p_value(answer.p_value)
        console.print(Text(f"p-value of the residuals under the stated noise: {chance}."))
    console.print(Text(_measured(answer)))
    if answer.saved is not None:
        saved = counted(answer.saved, "measurement")
        console.print(Text(f"Adaptive: {saved} saved; {sentence(answer.why or '')}."))
    if any(answer.seconds.values()):
        console.print(Text(_seconds_line(answer.seconds)))
    console.print(Text("Intervals from the posterior: zerobeam report RUN -o DIR"))


def contradicted(p_value: float | None) -> Text:
    """The warning that shots do not agree with the model, or a target with itself."""
    chance = "" if p_value is None else f" (p {numbers.p_value(p_value)})"
    return Text("! ", style="bold yellow") + Text(
        f"The shots contradict the model{chance}: no estimate or std can be relied on."
    )


def _estimate_and_std(row: KnownOffset) -> tuple[str, str]:
    if row.status == "unidentifiable" or row.estimate is None or row.std is None:
        return "—", "—"
    return numbers.estimate(row.estimate, row.std, row.unit), numbers.spread(row.std, row.unit)


def _measured(answer: Ended) -> str:
    """What was found at a refused measurement stands in the notes."""
    line = f"{counted(len(answer.shots), 'measurement')} recorded"
    refused = [f"{item.shot} ({shown(item.reason.value)})" for item in answer.refused]
    return f"{line}; refused: {listed(refused)}." if refused else f"{line}, none refused."


def _seconds_line(seconds: Mapping[str, float]) -> str:
    phases = ", ".join(f"{name} {numbers.significant(value, 2)}" for name, value in seconds.items())
    return f"This session took {numbers.significant(sum(seconds.values()), 2, 's')}: {phases}."


def print_side_by_side(console: Console, titles: Sequence[str], results: Sequence[Json]) -> None:
    """Several results next to each other, with the true values where a simulation states them."""
    console.print(Text("Offsets and tool: estimate ± standard deviation, and the true value", style="italic"))
    table = Table()
    table.add_column("")
    for title in titles:
        table.add_column(title)
    names = list(
        dict.fromkeys(r["name"] for result in results for r in result["parameters"] if r["group"] != "target")
    )
    for name in names:
        cells = [_compared(result, name) for result in results]
        table.add_row(label(name), *cells)
    verdicts = [Text(result["verdict"], style=_VERDICT_STYLE[result["verdict"]]) for result in results]
    table.add_section()
    table.add_row("verdict", *verdicts)
    console.print(table)


def _compared(result: Json, name: str) -> Text:
    row = next((r for r in result["parameters"] if r["name"] == name), None)
    if row is None:
        return Text("")
    provenance = result["inputs"]["header"].get("provenance", {})
    true = provenance.get(f"true {name} ({row['unit']})")
    told = Text("" if true is None else f"\ntrue {numbers.exact(true, row['unit'])}", style="dim")
    if row["status"] == "unidentifiable":
        return Text("✕ not determined", style=STYLE["unidentifiable"]) + told
    if row["status"] == "held":
        return Text(f"■ held at {numbers.exact(row['estimate'], row['unit'])}", style=STYLE["held"]) + told
    if row["estimate"] is None:
        return Text("no estimate") + told
    text = (
        f"{MARK[row['status']]} {numbers.estimate(row['estimate'], row['std'])}"
        f" ± {numbers.spread(row['std'], row['unit'])}"
    )
    return Text(text, style=STYLE[row["status"]]) + told


def print_verdict(console: Console, answer: Json) -> None:
    """The verdict of a result or a check with its sentence, and the remedy where it is not a pass."""
    _print_verdict(console, answer["verdict"], answer["headline"])


def _print_verdict(console: Console, verdict: Verdict, headline: str) -> None:
    text = Text(_VERDICT_WORD[verdict] + ". ", style=_VERDICT_STYLE[verdict])
    console.print(text + Text(sentence(headline)))


def _print_table(console: Console, told: blocks.Table) -> None:
    if len(told.rows) > _MOST_ROWS:
        words = f"{told.caption}: {len(told.rows)}, see --json or the report"
        console.print(Text(words, style="italic"))
        return
    console.print(Text(told.caption, style="italic"))
    console.print(_table(told))


def _table(told: blocks.Table) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in told.columns:
        table.add_column(escape(column.text), justify="right" if column.align == "right" else "left")
    for row in told.rows:
        cells: list[Text] = []
        for cell in row.cells:
            cells.append(_status(cell.mark) if cell.mark else Text(cell.text))
            cells.extend(Text("") for _ in range(cell.span - 1))
        table.add_row(*cells)
    return table


def _status(status: str) -> Text:
    return Text(f"{MARK[status]} {status}", style=STYLE[status])


def _data_std(row: Json) -> str:
    if row["held"]:
        return "—"
    return "infinite" if row["data_std"] is None else numbers.spread(row["data_std"], unit_of(row))


def _print_directions(console: Console, directions: Sequence[Json]) -> None:
    for direction in directions:
        terms = list(direction["combination"].items())
        shown = ", ".join(f"{label(name)} {numbers.significant(weight, 2)}" for name, weight in terms[:4])
        more = f" and {len(terms) - 4} more" if len(terms) > 4 else ""
        console.print(
            Text("✕ " if direction["kind"] == "exact" else "◆ ", style="bold")
            + Text(f"{shown}{more}: {direction_kind(direction)}")
        )
        facts = Table.grid(padding=(0, 1))
        facts.add_row("  why:", Text(sentence(direction["reason"])))
        facts.add_row("  to do:", Text(sentence(direction["remedy"])))
        console.print(facts)


def _held_out_line(held_out: Json, sentences: Sequence[str]) -> str:
    misses = ""
    if held_out["rms_mm"] is not None:
        misses = (
            f"misses {numbers.significant(held_out['rms_mm'], 3)} mm rms"
            f" (without offsets: {numbers.significant(held_out['rms_before_mm'], 3)} mm). "
        )
    names = listed([clipped(name, 24) for name in held_out["targets"]])
    # The first sentence says what holding out is, for those who did not ask for it.
    return f"Held out, {names}: {misses}{' '.join(sentences[1:])}"


def _fit_line(fits: Json) -> str:
    fit = fits["likelihood"]
    line = (
        f"Fit: misses {numbers.significant(fit['rms_mm'], 3)} mm rms"
        f" (before: {numbers.significant(fit['rms_before_mm'], 3)} mm)"
    )
    if fit["p_value"] is not None:
        line += (
            f", chi-squared {numbers.significant(fit['chi2'], 3)} for {fit['dof']} degrees of freedom"
            f" (p {numbers.p_value(fit['p_value'])})"
        )
    if fit["noise_scale"] is not None:
        line += f", noise {numbers.significant(fit['noise_scale'], 3)} times the stated one"
    return line + "."
