"""CONTRIBUTING, "To add a kind of answer", followed with a made-up one: it is all that such a kind takes."""

import inspect
import io
import json
import re
from pathlib import Path

import jsonschema
import made_up_kind
import pypdf
import pytest
from made_up_kind import SCHEMA, Level, level_page, write_level
from pages import Page
from rich.console import Console
from study_text import text_of

from zerobeam.analysis.row import ParameterRow
from zerobeam.experiments import schema
from zerobeam.model.errors import UnsoundResult
from zerobeam.model.records import dumps, read
from zerobeam.reports.output.html import card
from zerobeam.reports.output.terminal import page_text, print_page
from zerobeam.words.sentences import to_json

ROOT = Path(__file__).resolve().parents[2]
TILTED = "The rotation about x is 0.4°."


def row(about: str, estimate: float | None) -> ParameterRow:
    if estimate is None:
        return ParameterRow(f"about {about}", "deg", "unidentifiable", None, None, None)
    return ParameterRow(
        f"about {about}", "deg", "identified", estimate, 0.02, (estimate - 0.04, estimate + 0.04)
    )


def level(x: float | None = 0.4, y: float | None = None) -> Level:
    return Level(robot="irb1600", limit=0.1, rotations=(row("x", x), row("y", y)))


def test_the_kind_is_no_longer_than_contributing_says() -> None:
    steps = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("### To add a kind of answer")[1]
    steps = steps.split("###")[0]
    source = inspect.getsource(made_up_kind)
    assert len(source.splitlines()) <= 80
    assert re.findall(r"^(\d)\. ", steps, re.MULTILINE) == [
        *re.findall(r"^# (\d)\. ", source, re.MULTILINE),
        "5",
    ]
    called = set(re.findall(r"\b(\w+)\(", steps)) - {"worded", "sentences", "inline", "only"}
    both = source + Path(__file__).read_text(encoding="utf-8")
    assert {name for name in called if f"{name}(" not in both} == set()


def test_it_is_json_and_is_read_back_with_a_schema(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(schema._ANSWERS, "level", Level)
    content = to_json(level())
    assert content["schema"] == SCHEMA
    assert content["verdict"] == "degenerate"
    assert read(Level, dumps(content)) == level()
    jsonschema.validate(content, schema.json_schema("level"))


def test_what_is_not_determined_cannot_have_a_number() -> None:
    content = to_json(level())
    content["rotations"][1]["estimate"] = 0.07
    with pytest.raises((UnsoundResult, ValueError), match="about y"):
        read(Level, dumps(content))
    assert "0.07" not in page_text(level_page(level()))


def test_terminal_notebook_html_and_pdf_say_the_same(tmp_path: Path) -> None:
    text = io.StringIO()
    print_page(Console(file=text, width=80), level_page(level()).brief)
    written = write_level(tmp_path / "level", level())
    html = Page(written.html.read_text(encoding="utf-8"))
    pdf = text_of(pypdf.PdfReader(written.pdf))
    notebook = Page(card(level_page(level()), []))
    for words in (" ".join(text.getvalue().split()), html.words, pdf, page_text(level_page(level()))):
        assert TILTED in words
        assert "Shim the base for the rotation about x, and measure again." in words
        assert "not determined" in words
    assert TILTED in notebook.words
    assert json.loads(written.result.read_text(encoding="utf-8")) == to_json(level())
    assert level_page(level(0.02, 0.01)).verdict.key == "pass"
    assert level_page(level(0.4, 0.01)).verdict.key == "weak"
    assert level_page(level()).verdict.key == "degenerate"


def test_the_app_shows_its_page(tmp_path: Path) -> None:
    pytest.importorskip("starlette")
    from starlette.testclient import TestClient

    from zerobeam.app.server.guard import Access
    from zerobeam.app.server.index import Folder
    from zerobeam.app.server.serve import application

    write_level(tmp_path / "level", level())
    ours = {"X-Zerobeam": "1", "Authorization": "Bearer token"}
    app = application(Folder(tmp_path), Access(token="token"))
    with TestClient(app, base_url="http://127.0.0.1:8800", headers=ours) as client:
        assert "level/level.json" in [file["path"] for file in client.get("/api/files").json()]
        shown = client.get("/report/level/level.html")
    assert shown.status_code == 200
    assert TILTED in Page(shown.text).words
