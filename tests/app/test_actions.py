"""A message stands beside what the page can do of it: a job, other postures, another step, or nothing."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import pattern_plan
from command_line import plan_file
from starlette.testclient import TestClient

from zerobeam.analysis.answer.answer_message import Action
from zerobeam.app.server.answers.actions import action_of_result
from zerobeam.app.server.index import Folder
from zerobeam.app.server.job_commands import job_command
from zerobeam.experiments.makers.maker import makers
from zerobeam.model.records import to_json


def checked(client: TestClient, content: dict[str, Any], **other: Any) -> Any:
    answer = client.post("/api/check", json={"plan": content} | other)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_plan_that_passes_is_measured(client: TestClient, content: dict[str, Any]) -> None:
    content["noise"]["joint_deg"] = 0.002
    answer = checked(client, content)
    assert answer["verdict"] == "pass"
    message = answer["message"]
    assert message["verdict"].startswith("Pass. J2 to J5 are identified")
    worst = max(
        (row for row in answer["parameters"] if row["std"] and row["group"] == "offset"),
        key=lambda row: row["std"],
    )
    assert (message["worst"]["name"], message["worst"]["value"]) == (worst["name"], 2 * worst["std"])
    assert answer["action"] == {
        "text": message["action"]["text"],
        "label": "Measure",
        "does": {"kind": "step", "step": "measure"},
    }


def test_the_suggested_posture_makes_the_plan_better(client: TestClient, content: dict[str, Any]) -> None:
    content["noise"]["joint_deg"] = 0.3
    answer = checked(client, content)
    action = answer["action"]
    assert (answer["verdict"], action["label"]) == ("weak", "Apply the suggested posture")
    assert answer["message"]["action"]["text"] == action["text"]
    assert answer["message"]["cause"]
    rows = action["does"]["postures_deg"]
    tried = answer["identifiability"]["null_space"][0]["tried"]
    assert len(rows) == len(content["postures_deg"]) + (tried["how"] == "add")
    after = {row["name"]: row for row in checked(client, content | {"postures_deg": rows})["parameters"]}
    for promise in tried["predicted"]:
        assert promise["after"] < promise["before"]
        assert after[promise["name"]]["std"] == pytest.approx(promise["after"], rel=0.02)


@pytest.mark.long
def test_the_suggested_postures_make_joint_2_known(client: TestClient, content: dict[str, Any]) -> None:
    """Of an X-Pattern all postures are changed, as the message says."""
    content["postures_deg"] = np.degrees(pattern_plan("x").postures).tolist()
    answer = checked(client, content)
    action = answer["action"]
    assert (answer["verdict"], action["label"]) == ("degenerate", "Apply the suggested postures")
    assert action["text"].startswith("Vary joint 1 by 90°")
    (tried,) = (
        each["tried"]
        for each in answer["identifiability"]["null_space"]
        if each["combination"].get("delta2") == 1.0
    )
    (row,) = tried["predicted"]
    assert row["before"] is None
    after = checked(client, content | {"postures_deg": action["does"]["postures_deg"]})
    (delta2,) = (each for each in after["parameters"] if each["name"] == "delta2")
    assert delta2["std"] == pytest.approx(row["after"], rel=0.01)


def test_a_degenerate_plan_says_why_in_the_words_of_the_check(client: TestClient, root: Path) -> None:
    plan_file(root / "x.yaml", pattern_plan("x", aside=0.0))
    content = client.get("/api/plan", params={"file": "x.yaml"}).json()["plan"]
    answer = checked(client, content)
    message = answer["message"]
    assert message["verdict"].startswith("Degenerate. J2 is unidentifiable")
    assert "X-Pattern" in message["cause"]
    assert (message["worst"]["name"], message["worst"]["value"]) == ("delta2", None)
    assert "not determined" in message["worst"]["text"]


def test_broken_constraints_come_first_and_their_postures_go(
    client: TestClient, content: dict[str, Any]
) -> None:
    beams = [np.ptp(posed["beam"], axis=0) for posed in checked(client, content, scene=True)["scene"]]
    lengths = sorted(float(np.linalg.norm(beam)) for beam in beams)
    content["constraints"] = {"beam_mm": [0, (lengths[3] + lengths[4]) / 2]}
    answer = checked(client, content)
    assert answer["verdict"] == "violated"
    broken = {row["posture"] for posture in answer["postures"] for row in posture["violations"]}
    assert 0 < len(broken) < 6
    assert answer["message"]["verdict"].startswith(f"Constraints violated. {len(broken)} of 7 postures")
    assert f"osture {min(broken)}" in answer["message"]["cause"]
    does = answer["action"]["does"]
    kept = [row for i, row in enumerate(content["postures_deg"]) if i not in broken]
    assert does["postures_deg"] == [pytest.approx(row, abs=1e-5) for row in kept]
    assert checked(client, content | {"postures_deg": does["postures_deg"]})["verdict"] != "violated"


def test_the_scene_has_links_marks_and_sights(client: TestClient, content: dict[str, Any]) -> None:
    content["constraints"] = {"facing": [0, 0, 1], "acceptance_deg": 80}
    answer = checked(client, content, scene=True, links=True)
    assert answer["marks"] == [
        {
            "kind": "psd",
            "name": "psd",
            "at": [900.0, 0.0, 0.0],
            "normal": [0.0, 0.0, 1.0],
            "acceptance_deg": 80.0,
        }
    ]
    for posed in answer["scene"]:
        same = client.post("/api/robot", json={"robot": "irb1600", "joints_deg": posed["joints_deg"]}).json()
        assert [pytest.approx(row, abs=1e-6) for row in same["axes"]] == posed["axes"]
        assert len(posed["links"]) == 7
        assert posed["sights"] == []
    assert "links" not in checked(client, content, scene=True)["scene"][0]
    tracked = {key: value for key, value in content.items() if key not in ("tool", "targets", "constraints")}
    tracked["instruments"] = {
        "T": {
            "kind": "tracker",
            "guess_mm": [3000, 500, 800],
            "sigma_mm": 0.05,
            "reflectors": {"R": {"guess_mm": [60, 0, 60]}},
        }
    }
    answer = checked(client, tracked, scene=True)
    assert [(row["kind"], row["name"], row["at"]) for row in answer["marks"]] == [
        ("tracker", "T", [3000.0, 500.0, 800.0])
    ]
    assert all(posed["sights"][0][1] == [3000.0, 500.0, 800.0] for posed in answer["scene"])


def test_a_result_offers_what_its_message_says(client: TestClient, root: Path, reported: Path) -> None:
    shutil.copytree(reported, root / "sub", dirs_exist_ok=True)
    for path in sorted((root / "sub").glob("*/result.json")):
        answer = client.get("/api/result", params={"file": str(path.relative_to(root))}).json()
        stated = json.loads(path.read_text())["message"]
        assert (answer["message"], answer["action"]["text"]) == (stated, stated["action"]["text"])
        if answer["action"]["does"] is not None:
            command = answer["action"]["does"]["command"]
            assert answer["run"] in " ".join(command)
            job_command(Folder(root), command)
    (root / "sub" / "good.jsonl").unlink()
    (root / "run.jsonl").unlink()  # the same run
    answer = client.get("/api/result", params={"file": "sub/good/result.json"}).json()
    assert (answer["action"]["label"], answer["action"]["does"]) == (None, None)


@pytest.mark.parametrize(
    ("typed", "label", "then"),
    [
        ("zerobeam export fanuc run.jsonl -o offsets.txt", "Export for the FANUC controller", "file"),
        ("zerobeam export robot run.jsonl -o corrected.yaml", "Export the corrected robot", "file"),
        ("zerobeam plan verify run.jsonl -o verify.yaml", "Plan a verification", "plan"),
        (
            "zerobeam plan optimal --header run.jsonl --target=1,2,3 -o plan.yaml",
            "Plan more measurements",
            "plan",
        ),
        ("zerobeam analyse run.jsonl", "Make the report", "result"),
    ],
)
def test_a_command_becomes_a_button(root: Path, typed: str, label: str, then: str) -> None:
    shutil.move(root / "run.jsonl", root / "sub")
    folder = Folder(root)
    shutil.copy(root / "plan.yaml", root / "sub" / "plan.yaml")
    run = folder.root / "sub/run.jsonl"
    offered = to_json(action_of_result(folder, Action("Do it.", typed), run, analysed=False))
    assert (offered["label"], offered["does"]["then"]) == (label, then)
    command = offered["does"]["command"]
    job_command(folder, command)
    assert any("sub/run.jsonl" in word for word in command)
    assert "sub/plan.yaml" not in command  # a name that is taken
    assert "'" not in " ".join(command)


@pytest.mark.parametrize(
    "typed", [None, "zerobeam demo", "zerobeam export robot OTHER.jsonl --force -o x.yaml"]
)
def test_what_the_app_may_not_carry_out_is_no_button(root: Path, typed: str | None) -> None:
    folder = Folder(root)
    offered = action_of_result(folder, Action("Do it.", typed), folder.root / "run.jsonl")
    assert (offered.label, offered.does) == (None, None)


@pytest.mark.parametrize(
    ("dropped", "label", "measurements"),
    [
        ("4", "Leave out measurement 4", [4]),
        ("4,7,2", "Leave out measurements 4, 7 and 2", [4, 7, 2]),
        ("run.csv:5", None, None),
        ("4 --save x.jsonl; rm", "Leave out measurement 4", [4]),  # nothing of it is carried out
    ],
)
def test_a_misfit_is_mended_on_the_page(
    root: Path, dropped: str, label: str | None, measurements: list[int] | None
) -> None:
    folder = Folder(root)
    action = Action("Do it.", f"zerobeam analyse run.jsonl --drop {dropped}")
    offered = to_json(action_of_result(folder, action, root / "run.jsonl"))
    does = None if measurements is None else {"kind": "leave_out", "measurements": measurements}
    assert (offered["label"], offered["does"]) == (label, does)


def test_what_has_not_changed_is_not_analysed_again(root: Path) -> None:
    folder = Folder(root)
    action = Action("State the noise as measured, and analyse again.", "zerobeam analyse run.jsonl")
    assert action_of_result(folder, action, root / "run.jsonl").does is None


def test_every_format_of_a_maker_is_a_job(root: Path) -> None:
    folder = Folder(root)
    for maker in makers():
        for kind in maker.offsets:
            assert job_command(folder, ["export", kind.name, "run.jsonl", "--out=x"])[1] == kind.name
        for program in maker.program:
            job_command(folder, ["export", "plan", program.name, "plan.yaml", "--out=x"])
    moc = ["export", "moc", "run.jsonl", "--out=x", "--against=plan.yaml", "--unit=rob_1"]
    assert "--against=plan.yaml" in job_command(folder, moc)
    with pytest.raises(Exception, match="not below the app's folder"):
        job_command(folder, ["export", "moc", "run.jsonl", "--out=x", "--against=../outside.yaml"])
