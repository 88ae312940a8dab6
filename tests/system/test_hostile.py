"""Whatever names a run file may hold, and whatever it may not: no harm in HTML, PDF, files or terminal.

The names go the whole way, from files through the command line. Tests of single outputs with made-up results
are with those outputs.
"""

import io
import json
import re
import unicodedata
from pathlib import Path
from typing import Any

import pypdf
import pytest
from chromium import PHONE, chromium
from command_line import Answer, zerobeam
from exact_runs import demo_runs
from pages import Page, assert_fetches_nothing
from rich.table import Table
from rich.text import Text

from zerobeam.model.files.robot_file import BUILT_IN
from zerobeam.reports.output.terminal import Terminal

SCRIPT = "</script><script>alert(1)</script>"
LONG = 'quote" onload="' + "long" * 1250
TARGETS = (SCRIPT, '#import "x": * $x^2$ @cite', "../../x 🎯 {{ 7*7 }} [bold]", LONG)
# What only the name of a file, or a free text, can hold.
UNSEEN = {"turned": "\u202etext", "nul": "nul\x00in", "escape": "\x1b[2J\x1b]0;x\x07", "lone": "lone\ud800"}
WHOLE = {"report.html", "report.pdf", "result.json", "posterior.nc", "figures"}


def unseen(text: str) -> list[str]:
    """What a terminal might take for a command, or a person would not see, but for line breaks."""
    turning = set("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
    return [
        letter
        for letter in text
        if letter in turning or (unicodedata.category(letter) in ("Cc", "Cs") and letter != "\n")
    ]


def robot_file(folder: Path) -> str:
    """The built-in arm under a name that is a script; the file's own name is another."""
    name = "<img src=x onerror=alert(2)>.yaml"
    text = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8").splitlines()
    text = [f"name: {json.dumps(SCRIPT)}" if line.startswith("name:") else line for line in text]
    (folder / name).write_text("\n".join(text), encoding="utf-8")
    return name


def run_file(folder: Path, targets: tuple[str, ...] = TARGETS, **changes: Any) -> Path:
    """The first shots of the good demo run, made at every target in turn."""
    head, *shots = map(json.loads, demo_runs()[0].path.read_text(encoding="utf-8").splitlines())
    head |= {"targets": dict.fromkeys(targets, head["targets"]["psd"]), **changes}
    rows = [shot | {"target": name} for name in targets for shot in shots[:4]]
    rows = [row | {"shot": i} for i, row in enumerate(rows)]
    path = folder / "\u202e$(touch x);<b> #import.jsonl"
    path.write_text("\n".join(map(json.dumps, [head, *rows])) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Answer]:
    """The folder in which the report `out` was made, and what the terminal said."""
    folder = tmp_path_factory.mktemp("hostile")
    texts = {f"note {i}": text for i, text in enumerate((*TARGETS, *UNSEEN.values()))}
    held = ["delta1", f"{TARGETS[1]}.x"]
    provenance = {**dict.fromkeys(TARGETS, "a name"), **texts}
    run = run_file(folder, robot=robot_file(folder), provenance=provenance, held=held)
    answer = zerobeam("report", run, "-o", folder / "out", "--ess", 100)
    assert answer.status in (0, 1), answer.err
    return folder, answer


def test_the_terminal_gets_no_commands(told: tuple[Path, Answer]) -> None:
    _, answer = told
    assert unseen(answer.out + answer.err) == []
    assert unseen("a\x1b[2J\u202e\x00\ud800\n") == ["\x1b", "\u202e", "\x00", "\ud800"]  # negative control


@pytest.mark.parametrize("name", UNSEEN)
def test_a_name_that_cannot_be_seen_is_refused_in_words_that_can(name: str, tmp_path: Path) -> None:
    for answer in (
        zerobeam("analyse", run_file(tmp_path, (UNSEEN[name],))),
        zerobeam("analyse", run_file(tmp_path, ("psd",), provenance={UNSEEN[name]: "x"})),
        zerobeam("analyse", run_file(tmp_path, ("psd",), robot=UNSEEN[name])),
    ):
        answer.refused()
        assert unseen(answer.err) == []
        assert "\\u202e$(touch x)" in answer.err


ALL_UNSEEN = "".join(UNSEEN[name] for name in ("turned", "escape")) + "\x9b31m\x7f\u2028"


@pytest.mark.parametrize("options", [(), ("--json",)], ids=["text", "json"])
def test_a_table_of_offsets_prints_no_name_raw(tmp_path: Path, options: tuple[str, ...]) -> None:
    table = tmp_path / "table.csv"
    names = (f"delta2{ALL_UNSEEN}_deg", f"first{ALL_UNSEEN}", f"second{ALL_UNSEEN}")
    rows = [["run", names[0]], [names[1], "0.1"], [names[2], "0.2"]]
    table.write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    answer = zerobeam("compare", table, *options)
    assert answer.status != 3, answer.err
    assert unseen(answer.out + answer.err) == []
    assert "u202e" in answer.out + answer.err
    if options:
        assert answer.json["runs"][0]["name"] == names[1].strip()


def test_nothing_gets_through_a_console_but_its_own_colours() -> None:
    out = io.StringIO()
    console = Terminal(file=out, force_terminal=True, width=200, color_system="standard")
    table = Table(title=ALL_UNSEEN)
    table.add_column(ALL_UNSEEN)
    table.add_row(ALL_UNSEEN)
    console.print(table, ALL_UNSEEN, Text(ALL_UNSEEN, style="red"), markup=False)
    assert "\x1b[31m" in out.getvalue()
    assert "\\u202e" in out.getvalue()
    assert unseen(re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())) == []


