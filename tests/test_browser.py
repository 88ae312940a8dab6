"""The report of the built-in good run as a browser shows it: nothing fetched, nothing wrong, all there."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from command_line import zerobeam

from zerobeam.experiments.demos import demo_runs
from zerobeam.reports import numbers

pytestmark = pytest.mark.browser

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
]


@dataclass(frozen=True)
class Seen:
    """A page after it was loaded: its elements as HTML, what it said on its console, what it asked for."""

    page: str
    console: list[str]
    asked: list[str]

    @property
    def text(self) -> str:
        return _Text.of(self.page)


class _Text(HTMLParser):
    """Visible text, with single spaces."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self.hidden = 0

    @classmethod
    def of(cls, page: str) -> str:
        parser = cls()
        parser.feed(page)
        return " ".join(" ".join(parser.parts).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.hidden += tag in ("style", "script", "head")

    def handle_endtag(self, tag: str) -> None:
        self.hidden -= tag in ("style", "script", "head")

    def handle_data(self, data: str) -> None:
        if not self.hidden:
            self.parts.append(data)


@pytest.fixture(scope="module")
def browser() -> str:
    found = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"none of these is on this machine: {', '.join(_BROWSERS)}")
    return found


def opened(browser: str, file: Path, folder: Path) -> Seen:
    """Load a file; requests that the browser makes on its own behalf do not count, those of the page do."""
    log = folder / "net.json"
    command = [browser, *_FLAGS, f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}"]
    done = subprocess.run(
        [*command, "--dump-dom", file.as_uri()],
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    assert done.stdout, done.stderr[-2000:]
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    events = json.loads(log.read_text(encoding="utf-8"))["events"]
    requests = [event["params"] for event in events if "initiator" in event.get("params", {})]
    asked = [request["url"] for request in requests if request["initiator"] != "not an origin"]
    return Seen(done.stdout, console, asked)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("browser") / "report"
    assert zerobeam("report", demo_runs()[0].path, "-o", folder).status == 0
    return folder


@pytest.fixture(scope="module")
def seen(browser: str, report: Path, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return opened(browser, report / "report.html", tmp_path_factory.mktemp("chromium"))


def test_the_page_says_nothing_on_the_console_and_asks_for_nothing(seen: Seen) -> None:
    assert seen.console == []
    assert seen.asked == []


def test_nothing_in_the_file_would_load_from_elsewhere(report: Path) -> None:
    page = (report / "report.html").read_text(encoding="utf-8")
    loading = re.findall(
        r"""(?:\bsrc|\bsrcset|\bdata|\bposter|<link[^>]*\bhref|xlink:href)\s*=\s*["']([^"']*)""", page
    )
    loading += re.findall(r"url\(\s*[\"']?([^)\"']*)", page) + re.findall(r"@import[^;]*", page)
    assert loading  # the typeface at least
    assert [found for found in loading if not found.startswith(("data:", "#"))] == []
    assert "<script" not in page


def test_verdict_and_every_offset_stand_there_as_in_the_result(seen: Seen, report: Path) -> None:
    answer: Any = json.loads((report / "result.json").read_text(encoding="utf-8"))
    assert "Pass." in seen.text
    assert answer["headline"].replace("delta", "δ") in seen.text
    offsets = [row for row in answer["parameters"] if row["group"] == "offset"]
    assert len(offsets) == 6
    for row in offsets:
        name = row["name"].replace("delta", "δ")
        if row["held"]:
            told = f"{name} held at 0°"
        else:
            told = f"{name} {numbers.estimate(row['estimate'], row['std'], 'deg')}"
            low, high = row["interval95"]
            told += f" {numbers.interval((low, high), row['std'], 'deg')} identified"
        assert told in seen.text, told


def test_the_figures_are_drawn_in_the_page(seen: Seen) -> None:
    assert seen.page.count("<figure") == 3
    assert seen.page.count("<svg") >= 3


def test_a_page_that_complains_or_fetches_is_caught(browser: str, tmp_path: Path) -> None:
    file = tmp_path / "bad.html"
    # Port 9 of this machine: nothing answers, and nothing leaves it.
    file.write_text(
        "<!doctype html><script>console.error('oops')</script><img src='http://127.0.0.1:9/x.png'>hello"
    )
    seen = opened(browser, file, tmp_path)
    assert any("oops" in line for line in seen.console)
    assert seen.asked == ["http://127.0.0.1:9/x.png"]
    assert seen.text == "hello"
