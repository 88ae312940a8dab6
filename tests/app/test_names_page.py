"""Script in every name that a person or a file can bring: each view of the page shows it as it is."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

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
    """A calibration with robot, plan, run with its report, and a table: NAME wherever a name may be."""
    chromium()
    root = tmp_path_factory.mktemp("names")
    made = root / NAME
    made.mkdir()
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
    return root


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as server:
        yield server.address


@contextmanager
def view(address: str, where: str) -> Iterator[Tab]:
    """What the page has at an address; afterwards nothing was carried out, and names are as they are."""
    with chromium().opened(f"{address}#/{where}", LAPTOP) as tab:
        yield tab
        assert NAME in tab.text
        assert tab.value("document.querySelectorAll('img').length") == 0
        assert tab.dialogs == []
        assert [said for said in tab.console if "WebGL" not in said] == []


def step(name: str) -> str:
    return f"job/{quote(NAME)}/{name}"


def test_every_view_shows_it_as_it_is(address: str) -> None:
    with view(address, "") as tab:
        wait(tab, "document.querySelector('.calibrations li')")
    with view(address, f"import/{quote(f'{NAME}/{TABLE}')}") as tab:
        header = "document.querySelector('select[aria-label=\"Header or plan\"]')"
        wait(tab, header)
        give(tab, header, f"{NAME}/{PLAN}")
        wait(tab, "document.querySelector('.mapper tbody tr')")
    with view(address, step("cell")) as tab:
        wait(tab, "document.querySelector('.inspector input')")
    with view(address, step("plan")) as tab:
        wait(tab, "document.querySelector('.determined tbody tr')")
    with view(address, step("result")) as tab:
        wait(tab, "document.querySelectorAll('.measurements tbody tr').length === 7")
        tab.value("document.querySelectorAll('.fold > summary').forEach((e) => e.click())")
        wait(tab, "document.querySelector('.history')")
        wait(tab, "document.querySelector('.exports')")
