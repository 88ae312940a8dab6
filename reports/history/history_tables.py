"""The arms and results of a history, and their drift, as tables, sentences, rows of CSV and JSON."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from typing import TypeVar

from ...analysis.answer.answer_message import Message
from ...analysis.drift.instrument_biases import Bias
from ...analysis.row import ParameterRow
from ...analysis.status import Verdict
from ...experiments.history.arm_history import (
    FEW,
    HISTORY_SCHEMA,
    ArmDrift,
    ClearestJump,
    DatedChange,
    DriftingOffset,
    Rate,
    offset_names,
)
from ...experiments.history.fleet_drift import ArmWalk, ArmWalks, FleetDrift, InstrumentJump, ModelWalk
from ...experiments.history.stored_result import Arm, Event, StoredResult
from ...model.records import one_line, to_json
from ...words import numbers
from ...words.entries import said_word
from ...words.message import verdict_words
from ...words.provenance import BAND
from ...words.wording import capital, clipped, counted, label, listed, shown, status_words
from ..style.blocks import Block, Cell, Columns, Paragraph, Table, table_by
from ..style.theme import VERDICT_MARKS

_NONE = "none"
Change = TypeVar("Change", bound=DatedChange)
Judged = Message | None  # what a result is worth, None where that cannot be read


def day(when: datetime | None) -> str:
    """The date of a time, with hours and minutes (UTC) where they are stated."""
    if when is None:
        return _NONE
    return when.strftime("%Y-%m-%d" if (when.hour, when.minute) == (0, 0) else "%Y-%m-%d %H:%M")


def date_or(when: datetime | None, words: str = _NONE) -> str:
    """The day of a due date."""
    return words if when is None else f"{when:%Y-%m-%d}"


def arms_table(arms: Sequence[Arm], judged: Sequence[Judged]) -> Table:
    """Every arm with its last result, and what that is worth."""
    return table_by(
        f"{counted(len(arms), 'arm')}, by serial number",
        list(zip(arms, judged, strict=True)),
        {
            "arm": lambda row: clipped(row[0].serial, 30),
            "model": lambda row: clipped(row[0].model, 24),
            "results": lambda row: str(row[0].results),
            "last": lambda row: day(row[0].last),
            "verdict": lambda row: (
                _NONE if row[0].verdict is None else verdict_words(row[0].verdict, row[1], row[0].simulated)
            ),
        },
        "llrl",
        tone=lambda row: "" if row[0].verdict is None else _tone(row[1]),
    )


def results_table(results: Sequence[StoredResult], judged: Sequence[Judged]) -> Table:
    """The results of an arm in the order of time, and what each is worth: an offset a column."""
    table = table_by(
        f"{counted(len(results), 'result')}, ± standard uncertainty",
        list(zip(results, judged, strict=True)),
        {
            "date": lambda row: day(row[0].measured_at),
            "verdict": lambda row: verdict_words(row[0].verdict, row[1], row[0].simulated),
            **{label(name): partial(_offset, name) for name in offset_names(results)},
        },
        "llr",
        tone=lambda row: _tone(row[1]),
    )
    return replace(table, in_parts=True)


def verdict_cell(verdict: Verdict, judged: Judged, simulated: bool) -> Cell:
    """The verdict of a stored result with its shape and colour, and what it is worth."""
    mark = "weak" if verdict == "pass" and _tone(judged) else VERDICT_MARKS[verdict]
    return Cell(capital(verdict_words(verdict, judged, simulated)), mark="held" if simulated else mark)


def _tone(judged: Judged) -> str:
    """Of a row: plain where the robot passed, and where no robot was measured."""
    return "" if judged is not None and judged.grade in ("pass", "held") else "weak"


def _offset(name: str, judged: tuple[StoredResult, Judged]) -> str | Cell:
    row = next((row for row in judged[0].offsets if row.name == name), None)
    if row is not None and row.status in ("held", "unidentifiable"):
        return Cell(status_words(row.status), mark=row.status)
    if row is None or row.estimate is None or row.std is None:
        return "not given"
    return Cell(
        _with_u(row.estimate, row.std, row.unit), mark="" if row.status == "identified" else row.status
    )


def _with_u(estimate: float, std: float, unit: str) -> str:
    return f"{numbers.estimate(estimate, std)} ± {numbers.spread(std, unit)}"


def events_table(events: Sequence[Event]) -> Table | None:
    """The logged events; None where there is none."""
    columns: Columns[Event] = {
        "date": lambda event: day(event.at),
        "event": lambda event: event.what,
        "note": lambda event: shown(event.note),
    }
    return table_by("Events", events, columns, "l") if events else None


def history_text(
    results: Iterable[tuple[StoredResult, Judged]], events: Iterable[Event] | None = None
) -> Iterator[str]:
    """Results with what they are worth, and events where they are given, as JSON in pieces: a line each."""
    yield f'{{\n "schema": "{HISTORY_SCHEMA}",\n "results": '
    yield from _listed(worth(*each) for each in results)
    if events is not None:
        yield ',\n "events": '
        yield from _listed(events)
    yield "\n}\n"


def worth(result: StoredResult, judged: Judged) -> StoredResult:
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
    of_result = ("serial", "model", "measured_at", "instrument", "operator", "run", "sha256", "verdict")
    for result in results:
        whole = to_json(replace(result, without_prior=None))
        for row in result.offsets:
            low, high = row.interval95 or (None, None)
            yield {
                **{name: whole[name] for name in of_result},
                "offset": row.name,
                **{name: getattr(row, name) for name in ("unit", "status", "estimate", "std")},
                "low95": low,
                "high95": high,
                "simulated": result.simulated,
            }


_MOST = 20  # rows of a table; the JSON has all
_FASTEST = 10
_NO_INTERVAL = 4  # rates: below, their ends are those of single rates
UNDECIDED = "too few results to distinguish a jump from drift"
FEW_RATES = "Few drift rates explain these results: intervals and p-values are approximate"


def drift_blocks(arm: ArmDrift) -> Iterator[Block]:
    """Jumps, the offsets now and how fast they walk, the due date, what does not count."""
    if arm.simulated:
        yield Paragraph(f"{BAND}.")
    if arm.drift is not None:
        yield from jumps_blocks(arm)
        if resting := changes_of_assumed(arm):
            yield Paragraph(f"{resting}.")
        yield from offsets_blocks(arm)
        if arm.drift.effective < FEW:
            yield Paragraph(f"{FEW_RATES}.")
    yield Paragraph(f"{due_sentence(arm)} {counted(len(arm.used), 'result')} counted.")
    for left in arm.left_out:
        yield Paragraph(f"Not counted: the result of {day(left.result.measured_at)}: {left.reason}.")


_ON_TOP = "The error that links leave comes on top: see the report of the last result."


def due_sentence(arm: ArmDrift) -> str:
    """When the next calibration is due, or why there is no date."""
    tolerance = numbers.exact(arm.tolerance_mm, "mm")
    limit = f"a TCP error by the offsets alone within {tolerance} (95 %, rms over the region of the last run)"
    if arm.due is not None and not arm.due_reason:
        return f"Next calibration due: {arm.due:%Y-%m-%d}, for {limit}. {_ON_TOP}"
    word = "due now" if arm.due is not None else "no due date"
    return f"Next calibration: {word} for {limit}: {with_labels(arm.due_reason)}."


def with_labels(text: str) -> str:
    """A sentence with the offsets in it as people write them."""
    return re.sub(r"\bdelta\d+\b", lambda name: label(name.group()), text)


def arms_drift_table(arms: Sequence[ArmDrift]) -> Table:
    """A row for each arm: its clearest jump, and when it is due."""

    def clearest(arm: ArmDrift) -> str:
        jump = min(arm.jumps, key=lambda jump: jump.p_value, default=None)
        assumed = jump is not None and jump.offset in arm.assumed
        return clearest_jump(jump, len(arm.undecided), assumed) or _NONE

    caption = "Drift of all arms"
    if len({arm.simulated for arm in arms}) > 1:
        caption += "; simulated ones have no part in what all say together"
    return table_by(
        caption,
        arms,
        {
            "arm": lambda arm: clipped(arm.serial, 24),
            "model": lambda arm: clipped(arm.model, 20),
            "results": lambda arm: str(len(arm.used)),
            "clearest jump": clearest,
            "due": lambda arm: said_word(date_or(arm.due), arm.simulated),
        },
        "llrl",
        tone=lambda arm: "weak" if arm.jumps or arm.undecided else "",
    )


def offsets_blocks(arm: ArmDrift) -> Iterator[Block]:
    """Every offset at the last result, and how fast it walks; which of them are only as good as what was
    assumed."""
    yield table_by(
        "Offsets by all results, ± standard uncertainty, and their drift rate per root year",
        arm.offsets,
        {
            "offset": lambda row: label(row.name),
            "at the last result": _now,
            "drift rate": lambda row: _UNKNOWN if row.rate is None else rate_words(row.rate, row.unit),
            "95 % interval": lambda row: "" if row.rate is None else ends_words(row.rate),
        },
        tone=lambda row: "assumed" if row.status == "assumed" else "",
    )
    if assumed := [label(offset.name) for offset in arm.offsets if offset.status == "assumed"]:
        yield Paragraph(
            f"{listed(assumed)}: assumed. What was assumed is the same in every result, as long as nothing"
            " was mounted anew: more results do not make it better."
        )


def result_table(result: StoredResult) -> Table:
    """Every offset of the one result that counts, with what its status allows."""
    columns: Columns[ParameterRow] = {
        "offset": lambda row: label(row.name),
        "estimate": lambda row: (
            _UNKNOWN if row.estimate is None or row.std is None else _with_u(row.estimate, row.std, row.unit)
        ),
        "status": lambda row: Cell(status_words(row.status), mark=row.status),
    }
    estimated = [row for row in result.offsets if not row.held]
    return table_by(f"Offsets of the one result that counts, {day(result.measured_at)}", estimated, columns)


_UNKNOWN = Cell("not determined", mark="unidentifiable")


def _now(offset: DriftingOffset) -> str | Cell:
    if offset.estimate is None or offset.std is None:
        return Cell("not determined since the mastering", mark="unidentifiable")
    mark = "assumed" if offset.status == "assumed" else ""
    return Cell(_with_u(offset.estimate, offset.std, offset.unit), mark=mark)


def jumps_blocks(arm: ArmDrift) -> Iterator[Block]:
    """The jumps, the changes that may be one, and what was logged in between."""
    if arm.jumps:
        caption = "Jumps; p-values adjusted for the number of tests (Bonferroni)"
        yield _changes_table(caption, arm.jumps, "p-value", lambda jump: numbers.p_value(jump.p_value))
    if arm.undecided:
        caption = f"Jump or drift: {UNDECIDED}"
        yield _changes_table(
            caption,
            arm.undecided,
            "a jump from",
            lambda one: numbers.significant(one.least_jump, 2, one.unit),
        )
    elif not arm.jumps:
        yield Paragraph(without_jump(arm))


def changes_of_assumed(arm: ArmDrift) -> str:
    """On what the changes of assumed offsets depend; empty where none changed."""
    changed = dict.fromkeys(one.offset for one in (*arm.jumps, *arm.undecided) if one.offset in arm.assumed)
    return _of_assumed(list(changed), "change", "arm's")


def _of_assumed(offsets: Sequence[str], what: str, whose: str) -> str:
    if not offsets:
        return ""
    subject = f"Their {what}s are" if len(offsets) > 1 else f"Its {what} is"
    names = listed([label(name) for name in offsets])
    return f"{names}: assumed. {subject} the {whose} only if tool and instrument were not mounted anew"


def without_jump(arm: ArmDrift) -> str:
    """What is said of the changes where none of them is a jump or may be one."""
    if arm.drift is not None and arm.drift.changed:
        return "No jump was found: drift at a rate that other results show explains every change."
    return "No change from one result to the next exceeds their uncertainty."


def _changes_table(
    caption: str, changes: Sequence[Change], head: str, says: Callable[[Change], str]
) -> Table:
    """Changes, with a column `head` of their kind."""
    columns: Columns[Change] = {
        "offset": lambda one: Cell(label(one.offset), mark="weak"),
        "between": lambda one: f"{day(one.after)} to {day(one.before)}",
        "change": _change,
        head: says,
        "events": lambda one: ", ".join(_happened(one)) or "none logged",
    }
    return table_by(caption, changes, columns, "llrrl")


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


def clearest_jump(jump: DatedChange | ClearestJump | None, undecided: int, assumed: bool) -> str:
    """In a list of arms: offset of a jump and the result that shows it, or how many changes may be one."""
    if jump is not None:
        return f"{label(jump.offset)}{' (assumed)' * assumed}, {jump.before:%Y-%m-%d}"
    return f"{undecided} undecided" if undecided else ""


def fleet_blocks(fleet: FleetDrift) -> Iterator[Block]:
    """How fast each model walks, the fastest arms, the instruments, and what is not determined."""
    if fleet.models:
        yield _models(fleet)
        assumed = dict.fromkeys(row.offset for row in fleet.models if row.assumed)
        if resting := _of_assumed(list(assumed), "drift", "arms'"):
            yield Paragraph(f"{resting}.")
        yield _fastest(fleet)
    yield from _about_arms(fleet)
    yield from _instrument_blocks(fleet)


def rate_words(rate: Rate, unit: str = "") -> str:
    """The median of a rate, as exact as so many drift rates say it."""
    return numbers.significant(rate.median, _digits(rate), unit)


def ends_words(rate: Rate) -> str:
    """Its 95 % interval; of a few rates alone there is none."""
    if rate.effective < _NO_INTERVAL:
        return "too few rates agree"
    return " to ".join(numbers.significant(end, _digits(rate)) for end in rate.interval95)


def _digits(rate: Rate) -> int:
    return 2 if rate.effective >= FEW else 1


def _models(fleet: FleetDrift) -> Table:
    columns: Columns[ModelWalk] = {
        "model": lambda row: _model(fleet, row.model),
        "offset": _of_model,
        "arms": lambda row: str(row.arms),
        "drift rate": lambda row: "not known" if row.median is None else rate_words(row.median, row.unit),
        "95 % interval": lambda row: "" if row.median is None else ends_words(row.median),
        "u of a result": lambda row: numbers.significant(row.noticed, 2, row.unit),
        "drift > u in a year": lambda row: (
            "" if row.probability is None else numbers.p_value(row.probability)
        ),
        "says": lambda row: Cell(
            ", ".join(filter(None, ("drifts" * row.drifts, _cause(row)))), mark="weak" * row.drifts
        ),
    }
    return table_by(
        "Drift rate of the median arm of each model, per root year. An offset drifts if it changes by more"
        " than the standard uncertainty of a result in a year; any false alarm: at most"
        f" {numbers.percent(fleet.alarm)}",
        fleet.models,
        columns,
        "llrrrrrl",
        tone=lambda row: "weak" * row.drifts,
    )


def _model(fleet: FleetDrift, model: str) -> str:
    """The column is left out where all arms are of one model, which the page names."""
    return "" if len({one.model for one in fleet.models}) == 1 else clipped(model, 20)


def _of_model(model: ModelWalk) -> Cell:
    return Cell(label(model.offset), mark="assumed" if model.assumed else "")


def _cause(model: ModelWalk) -> str:
    if not model.biased:
        return ""
    return f"perhaps a bias: {listed([clipped(name, 24) for name in model.biased], 3)}"


def _fastest(fleet: FleetDrift) -> Table:
    models = {(model.model, model.offset): model for model in fleet.models}
    every = [
        (arm, one, one.shrunken, models[arm.model, one.offset])
        for arm in fleet.arms
        for one in arm.walks
        if one.shrunken
    ]
    every.sort(key=lambda row: row[2].median / row[3].noticed, reverse=True)
    columns: Columns[tuple[ArmWalks, ArmWalk, Rate, ModelWalk]] = {
        "arm": lambda row: clipped(row[0].serial, 16),
        "model": lambda row: _model(fleet, row[0].model),
        "offset": lambda row: _of_model(row[3]),
        "drift rate": lambda row: rate_words(row[2], row[1].unit),
        "95 % interval": lambda row: ends_words(row[2]),
        "mostly by": lambda row: "; ".join(
            filter(None, ("its model" if row[1].borrowed else "own results", _cause(row[3])))
        ),
    }
    caption = "Fastest drifts of single arms over the u of a result, with the rates of their model"
    return table_by(caption, every[:_FASTEST], columns, "lllrrl")


def _about_arms(fleet: FleetDrift) -> Iterator[Block]:
    borrowed = [arm.serial for arm in fleet.arms if any(row.borrowed for row in arm.walks)]
    coarse = [arm.serial for arm in fleet.arms if arm.effective < FEW]
    if borrowed:
        known = "are known more by the other arms of the model than by own results."
        yield Paragraph(f"Some rates of {_arms(borrowed)} {known}")
    if coarse:
        agree = "agree with the model: intervals are approximate."
        yield Paragraph(f"Few drift rates of {_arms(coarse)} {agree}")
    if fleet.too_few:
        yield Paragraph(f"{counted(fleet.too_few, 'arm')} with fewer than two results that count: not used.")


def _arms(serials: list[str]) -> str:
    return f"{counted(len(serials), 'arm')} ({listed([clipped(serial, 24) for serial in serials], 4)})"


def _instrument_blocks(fleet: FleetDrift) -> Iterator[Block]:
    if fleet.biases:
        ordered = sorted(
            fleet.biases, key=lambda bias: (not bias.alarm, bias.p_value, -abs(bias.estimate) / bias.std)
        )
        most = max(sum(bias.alarm for bias in ordered), _MOST)
        assumed = {row.offset for row in fleet.models if row.assumed}
        caption = (
            "Biases of instruments, less the mean of those they are comparable to; p-values adjusted for the"
            f" number of tests (Bonferroni); an alarm below {fleet.alarm:g}"
        )
        if most < len(ordered):
            caption += f". {most} of {len(ordered)}: --json has all"
        columns: Columns[Bias] = {
            "instrument": lambda bias: clipped(bias.instrument, 24),
            "less": lambda bias: listed([clipped(name, 24) for name in bias.against], 3),
            "offset": lambda bias: Cell(label(bias.offset), mark="assumed" if bias.offset in assumed else ""),
            "difference": lambda bias: _with_u(bias.estimate, bias.std, bias.unit),
            "95 % interval": lambda bias: numbers.interval(bias.interval95, bias.std),
            "p-value": lambda bias: numbers.p_value(bias.p_value),
            "says": lambda bias: Cell(
                ("biased" if len(bias.against) > 1 else "differs") * bias.alarm, mark="weak" * bias.alarm
            ),
        }
        yield table_by(caption, ordered[:most], columns, "lllrrrl", lambda bias: "weak" * bias.alarm)
        if any(len(bias.against) == 1 for bias in ordered[:most]):
            yield Paragraph("Of two instruments only the difference is known, not whose bias it is.")
    yield from map(Paragraph, _not_determined(fleet))
    yield from (Paragraph(_suspect(suspect)) for suspect in fleet.suspects[:_MOST])


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
