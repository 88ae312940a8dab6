"""The tables of keys in docs/files.md, made of the models that read and write the files.

`python docs/file_tables.py` writes them between their marks: `<!-- keys NAME PART … -->` begins the table of
a schema (`zerobeam schema NAME`), `<!-- end -->` ends it. With parts it has the keys below these alone, with
`-PART` none below that one. `tests/experiments/test_schema.py` holds the page and the models equal.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from zerobeam.experiments.schema import json_schema

PAGE = Path(__file__).with_name("files.md")
_MARK = re.compile(r"(<!-- keys ([\w-]+)(?: ([\w.<>]+))? -->\n).*?(<!-- end -->)", re.DOTALL)


class Row(NamedTuple):
    """A key: dotted below the file's, its default in words, its meaning."""

    key: str
    default: str
    meaning: str


def rows(name: str, part: str | None = None) -> Iterator[Row]:
    """The keys of a schema, or those below its key `part`, in the order of the models."""
    schema = json_schema(name)
    for row in _below(schema, schema, ""):
        if part is None or row.key.startswith(f"{part}."):
            yield row


def _below(part: dict[str, Any], whole: dict[str, Any], above: str) -> Iterator[Row]:
    required = part.get("required", [])
    for name, content in part.get("properties", {}).items():
        inner = list(_objects(content, whole))
        default = "required" if name in required else _in_words(content.get("default"), bool(inner))
        yield Row(f"{above}{name}", default, content.get("description", ""))
        for joint, model in inner:
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


def _in_words(default: object, nested: bool) -> str:
    if default is None or nested or default in ([], {}):
        return ""
    return f"`{json.dumps(default) if not isinstance(default, str) else default}`"


def table(name: str, part: str | None = None) -> str:
    """The table of a schema, as Markdown."""
    lines = ["| key | default | meaning |", "|---|---|---|"]
    lines += [f"| `{row.key}` | {row.default} | {row.meaning} |" for row in rows(name, part)]
    return "\n".join(lines) + "\n"


def written(page: str) -> str:
    """The page with its tables made anew."""
    return _MARK.sub(lambda mark: f"{mark[1]}{table(mark[2], mark[3])}{mark[4]}", page)


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
