"""What an answer was made from, and the form that a person completes and signs. Only what the run's
provenance states is filled in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from ...analysis.answer.result import Inputs, Result
from ...model.files.header import by_plain_key
from ...model.instruments.registry import kinds_of
from ...words.provenance import (
    DATE,
    KEYS,
    MEASURED,
    OPERATOR,
    SERIAL,
    instrument,
    is_simulated,
    provenance_entry,
    traced,
)
from ...words.wording import clipped, listed, shown
from ..style.blocks import Facts, Form, Paragraph, Section, section_of


def head_facts(result: Result) -> list[tuple[str, str]]:
    """When, which machine and by whom, as far as the provenance of a measured run says; for the head of a
    report."""
    if is_simulated(result.inputs.provenance):
        return []
    return [(name, clipped(text, 40)) for name, text in _head(result.inputs) if text]


def when_and_serial(inputs: Inputs) -> tuple[str | None, str | None]:
    """The date of the measurements and the arm's serial number, where the provenance states them."""
    when, serial, _ = (text or None for _, text in _head(inputs))
    return when, serial


def _head(inputs: Inputs) -> list[tuple[str, str]]:
    provenance = by_plain_key(inputs.provenance)
    return [(name, provenance_entry(provenance, KEYS[name])) for name in _HEAD]


def inputs_sections(inputs: Inputs) -> list[Section]:
    """Inputs, provenance where there is one, and the settings of the run."""
    header = dict(inputs.header)
    provenance = flattened(header.pop("provenance", None) or {})
    instruments = inputs.instruments
    targets = [clipped(name, 24) for name in inputs.targets if name not in instruments]
    kinds = [f"{clipped(label, 24)} ({kind.name})" for label, kind in instruments.items() if label != "tool"]
    facts = [
        ("Run", shown(inputs.run)),
        ("SHA-256 of the run", inputs.sha256),
        ("Robot", shown(inputs.robot)),
        ("Measurements", str(inputs.shots)),
        *([("Instruments", listed(kinds))] if kinds else []),
        ("Targets", f"{len(targets)}: {listed(targets)}" if targets else "none"),
        ("Seed", str(inputs.seed)),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs.versions.items())),
    ]
    sections = [section_of("Inputs", Facts(facts))]
    if provenance:
        of_offsets = [row for row in provenance if row[0].startswith("true delta")]
        true = ", ".join(f"{name[5:]} {text}" for name, text in of_offsets)
        origin = Facts([row for row in provenance if not row[0].startswith("true ")])
        sections.append(
            section_of(
                "Provenance",
                origin if origin.rows else None,
                Paragraph(f"True offsets of the simulation: {true}; result.json has all.") if true else None,
                level=2,
            )
        )
    by_header, usual = settings(header, inputs.stated)
    rest = ", ".join(f"{name} {value}" for name, value in usual)
    by_default = Paragraph(f"By default: {rest}.", screen_only=True) if rest else None
    return [*sections, section_of("Settings of the run", Facts(by_header), by_default, level=2)]


Settings = list[tuple[str, str]]


def settings(header: Mapping[str, Any], declared: Mapping[str, Any] | None) -> tuple[Settings, Settings]:
    """Those that a header (or a part of one) states, by `Inputs.stated`, and those that it has by default;
    where it is not known what is stated (None) all are in the first."""
    if declared is None:
        return flattened(dict(header)), []
    by_header = flattened({key: value for key, value in declared.items() if key in header})
    names = {name for name, _ in by_header}
    return by_header, [row for row in flattened(dict(header)) if row[0] not in names]


def flattened(value: object, path: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows `tool.kind` → `laser`, as they are in the file."""
    if isinstance(value, dict) and value:
        return [
            row
            for key, item in value.items()
            for row in flattened(item, f"{path}.{key}" if path else str(key))
        ]
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return [(clipped(path, 60), shown(text))] if path else []


# An approval is given after the result: nothing in a run can state it.
_HEAD = (DATE, SERIAL, OPERATOR)
_SIGNED = ("Approved by", "Date of approval", "Signature")


def traceability_section(result: Result) -> Section | None:
    """A form with a field a row; what nobody has stated is left empty. None of a simulated run."""
    provenance = by_plain_key(result.inputs.provenance)
    fields = [*MEASURED, *traced(result.inputs.instruments.values())]
    entries = [(name, provenance_entry(provenance, keys)) for name, keys in fields]
    if is_simulated(provenance):
        return None
    about = "To be completed by hand. Entries that are there were stated in the run’s provenance."
    return section_of("Traceability", Paragraph(about), Form(entries, _SIGNED))


def origin_of(header: Mapping[str, Any]) -> dict[str, str]:
    """What a run's header says of its origin: robot's serial number, date, operator and instruments; and
    the rig; an empty text where it says nothing."""
    entries = header.get("provenance")
    provenance = by_plain_key(entries if isinstance(entries, dict) else {})
    return {
        "serial": provenance_entry(provenance, KEYS[SERIAL]),
        "when": provenance_entry(provenance, KEYS[DATE]),
        "who": provenance_entry(provenance, KEYS[OPERATOR]),
        "instrument": instrument(provenance, kinds_of(header).values()),
        "origin": provenance_entry(provenance, ("origin",)),
    }
