"""The arms and results of a history, and their drift, as tables, sentences, rows of CSV and JSON."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime

from ...analysis.answer.answer_message import Message
from ...analysis.drift.instrument_biases import Bias
from ...analysis.status import Verdict
from ...experiments.history.arm_drift import ArmDrift, DatedChange, DatedJump, DriftingOffset, Rate
from ...experiments.history.documents import HISTORY_SCHEMA
from ...experiments.history.fleet_drift import FEW, ArmWalk, ArmWalks, FleetDrift, InstrumentJump, ModelWalk
from ...experiments.history.stored_result import Arm, Event, StoredResult
from ...model.records import one_line, to_json
from ...words import numbers
from ...words.message import verdict_words
from ...words.wording import capital, clipped, counted, label, listed, shown, status_words
from ..style.blocks import Block, Cell, Paragraph, Row, Table, row_of, table_of

_NONE = "none"
_MARKS: dict[Verdict, str] = {
    "misfit": "unvalidated",
    "degenerate": "unidentifiable",
    "weak": "weak",
    "pass": "identified",
}


def day(when: datetime | None) -> str:
    """The date of a time, with hours and minutes (UTC) where they are stated."""
    if when is None:
        return _NONE
    return when.strftime("%Y-%m-%d" if (when.hour, when.minute) == (0, 0) else "%Y-%m-%d %H:%M")


def arms_table(arms: Sequence[Arm], judged: Sequence[Message | None]) -> Table:
    """Every arm with its last result, and what that is worth."""
    heads = ("arm", "model", "results", "last", "verdict")
    rows = [
        row_of(
            clipped(arm.serial, 30),
            clipped(arm.model, 24),
            str(arm.results),
            day(arm.last),
            _NONE if arm.verdict is None else verdict_words(arm.verdict, worth),
            tone="" if arm.verdict is None else _tone(worth),
        )
        for arm, worth in zip(arms, judged, strict=True)
    ]
    return table_of(f"{counted(len(arms), 'arm')}, by serial number", heads, rows, "llrl")


def results_table(results: Sequence[StoredResult], judged: Sequence[Message | None]) -> Table:
    """The results of an arm in the order of time, and what each is worth: an offset a column."""
    names = offset_names(results)
    columns = ["date", "verdict", *(label(name) for name in names)]
    rows = [
        row_of(
            day(result.measured_at),
            verdict_words(result.verdict, worth),
            *(_offset(result, name) for name in names),
            tone=_tone(worth),
        )
        for result, worth in zip(results, judged, strict=True)
    ]
    return table_of(f"{counted(len(results), 'result')}, ± standard uncertainty", columns, rows, "llr")


def verdict_cell(verdict: Verdict, judged: Message | None) -> Cell:
    """The verdict of a stored result with its shape and colour, and what it is worth."""
    mark = _MARKS[verdict] if verdict != "pass" or _tone(judged) == "" else "weak"
    return Cell(capital(verdict_words(verdict, judged)), mark=mark)


def offset_names(results: Iterable[StoredResult]) -> list[str]:
    """The offsets that any of the results estimates, joint 1 first."""
    names = {row.name: None for result in results for row in result.offsets if not row.held}
    return sorted(names, key=lambda name: (len(name), name))


def events_table(events: Sequence[Event]) -> Table | None:
    """The logged events; None where there is none."""
    rows = [row_of(day(event.at), event.what, shown(event.note)) for event in events]
    columns = ["date", "event", "note"]
    return table_of("Events", columns, rows, "l") if rows else None


def history_text(
    results: Iterable[tuple[StoredResult, Message | None]], events: Iterable[Event] | None = None
) -> Iterator[str]:
    """Results with what they are worth, and events where they are given, as JSON in pieces: a line each."""
    yield f'{{\n "schema": "{HISTORY_SCHEMA}",\n "results": '
    yield from _listed(worth(*each) for each in results)
    if events is not None:
        yield ',\n "events": '
        yield from _listed(events)
    yield "\n}\n"


def worth(result: StoredResult, judged: Message | None) -> StoredResult:
    """The result with what it is worth, where that was read."""
    return result if judged is None else replace(result, grade=judged.grade, may=judged.may)


def _listed(rows: Iterable[StoredResult | Event]) -> Iterator[str]:
    between = "[\n  "
    for row in rows:
        yield between + one_line(to_json(row))
        between = ",\n  "
    yield "[]" if between[0] == "[" else "\n ]"


def offset_rows(results: Iterable[StoredResult]) -> Iterator[dict[str, object]]:
    """A row for each result and offset."""
    for result in results:
        for row in result.offsets:
            low, high = row.interval95 or (None, None)
            yield {
                "serial": result.serial,
                "model": result.model,
                "measured_at": to_json(result.measured_at),
                "instrument": result.instrument or None,
                "operator": result.operator or None,
                "run": result.run,
                "sha256": result.sha256,
                "verdict": result.verdict,
                "offset": row.name,
                "unit": row.unit,
                "status": row.status,
                "estimate": row.estimate,
                "std": row.std,
                "low95": low,
                "high95": high,
            }


def _tone(judged: Message | None) -> str:
    """Of a row: plain where the robot passed, and where no robot was measured."""
    return "" if judged is not None and judged.grade in ("pass", "held") else "weak"


def _offset(result: StoredResult, name: str) -> str | Cell:
    for row in result.offsets:
        if row.name != name:
            continue
        if row.status in ("held", "unidentifiable"):
            return Cell(status_words(row.status), mark=row.status)
        if row.estimate is None or row.std is None:
            break
        text = f"{numbers.estimate(row.estimate, row.std)} ± {numbers.spread(row.std, row.unit)}"
        return Cell(text, mark="" if row.status == "identified" else row.status)
    return "not given"


_MOST = 20  # rows of a table; the JSON has all
_FASTEST = 10
FEW_RATES = 30  # rates: below, the numbers are coarse
UNDECIDED = "too few results to distinguish a jump from drift"


def drift_blocks(arm: ArmDrift) -> Iterator[Block]:
    """Jumps, the offsets now and how fast they walk, the due date, what does not count."""
    if arm.drift is not None:
        yield from jumps_blocks(arm)
        yield from offsets_blocks(arm)
        if arm.drift.effective < FEW_RATES:
            yield Paragraph("Few drift rates explain these results: intervals and p-values are approximate.")
    yield Paragraph(f"{due_sentence(arm)} {counted(len(arm.used), 'result')} counted.")
    for left in arm.left_out:
        yield Paragraph(f"Not counted: the result of {day(left.result.measured_at)}. {left.reason}.")


def due_sentence(arm: ArmDrift) -> str:
    """When the next calibration is due, or why there is no date."""
    tolerance = numbers.exact(arm.tolerance_mm, "mm")
    limit = f"TCP error within {tolerance} (95 %, rms over the region of the last run)"
    reason = with_labels(arm.due_reason)
    if arm.due is not None and not arm.due_reason:
        return f"Next calibration due: {arm.due:%Y-%m-%d}, for a {limit}."
    word = "due now" if arm.due is not None else "no due date"
    return f"Next calibration: {word} for a {limit}: {reason}."


def with_labels(text: str) -> str:
    """A sentence with the offsets in it as people write them."""
    return re.sub(r"delta\d+", lambda name: label(name.group()), text)


def arms_drift_table(arms: Sequence[ArmDrift]) -> Block:
    """A row for each arm: its clearest jump, and when it is due."""
    rows = [
        row_of(
            clipped(arm.serial, 24),
            clipped(arm.model, 20),
            str(len(arm.used)),
            _clearest(arm),
            "none" if arm.due is None else f"{arm.due:%Y-%m-%d}",
            tone="weak" if arm.jumps or arm.undecided else "",
        )
        for arm in arms
    ]
    heads = ("arm", "model", "results", "clearest jump", "due")
    return table_of("Drift of all arms", heads, rows, "llrl")


def offsets_blocks(arm: ArmDrift) -> Iterator[Block]:
    """Every offset at the last result, and how fast it walks; which of them are only as good as what was
    assumed."""
    offsets = arm.offsets
    rows = [
        row_of(
            label(offset.name),
            _now(offset),
            *_rate(offset.rate, offset.unit),
            tone="assumed" if offset.status == "assumed" else "",
        )
        for offset in offsets
    ]
    heads = ("offset", "at the last result", "drift rate", "95 % interval")
    yield table_of("Offsets by all results, and their drift rate per root year", heads, rows)
    if assumed := [label(offset.name) for offset in offsets if offset.status == "assumed"]:
        yield Paragraph(
            f"{listed(assumed)}: assumed. What was assumed is the same in every result: more results do not"
            " make it better."
        )


def _rate(rate: Rate | None, unit: str) -> tuple[str | Cell, str]:
    if rate is None:
        return Cell("not determined", mark="unidentifiable"), ""
    return numbers.significant(rate.median, 2, unit), _interval(rate.interval95)


def _now(offset: DriftingOffset) -> str | Cell:
    if offset.estimate is None or offset.std is None:
        return Cell("not determined since the mastering", mark="unidentifiable")
    text = f"{numbers.estimate(offset.estimate, offset.std)} ± {numbers.spread(offset.std, offset.unit)}"
    return Cell(text, mark="assumed" if offset.status == "assumed" else "")


def jumps_blocks(arm: ArmDrift) -> Iterator[Block]:
    """The jumps, the changes that may be one, and what was logged in between."""
    if arm.jumps:
        caption = "Jumps; p-values adjusted for the number of tests (Bonferroni)"
        jumps = [(jump, numbers.p_value(jump.p_value)) for jump in arm.jumps]
        yield _changes_table(caption, "p-value", jumps)
    if arm.undecided:
        least = [(dated, numbers.significant(dated.least_jump, 2, dated.unit)) for dated in arm.undecided]
        yield _changes_table(f"Jump or drift: {UNDECIDED}", "a jump from", least)
    elif not arm.jumps:
        yield Paragraph(without_jump(arm))


def without_jump(arm: ArmDrift) -> str:
    """What is said of the changes where none of them is a jump or may be one."""
    if arm.drift is not None and arm.drift.changed:
        return "No jump was found: drift at a rate that other results show explains every change."
    return "No change from one result to the next exceeds their uncertainty."


def _changes_table(caption: str, head: str, rows: Sequence[tuple[DatedChange, str]]) -> Table:
    """Changes, each with what stands in the column `head`."""
    heads = ("offset", "between", "change", head, "events")
    cells = [
        row_of(
            Cell(label(dated.offset), mark="weak"),
            f"{day(dated.after)} to {day(dated.before)}",
            _change(dated),
            text,
            ", ".join(_happened(dated)) or "none logged",
        )
        for dated, text in rows
    ]
    return table_of(caption, heads, cells, "llrrl")


def _change(change: DatedChange) -> str:
    low, high = change.interval95
    return numbers.interval(change.interval95, max((high - low) / 4, 1e-12), change.unit)


def change_sentence(change: DatedChange) -> str:
    """Offset, size and dates of a change."""
    between = f"between {day(change.after)} and {day(change.before)}"
    return f"{label(change.offset)} changed by {_change(change)} {between}"


def _happened(change: DatedChange) -> Iterator[str]:
    for event in change.events:
        yield f"{event.what} {day(event.at)} {shown(event.note)}".strip()
    if change.instruments is not None:
        before, after = (clipped(name) if name else "not stated" for name in change.instruments)
        changed = "changed" if all(change.instruments) else "may have changed"
        yield f"instrument {changed}, a possible cause: {before} to {after}"


def _clearest(arm: ArmDrift) -> str:
    clearest = min(arm.jumps, key=lambda jump: jump.p_value, default=None)
    return clearest_jump(clearest, len(arm.undecided)) or "none"


def clearest_jump(jump: DatedJump | None, undecided: int) -> str:
    """In a list of arms: offset of a jump and the result that shows it, or how many changes may be one."""
    if jump is not None:
        return f"{label(jump.offset)}, {jump.before:%Y-%m-%d}"
    return f"{undecided} undecided" if undecided else ""


def fleet_blocks(fleet: FleetDrift) -> Iterator[Block]:
    """How fast each model walks, the fastest arms, the instruments, and what is not determined."""
    if fleet.models:
        yield _models(fleet)
        yield _fastest(fleet)
    yield from _about_arms(fleet)
    yield from _instrument_blocks(fleet)


def _models(fleet: FleetDrift) -> Block:
    rate = ("drift rate", "95 % interval", "u of a result", "drift > u in a year")
    return table_of(
        "Drift rate of the median arm of each model, per root year. An offset drifts if it changes by more"
        f" than the standard uncertainty of a result in a year; any false alarm: at most {fleet.alarm:.0%}",
        ("model", "offset", "arms", *rate, "says"),
        [
            row_of(
                clipped(model.model, 20),
                label(model.offset),
                str(model.arms),
                *_model_walk(model),
                Cell(_remark(model), mark="weak" if model.drifts else ""),
                tone="weak" if model.drifts else "",
            )
            for model in fleet.models
        ],
        "llrrrrrl",
    )


def _remark(model: ModelWalk) -> str:
    return ", ".join(part for part in ("drifts" if model.drifts else "", _cause(model)) if part)


def _model_walk(model: ModelWalk) -> tuple[str, ...]:
    u = numbers.significant(model.noticed, 2, model.unit)
    if model.median is None or model.probability is None:
        return "not known", "", u, ""
    median, interval = model.median.median, model.median.interval95
    return (
        numbers.significant(median, 2, model.unit),
        _interval(interval),
        u,
        numbers.p_value(model.probability),
    )


def _cause(model: ModelWalk) -> str:
    if not model.biased:
        return ""
    return f"perhaps a bias: {listed([clipped(name, 24) for name in model.biased], 3)}"


def _interval(ends: tuple[float, float]) -> str:
    return " to ".join(numbers.significant(end, 2) for end in ends)


def _fastest(fleet: FleetDrift) -> Block:
    models = {(model.model, model.offset): model for model in fleet.models}

    def ratio(pair: tuple[ArmWalks, ArmWalk]) -> float:
        arm, offset_walk = pair
        return (
            offset_walk.shrunken.median / models[arm.model, offset_walk.offset].noticed
            if offset_walk.shrunken
            else 0.0
        )

    every = [(arm, offset_walk) for arm in fleet.arms for offset_walk in arm.walks if offset_walk.shrunken]
    rows = [
        row_of(
            clipped(arm.serial, 16),
            clipped(arm.model, 16),
            label(offset_walk.offset),
            numbers.significant(offset_walk.shrunken.median, 2, offset_walk.unit),
            _interval(offset_walk.shrunken.interval95),
            "its model" if offset_walk.borrowed else "own results",
            _cause(models[arm.model, offset_walk.offset]),
        )
        for arm, offset_walk in sorted(every, key=ratio, reverse=True)[:_FASTEST]
        if offset_walk.shrunken
    ]
    heads = ("arm", "model", "offset", "drift rate", "95 % interval", "mostly by", "possible cause")
    caption = "Fastest drifts of single arms over the u of a result, with the rates of their model"
    return table_of(caption, heads, rows, "lllrrl")


def _about_arms(fleet: FleetDrift) -> Iterator[Block]:
    borrowed = [arm.serial for arm in fleet.arms if any(row.borrowed for row in arm.walks)]
    if borrowed:
        yield Paragraph(
            f"Some rates of {_arms(borrowed)} are known more by the other arms of the model than by own"
            " results."
        )
    coarse = [arm.serial for arm in fleet.arms if arm.effective < FEW]
    if coarse:
        yield Paragraph(
            f"Few drift rates of {_arms(coarse)} agree with the model: intervals are approximate."
        )
    if fleet.too_few:
        yield Paragraph(f"{counted(fleet.too_few, 'arm')} with fewer than two results that count: not used.")


def _arms(serials: list[str]) -> str:
    return f"{counted(len(serials), 'arm')} ({listed([clipped(serial, 24) for serial in serials], 4)})"


def _instrument_blocks(fleet: FleetDrift) -> Iterator[Block]:
    if fleet.biases:
        ordered = sorted(
            fleet.biases, key=lambda bias: (not bias.alarm, bias.p_value, -abs(bias.estimate) / bias.std)
        )
        alarms = sum(bias.alarm for bias in ordered)
        shown = ordered[: max(alarms, _MOST)]
        caption = (
            "Biases of instruments, less the mean of those they are comparable to; p-values adjusted for the"
            f" number of tests (Bonferroni); an alarm below {fleet.alarm:g}"
        )
        if len(shown) < len(ordered):
            caption += f". {len(shown)} of {len(ordered)}: --json has all"
        heads = ("instrument", "less", "offset", "difference", "95 % interval", "p-value", "says")
        yield table_of(caption, heads, [_bias(bias) for bias in shown], "lllrrrl")
        if any(len(bias.against) == 1 for bias in shown):
            yield Paragraph("Of two instruments only the difference is known, not whose bias it is.")
    yield from map(Paragraph, _not_determined(fleet))
    for suspect in fleet.suspects[:_MOST]:
        yield Paragraph(_suspect(suspect))


def _bias(bias: Bias) -> Row:
    word = "biased" if len(bias.against) > 1 else "differs"
    return row_of(
        clipped(bias.instrument, 24),
        listed([clipped(name, 24) for name in bias.against], 3),
        label(bias.offset),
        f"{numbers.estimate(bias.estimate, bias.std)} ± {numbers.spread(bias.std, bias.unit)}",
        numbers.interval(bias.interval95, bias.std),
        numbers.p_value(bias.p_value),
        Cell(word if bias.alarm else "", mark="weak" if bias.alarm else ""),
        tone="weak" if bias.alarm else "",
    )


def _not_determined(fleet: FleetDrift) -> Iterator[str]:
    """Sentences, one for all offsets that have the same groups of instruments."""
    alike: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    for alike_offset in fleet.comparable:
        if len(alike_offset.groups) > 1 or any(len(group) == 1 for group in alike_offset.groups):
            alike.setdefault(alike_offset.groups, []).append(label(alike_offset.offset))
    for groups, offsets in alike.items():
        of = listed(offsets)
        if len(groups) == 1:
            yield f"Bias of {clipped(groups[0][0], 24)}: not determined ({of}). It is the only instrument."
            continue
        named = "; ".join(" and ".join(clipped(name, 24) for name in group) for group in groups[:_MOST])
        yield (
            f"Biases between these are not determined ({of}): {named}. Two changes from one to the other on"
            " arms, without new zeros in between, determine it; after one change a jump of the arm would look"
            " the same."
        )
    if fleet.comparable:
        yield "A bias that all instruments have in common is never determined."
    if fleet.unstated:
        yield (
            f"{counted(fleet.unstated, 'result')} without an instrument: not used for biases. State psd or"
            " probe in the provenance."
        )


def _suspect(suspect: InstrumentJump) -> str:
    biased = " or ".join(clipped(name, 24) for name in suspect.biased)
    return (
        f"The jump of {label(suspect.jump.offset)} of {clipped(suspect.serial, 24)} before"
        f" {suspect.jump.before:%Y-%m-%d} is at a change of instrument: the bias of {biased} is a possible"
        " cause."
    )
