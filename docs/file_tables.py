"""The tables of keys in the pages, made of the models that read and write the files.

`python docs/file_tables.py` writes them between their marks: `<!-- keys NAME PART … -->` begins the table of
a schema (`zerobeam schema NAME`), `<!-- end -->` ends it. With parts it has the keys below these alone, with
`-PART` none below that one, with `.` those of the file itself alone. `end-points` are those of the app.
`tests/experiments/test_schema.py` holds the page and the models equal.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from zerobeam.app.server.routes import description
from zerobeam.experiments.schema import FILE_SCHEMAS, json_schema

PAGES = [
    Path(__file__).parent / name
    for name in (
        "files.md",
        "files-cell.md",
        "files-results.md",
        "files-studies.md",
        "compare.md",
        "export.md",
        "how-to/after-mastering.md",
        "how-to/app.md",
        "how-to/plant.md",
    )
]
_MARK = re.compile(r"(<!-- keys (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)


class Row(NamedTuple):
    """A key: dotted below the file's, its default in words, its meaning."""

    key: str
    default: str
    meaning: str


def rows(name: str, *parts: str) -> Iterator[Row]:
    """The keys of a schema in the order of the models: those below `parts` alone, if there are any, and none
    below those that begin with a minus; `.` stands for the keys of the file itself. A key of several models
    has the meanings of all."""
    schema = json_schema(name)
    chosen = [part for part in parts if not part.startswith("-")]
    without = [f"{part[1:]}." for part in parts if part.startswith("-")]
    kept: dict[str, Row] = {}
    for row in _below(schema, schema, ""):
        if chosen == ["."]:
            if "." in row.key:
                continue
        elif chosen and not any(row.key.startswith(f"{part}.") for part in chosen):
            continue
        if any(row.key.startswith(part) for part in without):
            continue
        other = kept.setdefault(row.key, row)
        if row.meaning not in other.meaning:
            kept[row.key] = other._replace(meaning=f"{other.meaning}; {row.meaning}")
    yield from kept.values()


def _below(part: dict[str, Any], whole: dict[str, Any], above: str) -> Iterator[Row]:
    required = part.get("required", [])
    for name, content in part.get("properties", {}).items():
        inner = list(_objects(content, whole))
        default = "" if inner else _in_words(content.get("default"))
        words = [f"`{word}`" for word in _words(content, whole)]
        listed = all(word.strip("`") in content.get("description", "") for word in words)
        allowed = "" if listed or inner else f" ({', '.join(words)})"
        meaning = f"{content.get('description', '')}{allowed}".strip().replace("|", "\\|")
        yield Row(f"{above}{name}", "required" if name in required else default, meaning)
        for joint, model in inner:
            # Where none of the keys below has a meaning, that of the key above names them.
            if any(content.get("description") for content in model["properties"].values()):
                yield from _below(model, whole, f"{above}{name}.{joint}")


def _objects(content: dict[str, Any], whole: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The objects that a value may be or hold, with what stands for their place in it."""
    if "$ref" in content:
        content = whole["$defs"][content["$ref"].rpartition("/")[2]]
    if "properties" in content:
        yield "", content
    for other in (*content.get("anyOf", ()), *content.get("allOf", ()), *content.get("oneOf", ())):
        yield from _objects(other, whole)
    if isinstance(content.get("items"), dict):
        yield from _objects(content["items"], whole)
    if isinstance(content.get("additionalProperties"), dict):
        for joint, model in _objects(content["additionalProperties"], whole):
            yield f"<name>.{joint}", model


def _in_words(default: object) -> str:
    if default is None or default in ([], {}, ""):
        return ""
    if isinstance(default, float):
        return f"`{default:g}`"
    if isinstance(default, list):
        return f"`[{', '.join(_in_words(part).strip('`') for part in default)}]`"
    return f"`{default if isinstance(default, str) else json.dumps(default)}`"


def _words(content: dict[str, Any], whole: dict[str, Any]) -> list[str]:
    """The words that a value may be."""
    if "$ref" in content:
        content = whole["$defs"][content["$ref"].rpartition("/")[2]]
    named = content.get("enum", [content["const"]] if "const" in content else [])
    others = [
        *content.get("anyOf", ()),
        *([content["items"]] if isinstance(content.get("items"), dict) else []),
    ]
    return [
        *filter(lambda word: isinstance(word, str), named),
        *(w for o in others for w in _words(o, whole)),
    ]


def table(name: str, *parts: str) -> str:
    """The table of a schema, as Markdown; what zerobeam writes has no defaults."""
    if name == "end-points":
        lines = ["| end point | takes | answers |", "|---|---|---|"]
        lines += [f"| `{point}` | {takes} | {answers} |" for point, takes, answers in _end_points()]
    elif name not in FILE_SCHEMAS:
        lines = ["| key | meaning |", "|---|---|"]
        lines += [f"| {keys} | {meaning} |" for keys, meaning in _by_meaning(rows(name, *parts))]
    else:
        lines = ["| key | default | meaning |", "|---|---|---|"]
        lines += [f"| `{row.key}` | {row.default} | {row.meaning} |" for row in rows(name, *parts)]
    return "\n".join(lines) + "\n"


def _by_meaning(rows: Iterable[Row]) -> Iterator[tuple[str, str]]:
    """Keys and their meaning; those of one object that follow each other without a meaning are one row."""
    for (_, meaning, _), group in groupby(
        rows, lambda row: (row.key.rpartition(".")[0], row.meaning, row.meaning and row.key)
    ):
        first, *others = [row.key for row in group]
        yield ", ".join(f"`{key}`" for key in (first, *(key.rpartition(".")[2] for key in others))), meaning


def _end_points() -> Iterator[tuple[str, str, str]]:
    """Method and path of each end point of the app, the keys of what is sent, what comes back."""
    whole = description()
    for path, methods in whole["paths"].items():
        for method, operation in methods.items():
            names = [each["name"] for each in operation["parameters"] if each["in"] == "query"]
            if "requestBody" in operation:
                content = operation["requestBody"]["content"]["application/json"]["schema"]
                names += whole["components"]["schemas"][content["$ref"].rpartition("/")[2]]["properties"]
            takes = ", ".join(f"`{name}`" for name in names)
            yield f"{method.upper()} {path}", takes, operation["summary"].replace("|", "\\|")


def written(page: str) -> str:
    """The page with its tables made anew."""
    return _MARK.sub(lambda mark: f"{mark[1]}{table(*mark[2].split())}{mark[3]}", page)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(written(page.read_text(encoding="utf-8")), encoding="utf-8")
