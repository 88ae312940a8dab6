"""Reports as a browser shows them, on phone, laptop and paper: nothing fetched, nothing wrong, all there."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from chromium import LAPTOP, PHONE, SIZES, Size, chromium
from demo_reports import demo_reports
from example_results import EXAMPLES, drawn
from pages import Page, assert_fetches_nothing

from zerobeam.analysis.answer.result import Result
from zerobeam.model.records import dumps
from zerobeam.reports.output.html import html
from zerobeam.reports.run.report import report_page
from zerobeam.reports.run.run_scene import run_turnable
from zerobeam.words import numbers
from zerobeam.words.sentences import to_json

pytestmark = pytest.mark.browser


@dataclass(frozen=True)
class Seen:
    """A page after it was loaded: what can be read, what was said on its console, what it asked for, by how
    many pixels it is too wide."""

    text: str
    console: list[str]
    asked: list[str]
    overflow: int


def seen(file: Path, size: Size = LAPTOP) -> Seen:
    with chromium().opened(file, size) as tab:
        return Seen(tab.text, tab.console, tab.asked, tab.overflow())


def findings(file: Path, size: Size) -> list[str]:
    """What axe-core calls serious or critical."""
    with chromium().opened(file, size) as tab:
        return tab.accessibility()


@pytest.fixture(scope="module")
def report() -> Path:
    chromium()
    return demo_reports().folder / "good"


def written(folder: Path, result: Result) -> Path:
    file = folder / "report.html"
    page = html(report_page(result), drawn(result), "report", dumps(to_json(result)), run_turnable(result))
    file.write_text(page, encoding="utf-8")
    return file


def test_nothing_in_the_file_would_load_from_elsewhere(report: Path) -> None:
    page = (report / "report.html").read_text(encoding="utf-8")
    loading = re.findall(
        r"""(?:\bsrc|\bsrcset|\bdata|\bposter|<link[^>]*\bhref|xlink:href)\s*=\s*["']([^"']*)""", page
    )
    loading += re.findall(r"url\(\s*[\"']?([^)\"']*)", page) + re.findall(r"@import[^;]*", page)
    assert loading  # the typeface at least
    assert [found for found in loading if not found.startswith(("data:", "#"))] == []
    assert_fetches_nothing(Page(page))


@pytest.mark.parametrize("size", SIZES)
def test_the_report_says_what_the_result_says_wherever_it_is_read(report: Path, size: str) -> None:
    found = seen(report / "report.html", SIZES[size])
    assert found.console == []
    assert found.asked == []
    assert found.overflow == 0
    answer: Any = json.loads((report / "result.json").read_text(encoding="utf-8"))
    assert answer["message"]["verdict"].replace("\u00a0", " ") in found.text  # as the browser gives text
    assert answer["message"]["action"]["command"] in found.text
    entered = answer["next_steps"]["enter"]
    assert len(entered) == 4
    for row in entered:
        told = f"J{row['name'].removeprefix('delta')} {row['value']} {row['expanded_u']}"
        assert told in found.text, told
    assert "J1 held: base frame" in found.text
    assert "J6 no: laser's mounting assumed" in found.text


def test_the_scene_turns_and_says_where_the_target_stands(report: Path) -> None:
    answer: Any = json.loads((report / "result.json").read_text(encoding="utf-8"))
    (target,) = answer["scene"]["targets"]
    std = [target["covariance_mm2"][i][i] ** 0.5 for i in range(3)]
    place = [numbers.estimate(value, own) for value, own in zip(target["at_mm"], std, strict=True)]
    with chromium().opened(report / "report.html") as tab:
        assert f"psd at {', '.join(place)} mm, half axes of its 95 % ellipsoid" in tab.text
        assert tab.value("document.getElementById('scene').className") == "alive"
        assert "measurement 0 at psd (1 of 9)" in tab.text
    assert "script-src 'sha256-" in Page((report / "report.html").read_text(encoding="utf-8")).policy


def test_the_figures_are_drawn_in_the_page(report: Path) -> None:
    with chromium().opened(report / "report.html") as tab:
        drawn_high = "[...document.querySelectorAll('figure svg')].filter((s) => s.clientHeight > 100).length"
        assert tab.value("document.querySelectorAll('figure').length") >= 3
        assert tab.value(drawn_high) >= 3


@pytest.mark.parametrize("size", ["laptop", pytest.param("phone", marks=pytest.mark.long)])
def test_the_accessibility_checker_has_no_serious_finding(report: Path, size: str) -> None:
    assert findings(report / "report.html", SIZES[size]) == []


@pytest.mark.parametrize(
    "name", [name if name == "x_pattern" else pytest.param(name, marks=pytest.mark.long) for name in EXAMPLES]
)
@pytest.mark.long
def test_so_it_is_for_runs_that_tell_little(name: str, tmp_path: Path) -> None:
    file = written(tmp_path, EXAMPLES[name])
    assert findings(file, PHONE) == []
    for size in SIZES.values():
        found = seen(file, size)
        assert (found.console, found.asked, found.overflow) == ([], [], 0)


def test_a_page_that_complains_fetches_or_leaves_people_out_is_caught(tmp_path: Path) -> None:
    file = tmp_path / "bad.html"
    # Port 9 of this machine: nothing answers, and nothing leaves it.
    file.write_text(
        '<!doctype html><meta name="viewport" content="width=device-width, initial-scale=1">'
        "<script>console.error('oops')</script><img src='http://127.0.0.1:9/x.png'>hello"
        "<button></button><p style='width: 3000px; color: #ccc; background: #fff'>pale</p>"
    )
    assert all(seen(file, size).overflow > 1000 for size in SIZES.values())
    found = seen(file)
    assert any("oops" in line for line in found.console)
    assert found.asked == ["http://127.0.0.1:9/x.png"]
    assert found.text == "hello pale"
    told = " ".join(findings(file, LAPTOP))
    assert all(rule in told for rule in ("image-alt", "button-name", "color-contrast", "html-has-lang"))
