"""A new calibration: a folder with a header that can be used, and a command that the app carries out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from app_jobs import begun, ended
from starlette.testclient import TestClient

from zerobeam.experiments.plans.new_calibration import place_of, reach_of
from zerobeam.model.files.header_file import read_header
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, load_robot
from zerobeam.model.instruments.registry import KINDS

FRONT = {"kind": "front"}
WHOLE: dict[str, Any] = {"name": "cell 4", "robot": "ur5e", "instrument": "laser", "place": FRONT}


def test_what_can_be_chosen(client: TestClient) -> None:
    choices = client.get("/api/calibrations/choices").json()
    assert [row["name"] for row in choices["instruments"]] == list(KINDS)
    assert {row["name"]: row["about"] for row in choices["instruments"]}["dial"].startswith("A dial gauge")
    assert [row["kind"] for row in choices["places"]] == ["front", "table", "floor", "point"]


@pytest.mark.parametrize("instrument", list(KINDS))
@pytest.mark.one_in(3)
def test_each_instrument_has_a_header(client: TestClient, root: Path, instrument: str) -> None:
    answer = client.post("/api/calibrations", json=WHOLE | {"instrument": instrument, "serial": "12-345"})
    assert answer.status_code == 201, answer.text
    made = answer.json()
    assert (made["name"], made["header"]) == ("cell 4", "cell 4/header.yaml")
    header = read_header(root / made["header"])
    assert header.provenance["serial"] == "12-345"
    assert header.labels == tuple(header.kinds)
    assert [kind.name for kind in header.kinds.values()] == [instrument]
    assert all(target.guess_mm is not None for target in header.targets.values())
    assert sorted(path.name for path in (root / "cell 4").iterdir()) == ["header.yaml"]
    assert made["command"][:4] == ["plan", "optimal", "--header=cell 4/header.yaml", "--out=cell 4/plan.yaml"]
    assert ("--beam=" in " ".join(made["command"])) == (instrument == "laser")
    rows = {row["name"]: row for row in client.get("/api/home").json()["calibrations"]}
    assert (rows["cell 4"]["serial"], rows["cell 4"]["instrument"]) == ("12-345", instrument)


def test_an_own_arm_is_named_from_the_new_folder(client: TestClient, root: Path) -> None:
    text = (BUILT_IN / "ur5e.yaml").read_text().replace("name: ur5e", "name: mine")
    (root / "sub/arm.yaml").write_text(text)
    answer = client.post("/api/calibrations", json=WHOLE | {"robot": "sub/arm.yaml"})
    assert answer.status_code == 201
    assert read_header(root / "cell 4/header.yaml").robot == "../sub/arm.yaml"


@pytest.mark.long
def test_places_are_about_the_arm(client: TestClient, root: Path) -> None:
    for name in built_in_robots():
        robot = load_robot(name)
        reach = reach_of(robot)
        far = max(np.hypot(*robot.fk(np.zeros(robot.n), "deg")[:2, 3]), 100.0)
        assert far * 0.3 < reach < 4000
        front, table, floor = (place_of(kind, robot, None) for kind in ("front", "table", "floor"))
        assert front[2] > table[2] == 0 >= floor[2]
        assert floor[2] == -(robot.conventions.below_base or 0)
    at = {"kind": "point", "point_mm": [700, 50, -20], "facing": [0, 1, 1]}
    made = client.post("/api/calibrations", json=WHOLE | {"place": at, "measurements": 12}).json()
    assert read_header(root / made["header"]).targets["psd"].guess_mm == (700, 50, -20)
    assert {"--facing=0,1,1", "--shots=12"} <= set(made["command"])


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"name": "sub"}, ["name"]),
        ({"name": "plan.yaml"}, ["name"]),
        ({"name": "dangling"}, ["name"]),
        ({"name": "a/b"}, ["name"]),
        ({"name": ".hidden"}, ["name"]),
        ({"name": ".."}, ["name"]),
        ({"name": " a"}, ["name"]),
        ({"name": ""}, ["name"]),
        ({"name": "x" * 300}, ["name"]),
        ({"robot": "ur55"}, ["robot"]),
        ({"robot": "../outside.yaml"}, ["robot"]),
        ({"instrument": "sextant"}, ["instrument"]),
        ({"place": {"kind": "point"}}, ["place", "point_mm"]),
        ({"place": FRONT | {"point_mm": [1, 2, 3]}}, ["place", "point_mm"]),
        ({"place": FRONT | {"facing": [0, 0, 0]}}, ["place", "facing"]),
        ({"place": {"kind": "roof"}}, ["place", "kind"]),
        ({"measurements": 1}, ["measurements"]),
        ({"serial": 5}, ["serial"]),
    ],
)
def test_what_cannot_be_made_leaves_nothing(
    client: TestClient, root: Path, change: dict[str, Any], key: list[str]
) -> None:
    (root / "dangling").symlink_to("nowhere")
    before = sorted(root.rglob("*"))
    answer = client.post("/api/calibrations", json=WHOLE | change)
    assert (answer.status_code, answer.json()["error"]["key"]) == (400, key)
    assert sorted(root.rglob("*")) == before


def test_a_folder_that_is_made_meanwhile_is_kept(
    client: TestClient, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zerobeam.app.server.answers import calibrations

    real = calibrations.write_header

    def late(path: Path, header: Any) -> None:
        real(path, header)
        (root / "cell 4").mkdir()
        (root / "cell 4/note.txt").write_text("mine")

    monkeypatch.setattr(calibrations, "write_header", late)
    answer = client.post("/api/calibrations", json=WHOLE)
    assert (answer.status_code, answer.json()["error"]["key"]) == (400, ["name"])
    assert [path.name for path in (root / "cell 4").iterdir()] == ["note.txt"]
    assert not list(root.glob(".*part"))


def test_the_example_is_ready_to_be_rehearsed(client: TestClient, root: Path) -> None:
    made = [client.post("/api/example", json={}).json() for _ in range(2)]
    assert [row["name"] for row in made] == ["example", "example-2"]
    plan = read_plan(root / made[1]["plan"])
    header = read_header(root / made[1]["header"])
    assert (header.robot, header.tool, header.targets) == (
        plan.header.robot,
        plan.header.tool,
        plan.header.targets,
    )
    content = client.get("/api/plan", params={"file": made[1]["plan"]}).json()["plan"]
    checked = client.post("/api/check", json={"plan": content, "file": made[1]["plan"]}).json()
    assert checked["verdict"] == "pass"
    assert made[1]["command"][-1] == "example-2/plan.yaml"


@pytest.mark.long
def test_a_new_calibration_is_planned_rehearsed_and_reported(client: TestClient, root: Path) -> None:
    made = client.post("/api/calibrations", json=WHOLE).json()
    job = ended(client, begun(client, *made["command"]))
    assert (job["state"], job["answer"]["verdict"]) == ("done", "pass"), job["log"]
    example = client.post("/api/example", json={}).json()
    run = ended(client, begun(client, *example["command"]))
    assert run["state"] == "done", run["log"]
    report = ended(client, begun(client, "report", "--out=example/report", "example/run.jsonl"))
    assert report["answer"]["verdict"] == "pass", report["answer"]["headline"]
    states = {row["name"]: row["state"] for row in client.get("/api/home").json()["calibrations"]}
    assert states["cell 4"]["kind"] == "planned"
    assert states["example"]["kind"] == "held"


@pytest.mark.long
@pytest.mark.parametrize("robot", ["irb120", "ur5e", "irb6700"])
@pytest.mark.parametrize("instrument", ["plane", "sphere", "ballbar", "dial"])
def test_what_reads_one_number_is_planned_with_the_defaults(
    client: TestClient, root: Path, instrument: str, robot: str
) -> None:
    made = client.post("/api/calibrations", json=WHOLE | {"instrument": instrument, "robot": robot}).json()
    assert "--shots=30" in made["command"]
    job = ended(client, begun(client, *made["command"]))
    assert job["answer"]["verdict"] in ("pass", "weak"), job["log"]
    assert len(read_plan(root / "cell 4/plan.yaml").postures) == 30
