"""The calibrations of a folder: what each has, how far it is, and what is broken is said where it is."""

import hashlib
import json
import os
import re
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from histories import a_result, write_result
from starlette.testclient import TestClient

from zerobeam.app.server import index
from zerobeam.app.server.answers import home
from zerobeam.app.server.index import Folder
from zerobeam.experiments.history.arm_history import arm_drift
from zerobeam.experiments.history.database import open_history
from zerobeam.experiments.history.store import add, results
from zerobeam.experiments.history.stored_result import read_entry
from zerobeam.model.files.robot_file import BUILT_IN
from zerobeam.model.files.run import read_run, write_run

HEADER = "robot: ur5e\ntool: {kind: probe, point_mm: [0, 0, 60]}\nnoise: {joint_deg: 0.01, spot_mm: 0.1}\n"


def listed(client: TestClient) -> dict[str, Any]:
    answer = client.get("/api/home")
    assert answer.status_code == 200, answer.text
    return {row["name"]: row for row in answer.json()["calibrations"]}


def dated(root: Path, names: list[str]) -> None:
    """The files as if they were made one after the other."""
    for i, name in enumerate(names):
        os.utime(root / name, (1.7e9 + 60 * i, 1.7e9 + 60 * i))


def part_of_run(root: Path, name: str, shots: int) -> None:
    """A run of plan.yaml that has reached a number of its seven measurements."""
    run = read_run(root / "run.jsonl")
    sha256 = hashlib.sha256((root / "plan.yaml").read_bytes()).hexdigest()
    provenance = {"origin": "by hand", "serial": "123-4", "plan sha256": sha256}
    header = run.header.model_copy(update={"provenance": provenance})
    write_run(root / name, header, run.shots[:shots])


def test_each_folder_has_the_state_of_its_newest_file(client: TestClient, root: Path) -> None:
    (root / "a").mkdir()
    (root / "a/header.yaml").write_text(HEADER)
    part_of_run(root, "five.jsonl", 5)
    (root / "run.jsonl").unlink()
    dated(root, ["plan.yaml", "five.jsonl", "a/header.yaml"])
    answer = listed(client)
    assert list(answer) == ["a", "."]
    assert answer["a"] == {
        "name": "a",
        "robot": "ur5e",
        "maker": "universal-robots",
        "model": "UR5e",
        "serial": None,
        "instrument": "probe",
        "files": {key: [] for key in answer["a"]["files"]} | {"header": ["a/header.yaml"]},
        "state": {"kind": "empty", "text": "no plan yet", "file": "a/header.yaml"},
        "due": None,
        "simulated": False,
        "modified": answer["a"]["modified"],
    }
    assert answer["."]["state"] == {
        "kind": "measuring",
        "text": "measured 5 of 7",
        "recorded": 5,
        "of": 7,
        "file": "five.jsonl",
    }
    assert (answer["."]["serial"], answer["."]["files"]["plan"]) == ("123-4", ["plan.yaml"])
    (root / "five.jsonl").unlink()
    assert listed(client)["."]["state"]["text"] == "planned: 7 measurements"


def test_a_run_of_which_all_is_recorded_is_measured(client: TestClient, root: Path) -> None:
    part_of_run(root, "whole.jsonl", 7)
    dated(root, ["plan.yaml", "run.jsonl", "whole.jsonl"])
    state = listed(client)["."]["state"]
    assert (state["kind"], state["text"]) == ("measured", "measured: 7 measurements")


def test_a_report_belongs_to_the_calibration_of_its_run(
    client: TestClient, root: Path, reported: Path
) -> None:
    shutil.copytree(reported, root / "sub", dirs_exist_ok=True)
    runs = sorted(path.stem for path in (root / "sub").glob("*.jsonl"))
    answer = listed(client)
    assert set(answer) == {".", "sub"}
    row = answer["sub"]
    assert sorted(row["files"]["result"]) == [f"sub/{name}/result.json" for name in runs]
    dated(root, [f"sub/{name}.jsonl" for name in runs] + [f"sub/{name}/result.json" for name in runs])
    row = listed(client)["sub"]
    result = json.loads((root / row["state"]["file"]).read_text())
    worst = result["message"]["worst"]
    assert row["state"]["verdict"] == result["verdict"]
    assert row["state"]["text"].startswith(result["message"]["verdict"].partition(".")[0])
    if worst is not None and worst["value"] is not None:
        assert f"(J{worst['name'].removeprefix('delta')})" in row["state"]["text"]
    assert row["simulated"]  # the demo's runs are
    # A copy of a report, far from its run, is a calibration of its own.
    shutil.copytree(root / "sub" / runs[0], root / "copy" / "report")
    assert "copy/report" in listed(client)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("plan.yaml", "schema: zerobeam/plan/1\nrobot: ur5e\n", "plan.yaml: "),
        ("run.jsonl", '{"schema": "zerobeam/run/1", \n', "run.jsonl: this is no whole header of a run"),
        ("result.json", '{\n "schema": "zerobeam/result/1"}', "result.json: this is not a whole result"),
        ("header.yaml", "robot: ur55\ntool: 1\nnoise: 2\n", "header.yaml: "),
        ("plan.yaml", "schema: zerobeam/plan/1\nrobot: ../../outside.yaml\n", "plan.yaml: "),
    ],
)
def test_a_broken_file_is_said_where_it_is(
    client: TestClient, root: Path, name: str, content: str, said: str
) -> None:
    (root / "broken").mkdir()
    (root / "broken" / name).write_text(content)
    answer = listed(client)
    assert answer["broken"]["state"]["kind"] == "unreadable"
    assert answer["broken"]["state"]["text"].startswith(said)
    assert "swordfish" not in json.dumps(answer)
    assert str(root) not in json.dumps(answer)
    assert answer["."]["state"]["kind"] in ("measured", "planned")


