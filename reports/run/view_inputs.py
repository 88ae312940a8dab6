"""What an answer was made from."""

from __future__ import annotations

import json
from typing import Any

from ..style.blocks import Facts
from ..words.wording import clipped, listed, shown

Json = dict[str, Any]


def inputs_part(inputs: Json) -> Json:
    header = dict(inputs["header"])
    provenance = header.pop("provenance", None) or {}
    targets = [clipped(name, 24) for name in inputs["targets"]]
    facts = [
        ("Run", shown(inputs["run"])),
        ("SHA-256 of the run", inputs["sha256"]),
        ("Robot", shown(inputs["robot"])),
        ("Shots", str(inputs["shots"])),
        ("Targets", f"{len(targets)}: {listed(targets)}" if targets else "none"),
        ("Seed", str(inputs["seed"])),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs["versions"].items())),
    ]
    return {
        "facts": Facts(facts),
        "provenance": Facts(_flat(provenance)),
        "header": Facts(_flat(header)),
    }


def _flat(value: object, path: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows `tool.kind` → `laser`, as they stood in the file."""
    if isinstance(value, dict) and value:
        return [
            row for key, item in value.items() for row in _flat(item, f"{path}.{key}" if path else str(key))
        ]
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return [(clipped(path, 60), shown(text))] if path else []