def test_no_name_makes_a_file(told: tuple[Path, Answer]) -> None:
    folder, _ = told
    assert {path.name for path in folder.iterdir()} == {"out", robot_file(folder), run_file(folder).name}
    assert {path.name for path in (folder / "out").iterdir()} == WHOLE
    figures = {path.name for path in (folder / "out" / "figures").iterdir()}
    assert all(re.fullmatch(r"[a-z_]+\.svg", name) for name in figures)
    assert not any((place / "x").exists() for place in (folder, folder.parent, Path.cwd()))


def test_the_result_keeps_the_names_whole(told: tuple[Path, Answer]) -> None:
    answer = json.loads((told[0] / "out" / "result.json").read_text(encoding="utf-8"))
    assert tuple(answer["inputs"]["targets"]) == TARGETS
    assert answer["inputs"]["robot"] == SCRIPT
    assert set(UNSEEN.values()) <= set(answer["inputs"]["header"]["provenance"].values())


def test_the_page_shows_names_and_obeys_none(told: tuple[Path, Answer]) -> None:
    text = (told[0] / "out" / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert_fetches_nothing(page)
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert unseen(text) == []
    assert len(text) < 3_000_000


@pytest.mark.browser
def test_chromium_shows_them_and_obeys_none(told: tuple[Path, Answer]) -> None:
    with chromium().opened(told[0] / "out" / "report.html", PHONE) as tab:
        assert tab.console == []
        assert tab.asked == []
        assert tab.dialogs == []
        assert tab.overflow() == 0
        tab.value("document.querySelectorAll('details').forEach((own) => { own.open = true; })")
        assert "<script>alert(1)</script>" in tab.text
        assert "{{ 7*7 }}" in tab.text


@pytest.mark.browser
def test_a_page_that_obeys_is_caught(tmp_path: Path) -> None:
    file = tmp_path / "bad.html"
    file.write_text("<!doctype html><script>setTimeout(() => alert(1))</script>")
    with chromium().opened(file) as tab:
        assert tab.dialogs == ["1"]


@pytest.mark.long  # pypdf takes its time; test_pdf.py has the same on a made-up result
def test_the_pdf_shows_names_and_obeys_none(told: tuple[Path, Answer]) -> None:
    reader = pypdf.PdfReader(told[0] / "out" / "report.pdf")
    # A place where a line may break (U+200B) is no letter.
    pages = [page.extract_text().replace("\u200b", "") for page in reader.pages]
    text = " ".join(" ".join(pages).split())
    assert "<script>alert(1)</script>" in text.replace(" ", "")
    assert '#import "x": * $x^2$ @cite' in text
    assert "\\U0001f3af" in text
    content = (told[0] / "out" / "report.pdf").read_bytes()
    assert not any(word in content for word in (b"/JavaScript", b"/OpenAction", b"/Launch", b"/URI"))
