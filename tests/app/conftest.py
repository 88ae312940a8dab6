"""A folder with a plan and a run, and the app's server for it, asked within the test's own process."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from analysed_once import analysed_once
from cells import good_plan
from command_line import plan_file
from exact_runs import demo_runs
from starlette.testclient import TestClient

import zerobeam as zb
from zerobeam.app.server.guard import Access
from zerobeam.app.server.index import Folder
from zerobeam.app.server.serve import application
from zerobeam.model.records import dumps
from zerobeam.reports.output.posterior_file import write_posterior
from zerobeam.words.sentences import to_json

TOKEN = "open-sesame"
OURS = {"X-Zerobeam": "1", "Authorization": f"Bearer {TOKEN}"}
BASE = "http://127.0.0.1:8800"


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plan_file(tmp_path_factory.mktemp("planned") / "plan.yaml", good_plan(7))


@pytest.fixture(scope="session")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of the demo with what a report has; the pages are none, they take long to draw."""
    folder = tmp_path_factory.mktemp("reported")
    for run in demo_runs()[:2]:
        shutil.copy(run.path, folder / f"{run.name}.jsonl")
        found = analysed_once(zb.read_run(run.path), ess=100)
        own = folder / run.name
        (own / "figures").mkdir(parents=True)
        (own / "result.json").write_text(dumps(to_json(found.result)))
        assert found.draws is not None
        write_posterior(own / "posterior.nc", found.result, found.draws)
        for name in ("report.html", "report.pdf", "figures/offsets.svg"):
            (own / name).write_text(name)
    return folder


@pytest.fixture
def root(tmp_path: Path, planned: Path) -> Path:
    """plan.yaml, run.jsonl, a folder `sub`, and beside the folder a file that nobody is to see."""
    folder = tmp_path / "dir"
    (folder / "sub").mkdir(parents=True)
    shutil.copy(planned, folder)
    shutil.copy(next(run.path for run in demo_runs() if run.name == "good"), folder / "run.jsonl")
    (tmp_path / "outside.yaml").write_text("secret: swordfish\n")
    return folder


@pytest.fixture
def client(root: Path) -> Iterator[TestClient]:
    with TestClient(application(Folder(root), Access(token=TOKEN)), base_url=BASE, headers=OURS) as opened:
        yield opened


@pytest.fixture
def content(client: TestClient) -> dict[str, Any]:
    """plan.yaml as the page gets it."""
    answer: dict[str, Any] = client.get("/api/plan", params={"file": "plan.yaml"}).json()["plan"]
    return answer


@pytest.fixture
def printed(root: Path) -> Callable[..., Any]:
    """What a command prints with --json."""
    from command_line import zerobeam

    return lambda *words: json.loads(zerobeam(*words).out)
