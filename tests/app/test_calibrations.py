"""A new calibration: a folder with a header that can be used, and a command that the app carries out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from app_jobs import begun, ended
from starlette.testclient import TestClient

from zerobeam.experiments.plans.new_calibration import place_of, reach_of
from zerobeam.model.files.measurements import read_header
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, load_robot
from zerobeam.model.instruments.registry import KINDS

FRONT = {"kind": "front"}
WHOLE: dict[str, Any] = {"name": "cell 4", "robot": "ur5e", "instrument": "laser", "place": FRONT}


def test_what_can_be_chosen(client: TestClient) -> None:
    choices = client.get("/api/calibrations/choices").json()
    assert [row["name"] for row in choices["instruments"]] == list(KINDS)
    assert {row["name"]: row["about"] for row in choices["instruments"]}["dial"].startswith("A dial gauge")
    assert [row["kind"] for row in choices["places"]] == ["front", "floor", "point"]


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
        front, floor = (place_of(kind, robot, None) for kind in ("front", "floor"))
        assert front[2] > 0 >= floor[2] == -(robot.conventions.below_base or 0)
    at = {"kind": "point", "point_mm": [700, 50, -20], "facing": [0, 1, 1]}
    made = client.post("/api/calibrations", json=WHOLE | {"place": at, "measurements": 12}).json()
    assert read_header(root / made["header"]).targets["psd"].guess_mm == (700, 50, -20)
    assert {"--facing=0,1,1", "--shots=12"} <= set(made["command"])


def test_the_floor_is_as_high_as_the_mounting_face(client: TestClient, root: Path) -> None:
    asked = {"robot": "lrmate_200id", "instrument": "laser"}
    proposal = client.post("/api/calibrations/proposal", json=asked).json()
    places = {row["kind"]: row["at_mm"] for row in proposal["places"]}
    assert sorted(places) == ["floor", "front"]
    assert places["floor"][2] == -330  # its base frame is on axis 2, 330 mm above
    made = client.post("/api/calibrations", json=WHOLE | asked | {"place": {"kind": "floor"}}).json()
    assert list(read_header(root / made["header"]).targets["psd"].guess_mm or ()) == places["floor"]


def test_decimals_of_a_stated_point_are_kept(client: TestClient, root: Path) -> None:
    at = {"kind": "point", "point_mm": [500.5, 0.25, -20.125]}
    made = client.post("/api/calibrations", json=WHOLE | {"place": at}).json()
    assert read_header(root / made["header"]).targets["psd"].guess_mm == (500.5, 0.25, -20.125)


def test_how_the_instrument_is_mounted_is_assumed_or_stated(client: TestClient, root: Path) -> None:
    asked = {"robot": "ur5e", "instrument": "laser"}
    assumed = client.post("/api/calibrations/proposal", json=asked).json()["mounted"]
    assert assumed == {"point_mm": [0, 0, 65], "direction": [1, 0, 0]}
    for name, mounted in {"a": {}, "b": {"point_mm": [40.5, 0, 80], "direction": [0, 0, 1]}}.items():
        made = client.post("/api/calibrations", json=WHOLE | {"name": name, "mounted": mounted}).json()
        tool = read_header(root / made["header"]).model_dump(mode="json")["tool"]
        assert {key: tool[key] for key in assumed} == assumed | mounted
    unasked = client.post("/api/calibrations/proposal", json=asked | {"instrument": "pose"}).json()
    assert unasked["mounted"] == {}


def test_a_calibration_without_a_plan_is_taken_back(client: TestClient, root: Path) -> None:
    made = client.post("/api/calibrations", json=WHOLE).json()
    which = {"name": made["name"], "version": made["version"]}
    refusals = [which | {"version": "0"}, which | {"name": "."}, which | {"name": "../cell 4"}]
    for asked in refusals:
        assert client.post("/api/calibrations/withdraw", json=asked).status_code == 400
    (root / "cell 4/note.txt").write_text("mine")
    assert client.post("/api/calibrations/withdraw", json=which).status_code == 400
    assert (root / made["header"]).is_file()
    (root / "cell 4/note.txt").unlink()
    assert client.post("/api/calibrations/withdraw", json=which).json() == {"name": "cell 4"}
    assert not (root / "cell 4").exists()


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
        ({"mounted": {"tip_mm": [0, 0, 1]}}, ["instrument"]),
        ({"mounted": {"point_mm": [0, 1]}}, ["mounted", "point_mm"]),
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
    assert (states["example"]["kind"], states["example"]["text"][:15]) == ("pass", "Simulated: pass")


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
    assert len(read_plan(root / "cell 4/plan.yaml").postures) == 30 + 2  # two of them again
