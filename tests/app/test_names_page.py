"""Script in every name that a person or a file can bring: each place of the page shows it as it stands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from app_page import app, give, wait
from cells import good_plan
from chromium import LAPTOP, Tab, chromium
from command_line import zerobeam

from zerobeam import model

pytestmark = [pytest.mark.browser, pytest.mark.long]

NAME = "<img src=x onerror=alert(1)>"
ROBOT, PLAN, RUN, TABLE = (f"{NAME}{end}" for end in (".yaml", " plan.yaml", ".jsonl", ".csv"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot, a plan, a run with its report, and a table: NAME wherever a name may be."""
    chromium()
    made = tmp_path_factory.mktemp("names")
    quoted = json.dumps(NAME)
    text = (Path(model.__file__).parent / "robots/irb1600.yaml").read_text()
    text = text.replace("name: irb1600", f"name: {quoted}").replace("IRB 1600-1.45", quoted)
    (made / ROBOT).write_text(text.replace("{a_mm: 150", f"{{name: {quoted}, a_mm: 150"))
    plan = good_plan(7)
    content = {
        "schema": "zerobeam/plan/1",
        "robot": ROBOT,
        "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "targets": {NAME: {"guess_mm": [900, 0, 0]}},
        "provenance": {"serial": NAME, "who": NAME, "psd": NAME, NAME: NAME},
        "postures_deg": np.degrees(plan.postures).tolist(),
    }
    (made / PLAN).write_text(json.dumps(content))
    assert zerobeam("run", made / PLAN, "-o", made / RUN, "--no-camera").status in (0, 1)
    lines = (made / RUN).read_text().splitlines(keepends=True)
    commented = [json.dumps(json.loads(line) | {"comment": NAME}) + "\n" for line in lines[1:]]
    (made / RUN).write_text("".join([lines[0], *commented]))
    assert zerobeam("report", made / RUN, "-o", made / NAME).status in (0, 1)
    head = ",".join([NAME, *(f'"{NAME}{i}"' for i in range(1, 7))])
    body = [",".join(["psd", *(f"{value:.4f}" for value in row)]) for row in np.degrees(plan.postures)]
    (made / TABLE).write_text("\n".join([head, *body, ""]))
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as server:
        yield server.address


def choose(tab: Tab, which: str, value: str) -> None:
    field = f"document.getElementById({which!r})"
    wait(tab, f"[...{field}.options].some((o) => o.value === {json.dumps(value)})")
    give(tab, field, value)


@contextmanager
def place(address: str, where: str) -> Iterator[Tab]:
    """A place of the page; afterwards nothing has been carried out, and every name is there as it stands."""
    with chromium().opened(f"{address}#{where}", LAPTOP) as tab:
        yield tab
        assert NAME in tab.text
        assert tab.value("document.querySelectorAll('img').length") == 0
        assert tab.dialogs == []
        assert tab.console == []


def test_import(address: str) -> None:
    with place(address, "import") as tab:
        choose(tab, "import-folder", TABLE)
        choose(tab, "import-header", PLAN)
        wait(tab, "document.querySelector('#import-rest table tbody tr')")


def test_robot(address: str) -> None:
    with place(address, "robot") as tab:
        choose(tab, "robot-name", ROBOT)
        wait(tab, f"document.getElementById('robot-facts').textContent.includes({json.dumps(NAME)})")


def test_plan(address: str) -> None:
    with place(address, "plan") as tab:
        choose(tab, "plan-open", PLAN)
        wait(tab, "document.querySelector('#plan-table tbody tr')")


def test_measure(address: str) -> None:
    with place(address, "measure") as tab:
        choose(tab, "measure-plan", PLAN)
        tab.value("document.getElementById('measure-start').click()")
        wait(tab, "document.getElementById('measure-now').textContent.includes('7 measurements are kept')")


def test_result(address: str) -> None:
    with place(address, f"result/{NAME}/result.json") as tab:
        wait(tab, "document.querySelectorAll('#result-measurements tbody tr').length === 7")
        wait(tab, "document.getElementById('result-unknown').textContent")
