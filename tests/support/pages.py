"""Pages as the tests see them: the texts of sections; of HTML tags, visible text, tables, scripts."""

import base64
import dataclasses
import hashlib
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from typing import Any

from zerobeam.reports.style.blocks import Paragraph, Section, Table

DATA = {"type": "application/json", "id": "scene-data"}  # attributes of a scene that no script runs


def strings(value: Any) -> Iterator[str]:
    """All texts of a view, in their order."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from strings(list(value.values()))
    elif isinstance(value, list | tuple):
        for item in value:
            yield from strings(item)
    elif dataclasses.is_dataclass(value):
        yield from strings(vars(value))


def paragraphs(section: Section) -> str:
    """The paragraphs of a section, as one text."""
    return " ".join(block.text for block in section.all if isinstance(block, Paragraph))


def tables(section: Section, caption: str = "") -> list[Table]:
    """The tables of a section whose caption begins so."""
    found = [block for block in section.all if isinstance(block, Table)]
    return [table for table in found if table.caption.startswith(caption)]


def table(section: Section, caption: str = "") -> Table:
    """The only one of them."""
    (only,) = tables(section, caption)
    return only


class Page(HTMLParser):
    """A well-formed page: tags with attributes, visible text, tables as rows of cells, scripts with their
    text, and what stands in `pre` to be copied."""

    void = frozenset({"meta", "link", "br", "img", "hr", "input"})

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.rows: list[list[str]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.copied = ""
        self.open: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.void:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "script" in self.open:
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        elif "style" not in self.open:
            self.text.append(data)
            if "td" in self.open or "th" in self.open:
                self.rows[-1][-1] += data.strip()
            if "pre" in self.open:
                self.copied += data

    @property
    def words(self) -> str:
        return "".join(self.text)

    def row(self, name: str) -> list[str]:
        """The first row of any table that begins with `name`."""
        return next(row for row in self.rows if row[0] == name)

    @property
    def policy(self) -> str:
        (found,) = [a["content"] for tag, a in self.tags if a.get("http-equiv") == "Content-Security-Policy"]
        assert found is not None
        return found

    @property
    def scene(self) -> Any:
        (found,) = [text for attributes, text in self.scripts if attributes.get("id") == "scene-data"]
        return json.loads(found)


def assert_fetches_nothing(page: Page) -> None:
    """Nothing embedded, no address but those inside the page, and no script but the ones that its policy
    names by their hash."""
    assert not {tag for tag, _ in page.tags} & {"iframe", "img", "object", "embed", "form", "base"}
    for tag, attributes in page.tags:
        assert not any(key.startswith("on") for key in attributes), tag
        for key in ("src", "href", "xlink:href"):
            value = attributes.get(key)
            assert value is None or value.startswith(("data:", "#")), (tag, value)
    codes = [text for attributes, text in page.scripts if attributes != DATA]
    assert all(attributes in ({}, DATA) for attributes, _ in page.scripts)
    for code in codes:
        assert not re.search(r"https?:|fetch\(|XMLHttp|import\(|WebSocket|eval\(|innerHTML", code)
    digests = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in codes]
    stated = dict(part.split(maxsplit=1) for part in page.policy.split("; "))
    assert stated.pop("default-src") == "'none'"
    assert stated.pop("script-src", "").split() == [f"'sha256-{digest}'" for digest in digests]
    assert stated == {"style-src": "'unsafe-inline'", "font-src": "data:", "img-src": "data:"}
