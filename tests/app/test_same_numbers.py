"""The numbers of one result are the same on the app's page, in the terminal, in the HTML report and, rounded,
in result.json: with the arm's geometry estimated and with nominal geometry."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from app_page import app, wait
from chromium import Tab, chromium
from command_line import zerobeam
from exact_runs import demo_runs

pytestmark = [pytest.mark.browser, pytest.mark.long]

Numbers = dict[str, tuple[str, str]]  # by what it is, with its expanded uncertainty
COUNT = 18


def reported(made: Path, geometry: str) -> Path:
    """A calibration `arm` with a run and its report."""
    (made / "arm").mkdir(parents=True)
    source = next(run.path for run in demo_runs() if run.name == "good")
    head, rest = source.read_text().split("\n", 1)
    header = json.loads(head)
    if geometry == "exact":
        header["geometry"] = "exact"
    run = made / "arm/run.jsonl"
    run.write_text(f"{json.dumps(header)}\n{rest}")
    assert zerobeam("report", run, "-o", made / "arm/report", "--ess", "100").status == 0
    return made


def rounded(value: float, uncertainty: float) -> str:
    """To the second significant digit of the uncertainty."""
    digits = max(0, 1 - math.floor(math.log10(uncertainty)))
    return f"{value:.{digits}f}°".replace("-", "−")


def in_json(document: dict[str, Any]) -> Numbers:
    k = document["coverage_factor"]
    numbers = {}
    for row in document["parameters"]:
        if row["group"] == "offset" and not row["held"]:
            expanded = k * row["std"]
            numbers[f"J{row['name'][5:]}"] = (rounded(row["estimate"], expanded), rounded(expanded, expanded))
    for row in document["next_steps"]["enter"]:
        numbers[f"enter J{row['name'][5:]}"] = (row["value"], row["expanded_u"])
    return numbers


def in_terminal(text: str) -> Numbers:
    """Values to enter are on page one; the offsets below it."""
    first, _, after = text.partition("Joint offsets of the arm")
    rows = re.findall(r"^(J\d) \(δ\d\) +(\S+°) +(\S+°) +\S \w", after, re.MULTILINE)
    entered = re.findall(r"^(J\d) +(\S+°) +(\S+°) +\S ", first, re.MULTILINE)
    return {name: (value, u) for name, value, u in rows} | {
        f"enter {name}": (value, u) for name, value, u in entered
    }


def in_table(tab: Tab, table: str, prefix: str = "") -> Numbers:
    """The first two numbers of each row of a table, but those that are held."""
    rows = tab.value(
        f"[...{table}.tBodies[0].rows].map((r) => [...r.cells].map((c) => c.textContent.trim()))"
    )
    return {f"{prefix}{row[0][:2]}": (row[1], row[2]) for row in rows if row[1][-1:] == row[2][-1:] == "°"}


def in_report(folder: Path) -> Numbers:
    with chromium().opened(folder / "arm/report/report.html") as tab:
        table = "[...document.querySelectorAll('table')].find((t) => t.caption?.textContent.startsWith({!r}))"
        return in_table(tab, table.format("Joint offsets of the arm")) | in_table(
            tab,
            "[...document.querySelectorAll('table')].find((t) => t.tHead.textContent.includes('trusted'))",
            "enter ",
        )


def in_app(folder: Path) -> Numbers:
    with app(folder) as server, chromium().opened(f"{server.address}#/job/arm/result") as tab:
        wait(tab, "document.querySelector('.offsets')")
        return in_table(tab, "document.querySelector('.offsets')") | in_table(
            tab, "document.querySelector('.front table')", "enter "
        )


def test_page_terminal_report_and_json_say_the_same(tmp_path: Path) -> None:
    chromium()
    for geometry in ("estimated", "exact"):
        say_the_same(reported(tmp_path / geometry, geometry))


def say_the_same(folder: Path) -> None:
    numbers = in_json(json.loads((folder / "arm/report/result.json").read_text()))
    assert sum(map(len, numbers.values())) == COUNT
    assert in_report(folder) == numbers
    assert in_app(folder) == numbers
    assert in_terminal(zerobeam("analyse", folder / "arm/run.jsonl", "--ess", "100", "--full").out) == numbers
