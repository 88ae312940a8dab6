"""What an answer was made from."""

from __future__ import annotations

import json

from ...analysis.result import Inputs
from ..style.blocks import Facts, Section, section_of
from ..words.wording import clipped, listed, shown


def inputs_sections(inputs: Inputs) -> list[Section]:
    """Inputs, provenance where there is one, and the settings of the run."""
    header = dict(inputs.header)
    provenance = _flat(header.pop("provenance", None) or {})
    targets = [clipped(name, 24) for name in inputs.targets]
    facts = [
        ("Run", shown(inputs.run)),
        ("SHA-256 of the run", inputs.sha256),
        ("Robot", shown(inputs.robot)),
        ("Measurements", str(inputs.shots)),
        ("Targets", f"{len(targets)}: {listed(targets)}" if targets else "none"),
        ("Seed", str(inputs.seed)),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs.versions.items())),
    ]
    sections = [section_of("Inputs", Facts(facts))]
    if provenance:
        sections.append(section_of("Provenance", Facts(provenance), level=2))
    return [*sections, section_of("Settings of the run", Facts(_flat(header)), level=2)]


def _flat(value: object, path: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows `tool.kind` → `laser`, as they are in the file."""
    if isinstance(value, dict) and value:
        return [
            row for key, item in value.items() for row in _flat(item, f"{path}.{key}" if path else str(key))
        ]
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return [(clipped(path, 60), shown(text))] if path else []