def test_a_plan_is_read_anew_once_its_robot_is_there(client: TestClient, root: Path) -> None:
    (root / "own").mkdir()
    plan = (root / "plan.yaml").read_text()
    (root / "own/plan.yaml").write_text(re.sub(r"^robot: .*$", "robot: arm.yaml", plan, flags=re.MULTILINE))
    dated(root, ["own/plan.yaml"])
    state = listed(client)["own"]["state"]
    assert (state["kind"], "the file of the robot is not there" in state["text"]) == ("unreadable", True)
    shutil.copy(BUILT_IN / "irb1600.yaml", root / "own/arm.yaml")
    assert listed(client)["own"]["state"]["text"] == "planned: 7 measurements"


def test_links_lead_nowhere(client: TestClient, root: Path) -> None:
    (root.parent / "elsewhere").mkdir()
    (root.parent / "elsewhere/header.yaml").write_text(HEADER)
    (root / "way").symlink_to("../elsewhere")
    (root / "sub/header.yaml").symlink_to("../../elsewhere/header.yaml")
    assert set(listed(client)) == {"."}


@pytest.mark.long
def test_five_hundred_runs_are_read_once(
    client: TestClient, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = (root / "run.jsonl").read_text()
    names = [f"c{i:03}" for i in range(500)]
    for name in names:
        (root / name).mkdir()
        (root / name / "run.jsonl").write_text(run)
    dated(root, [f"{name}/run.jsonl" for name in names])
    monkeypatch.setattr(home, "PATIENCE_S", 60.0)
    first = listed(client)
    assert len(first) == 501
    monkeypatch.setattr(index._facts_of, "make", None)  # whatever is read anew fails
    assert listed(client) == first


def test_what_takes_long_is_said_next_time(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dated(root, ["run.jsonl", "plan.yaml"])
    (root / "sub/plan.yaml").write_text((root / "plan.yaml").read_text() + "# another\n")
    dated(root, ["sub/plan.yaml"])
    monkeypatch.setattr(home, "PATIENCE_S", -1.0)
    late = home.home(Folder(root))
    state = {row.name: row.state for row in late.calibrations}["sub"]
    assert (late.unread > 0, state.kind, state.text) == (True, "planned", "not read yet")
    monkeypatch.setattr(home, "PATIENCE_S", 60.0)
    assert home.home(Folder(root)).unread == 0


def history_of(folder: Path, *dates: str) -> None:
    """Results of arm 123-4 of these dates, in history.db."""
    made = open_history(str(folder / "history.db"), create=True)
    entries = []
    for when in dates:
        file = write_result(folder.parent / "one.json", a_result("123-4", when))
        entry = read_entry(file, lambda sha256: None)
        assert entry is not None
        entries.append(entry)
    add(made, entries)
    made.engine.dispose()


def dues(client: TestClient) -> Any:
    """The due date of the folder itself, once nothing is under way."""
    time.sleep(0.11)  # what was written just now is not kept
    listed(client)
    home._FITS.submit(list).result(timeout=60)  # one after the other
    return listed(client)["."]["due"]


def test_the_due_date_is_that_of_the_drift(client: TestClient, root: Path) -> None:
    part_of_run(root, "five.jsonl", 5)
    assert dues(client) is None
    history_of(root, "2020-01-31", "2021-01-31")
    history = open_history(str(root / "history.db"))
    arm = ("123-4", "irb1600")
    drift = arm_drift(arm, list(results(history, arm)), [], 0.5)
    assert drift.due is not None
    answer = dues(client)
    assert answer["date"] == f"{drift.due:%Y-%m-%d}"
    assert answer["overdue"]
    assert answer["text"].startswith(f"Calibration due since {answer['date']}")
    # Another result, another version, another date.
    history_of(root, "2024-01-31")
    later = dues(client)
    again = arm_drift(arm, list(results(history, arm)), [], 0.5)
    assert again.due is not None
    assert later["date"] == f"{again.due:%Y-%m-%d}" != answer["date"]
    history.engine.dispose()


def test_the_history_of_other_arms_or_of_another_program_gives_no_date(
    client: TestClient, root: Path
) -> None:
    history_of(root, "2020-01-31", "2021-01-31")
    (root / "notes.db").write_text("no database")
    assert dues(client) is None  # run.jsonl states another arm
    assert (root / "notes.db").read_text() == "no database"


def test_nobody_waits_for_a_long_fit(tmp_path: Path) -> None:
    history_of(tmp_path, "2020-01-31", "2021-01-31")
    database = tmp_path / "history.db"
    time.sleep(0.11)  # what was written just now is not kept
    assert home.due_dates([database], {"123-4"}, patience_s=0.0) == {}
    assert list(home.due_dates([database], {"123-4"}, patience_s=60.0)) == ["123-4"]
    began = time.monotonic()
    assert list(home.due_dates([database], {"123-4"}, patience_s=0.0)) == ["123-4"]
    assert time.monotonic() - began < 0.5
