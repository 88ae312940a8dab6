"""What the page is told is what the commands print."""

import html
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import pattern_plan
from command_line import plan_file
from ruamel.yaml import YAML
from starlette.testclient import TestClient

from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import built_in_robots, load_robot

BLOCKED = Path(__file__).parents[1] / "support" / "beam_through_arm.yaml"


def test_the_robots_are_those_that_are_built_in(client: TestClient) -> None:
    found = client.get("/api/robots").json()
    assert [row["name"] for row in found] == list(built_in_robots())
    assert {"name": "ur5e", "vendor": "universal-robots", "model": "UR5e"} in found


def test_a_robot_is_what_the_command_prints(client: TestClient, printed: Callable[..., Any]) -> None:
    joints = [10, -20.5, 30, 5, 40, 0]
    answer = client.post("/api/robot", json={"robot": "ur5e", "joints_deg": joints}).json()
    same = printed("robot", "ur5e", "--joints", ", ".join(map(str, joints)), "--json")
    assert {key: answer[key] for key in same} == same
    assert answer["notes"] == []
    arm = load_robot("ur5e")
    assert len(answer["skeleton"]) == arm.n + 2
    np.testing.assert_allclose(answer["skeleton"][-1], arm.fk(joints, "deg")[:3, 3], atol=1e-3)
    # A turn about an axis moves the flange by axis x (flange - origin): the Jacobian's columns.
    points, axes = np.array(answer["skeleton"]), np.array(answer["axes"])
    turned = np.cross(axes, points[-1] - points[1:-1])
    np.testing.assert_allclose(turned, arm.jacobian(joints, "deg")[:3].T, atol=1e-2)


def test_joint_3_may_be_counted_from_the_ground(client: TestClient, printed: Callable[..., Any]) -> None:
    wanted = {"robot": "lrmate_200id", "joints_deg": [0, 30, 0, 0, 0, 0], "j3": "ground"}
    answer = client.post("/api/robot", json=wanted).json()
    same = printed("robot", wanted["robot"], "--joints", "0,30,0,0,0,0", "--j3", "ground", "--json")
    assert answer["poses"] == same["poses"]


def test_a_check_is_what_the_command_prints(
    client: TestClient, content: dict[str, Any], root: Path, printed: Callable[..., Any]
) -> None:
    answer = client.post("/api/check", json={"plan": content, "file": "plan.yaml"}).json()
    same = printed("check", root / "plan.yaml", "--json")
    sha256 = answer["inputs"].pop("sha256"), same["inputs"].pop("sha256")
    assert all(len(each) == 64 for each in sha256)
    assert {key: answer[key] for key in same} == same


def test_the_scene_has_arm_beam_and_target_of_each_posture(
    client: TestClient, content: dict[str, Any]
) -> None:
    answer = client.post("/api/check", json={"plan": content, "scene": True}).json()
    assert len(answer["scene"]) == 7
    arm = load_robot("irb1600")
    for posed in answer["scene"]:
        assert posed["reaches"]
        np.testing.assert_allclose(
            posed["skeleton"][-1], arm.fk(posed["joints_deg"], "deg")[:3, 3], atol=2e-3
        )
        np.testing.assert_allclose(posed["beam"][1], posed["target"], atol=1e-2)
        assert posed["target_name"] == "psd"
    assert len(answer["null_motion"]) == len(answer["identifiability"]["null_space"])


def test_along_the_null_motion_the_beam_stays_on_the_target(client: TestClient, root: Path) -> None:
    plan_file(root / "x.yaml", pattern_plan("x", aside=0.0))
    content = client.get("/api/plan", params={"file": "x.yaml"}).json()["plan"]
    answer = client.post("/api/check", json={"plan": content, "scene": True}).json()
    assert answer["verdict"] == "degenerate"
    exact = [way for way in answer["null_motion"] if way["kind"] == "exact"]
    assert len(exact) == len([d for d in answer["identifiability"]["null_space"] if d["kind"] == "exact"]) > 0
    tool = content["tool"]
    arm = load_robot("irb1600")
    for way in exact:
        assert set(way["others"]) <= {"psd.x", "psd.y", "psd.z"}
        step = 1e-3 / max(map(abs, way["joints_deg"]))  # the largest turn is a thousandth of a degree
        moved = np.array([way["others"].get(f"psd.{axis}", 0.0) for axis in "xyz"]) * step
        misses = []
        for posed in answer["scene"]:
            joints = np.array(posed["joints_deg"])
            for along, at in ((0.0, 0.0), (step, moved)):
                pose = arm.fk(joints + along * np.array(way["joints_deg"]), "deg")
                origin = pose[:3, :3] @ np.array(tool["point_mm"]) + pose[:3, 3]
                line = pose[:3, :3] @ np.array(tool["direction"])
                aside = np.cross(line, np.array(posed["target"]) + at - origin)
                misses.append(np.linalg.norm(aside) / np.linalg.norm(line))
        assert max(misses) < 2e-3, misses  # mm; coordinates of the scene are rounded to 0.001 mm


def test_a_plan_is_read_and_written_back(client: TestClient, content: dict[str, Any], root: Path) -> None:
    before = read_plan(root / "plan.yaml")
    content["postures_deg"][0][0] += 1.5
    content["postures_deg"][1] = {
        "joints_deg": content["postures_deg"][1],
        "target": "psd",
        "via_deg": [[0, 0, 0, 0, 10, 0]],
    }
    for file in ("plan.yaml", "sub/new.yaml"):
        now = client.get("/api/file", params={"file": file}).headers.get("etag")
        headers = {} if now is None else {"if-match": now}
        answer = client.put("/api/plan", json={"file": file, "plan": content}, headers=headers)
        assert (answer.status_code, answer.json()["file"]) == (200, file)
        after = read_plan(root / file)
        turned = np.degrees(after.postures - before.postures)
        assert turned[0, 0] == pytest.approx(1.5)
        np.testing.assert_allclose(np.delete(turned.ravel(), 0), 0, atol=1e-8)
        np.testing.assert_allclose(after.via_of(1) * after.robot.display, [[0, 0, 0, 0, 10, 0]], atol=1e-8)
        assert len(after.via_of(2)) == 0
    assert client.get("/api/plan", params={"file": "sub/new.yaml"}).json()["targets"] == ["psd"] * 7


@pytest.mark.parametrize("kind", ["plan", "obstacles"])
def test_nothing_but_a_file_of_its_kind_is_replaced(
    client: TestClient, content: dict[str, Any], root: Path, kind: str
) -> None:
    (root / "header.yaml").write_text("schema: zerobeam/robot/1\n")
    (root / "cell.yaml").write_text("schema: zerobeam/obstacles/1\n")
    whole = {"plan": content, "obstacles": {"floor_mm": 0.0, "boxes": [], "thickness_mm": None}}
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    other = {"plan": "cell.yaml", "obstacles": "plan.yaml"}[kind]
    for file in (other, "run.jsonl", "header.yaml", "page.html", "sub"):
        answer = client.put(f"/api/{kind}", json={"file": file, kind: whole[kind]})
        assert answer.status_code == 400, file
        assert answer.json()["error"]["what"]
    empty = {"name": "a", "min_mm": [0, 0, 0], "max_mm": [1, 1, 0]}
    wrong: Any = {"plan": content | {"postures_deg": []}, "obstacles": {"boxes": [empty]}}[kind]
    error = client.put(f"/api/{kind}", json={"file": f"{kind}.yaml", kind: wrong}).json()["error"]
    assert error["key"][: 3 if kind == "obstacles" else 2] == {
        "plan": ["plan", "postures_deg"], "obstacles": ["obstacles", "boxes", 0]
    }[kind]  # fmt: skip
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == before


def test_files_are_told_with_their_kind(client: TestClient, root: Path) -> None:
    header = {"robot": "ur5e", "tool": {"kind": "laser"}, "noise": {"joint_deg": 0.01}}
    with (root / "sub" / "header.yaml").open("w") as file:
        YAML().dump(header, file)
    (root / "sub" / "arm.yaml").write_text("schema: zerobeam/robot/1\n")
    (root / "result.json").write_text('{\n "schema": "zerobeam/result/1"}')
    (root / "note.txt").write_text("robot: tool: noise:")
    (root / ".hidden.yaml").touch()
    kinds = {row["path"]: row["kind"] for row in client.get("/api/files").json()}
    assert kinds == {
        "plan.yaml": "plan",
        "run.jsonl": "run",
        "sub/header.yaml": "header",
        "sub/arm.yaml": "robot",
        "result.json": "result",
        "note.txt": "other",
    }


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"postures_deg": [[0, 0, 0, 0, 10, 0], [1, 2]]}, ["plan", "postures_deg", 1]),
        ({"noise": {"joint_deg": -1, "spot_mm": 0.1}}, ["plan", "noise", "joint_deg"]),
        ({"robot": "irb1601"}, ["plan", "robot"]),
        ({"tolerence": 1}, ["plan", "tolerence"]),
        ({"schema": "zerobeam/run/1"}, ["plan", "schema"]),
    ],
)
def test_a_refusal_names_the_key(
    client: TestClient, content: dict[str, Any], change: dict[str, Any], key: list[Any]
) -> None:
    answer = client.post("/api/check", json={"plan": content | change})
    error = answer.json()["error"]
    assert (answer.status_code, error["key"]) == (400, key)
    assert set(error) == {"what", "found", "allowed", "to_do", "key"}
    assert "line" not in error["what"]


@pytest.mark.parametrize(
    ("path", "sent", "said"),
    [
        ("robot", {"robot": "ur5e", "joints_deg": [1, "2"]}, "item 2 of joints_deg is not a number"),
        ("robot", {"robot": "ur5e", "joints_deg": [1, 2]}, "another number of joints"),
        ("robot", {"robot": "ur55"}, "no robot of this name"),
        ("robot", {"robot": "ur5e", "j4": 1}, "unknown key 'j4'"),
        ("robot", [1], "the content is not"),
        ("check", {}, "the key 'plan' is missing"),
        ("check", {"plan": {"postures_deg": [[0]] * 1001}}, "too long"),
    ],
)
def test_what_cannot_be_used_is_refused_in_words(client: TestClient, path: str, sent: Any, said: str) -> None:
    answer = client.post(f"/api/{path}", json=sent)
    assert answer.status_code == 400
    assert said in answer.json()["error"]["what"]


@pytest.mark.parametrize(
    "text",
    [
        b"{",
        b'{"robot": NaN}',
        b'{"a": 1, "a": 2}',
        b"\xff",
        b"[" * 100_000,
        b"[" * 60 + b"]" * 60,
        b"[" + b"1," * 200_000 + b"1]",
        b'{"robot": "\\ud800"}',
        b'{"\\ud800": 1}',
        b"",
    ],
)
def test_what_is_no_json_is_refused(client: TestClient, text: bytes) -> None:
    answer = client.post("/api/robot", content=text)
    assert answer.status_code == 400
    assert answer.json()["error"]["what"]


def test_what_each_posture_adds_is_a_check_of_the_others(client: TestClient, content: dict[str, Any]) -> None:
    asked = {"plan": content, "postures": [0, 3]}
    found = client.post("/api/without", json=asked).json()
    assert [row["posture"] for row in found] == [0, 3]
    for row in found:
        rest = [own for i, own in enumerate(content["postures_deg"]) if i != row["posture"]]
        same = client.post("/api/check", json={"plan": content | {"postures_deg": rest}}).json()
        assert row["rest"]["verdict"] == same["verdict"]
        for own in same["parameters"]:
            if own["group"] == "offset":
                assert row["rest"]["status"][own["name"]] == own["status"]
                std = row["rest"]["std"][own["name"]]
                assert (std is None) == (own["std"] is None)
                # Where the plan states no target, a check takes it from its postures.
                assert std is None or std == pytest.approx(own["std"], rel=1e-6)


def test_without_the_one_posture_that_turns_joint_1_joint_2_has_no_number(
    client: TestClient, root: Path
) -> None:
    plan_file(root / "x.yaml", pattern_plan("x"))
    content = client.get("/api/plan", params={"file": "x.yaml"}).json()["plan"]
    turned = [*content["postures_deg"][0]]
    content["postures_deg"].append([turned[0] + 20, *turned[1:]])
    last = len(content["postures_deg"]) - 1
    whole = client.post("/api/check", json={"plan": content}).json()
    u2 = next(row for row in whole["parameters"] if row["name"] == "delta2")
    assert u2["std"] is not None
    (row,) = client.post("/api/without", json={"plan": content, "postures": [last]}).json()
    assert row["rest"]["status"]["delta2"] == "unidentifiable"
    assert row["rest"]["std"]["delta2"] is None
    assert row["rest"]["verdict"] == "degenerate"


def test_what_the_command_says_besides_is_said_to_the_page(
    client: TestClient, content: dict[str, Any], root: Path
) -> None:
    from command_line import zerobeam

    content["postures_deg"] = np.degrees(pattern_plan("x").postures).tolist()
    assert client.put("/api/plan", json={"file": "noisy.yaml", "plan": content}).status_code == 200
    said = client.post("/api/check", json={"plan": content, "scene": True}).json()["said"]
    printed = " ".join(zerobeam("check", root / "noisy.yaml", "--full").out.split())
    shown = " ".join(html.unescape(re.sub("<[^>]*>", " ", said["predicted"])).split())
    open_ones = list(filter(None, said["directions"]))
    assert open_ones
    for text in (one[key] for one in open_ones for key in ("combination", "reason", "remedy")):
        assert " ".join(text.split()) in printed
    assert "unidentifiable from these measurements" in shown


def test_obstacles_are_written_read_and_what_touches_them_is_said(
    client: TestClient, content: dict[str, Any], root: Path
) -> None:
    scene = client.post("/api/check", json={"plan": content, "scene": True}).json()["scene"]
    middle = np.mean([scene[2]["tool"], scene[2]["target"]], axis=0)
    box = {"name": "<b>", "min_mm": list(middle - 10), "max_mm": list(middle + 10)}
    cell = {"floor_mm": None, "boxes": [box], "thickness_mm": 1.0}
    checked = client.post("/api/check", json={"plan": content, "scene": True, "obstacles": cell}).json()
    assert "beam" in checked["scene"][2]["touches"]
    far = cell | {"boxes": [box | {"min_mm": [5000, 5000, 5000], "max_mm": [5100, 5100, 5100]}]}
    checked = client.post("/api/check", json={"plan": content, "scene": True, "obstacles": far}).json()
    assert [place["touches"] for place in checked["scene"]] == [[]] * 7
    high = far | {"floor_mm": 5000.0}
    checked = client.post("/api/check", json={"plan": content, "scene": True, "obstacles": high}).json()
    assert [place["touches"] for place in checked["scene"]] == [["cell"]] * 7

    headers: dict[str, str] = {}
    for _ in range(2):  # the second time over its own
        answer = client.put("/api/obstacles", json={"file": "cell.yaml", "obstacles": cell}, headers=headers)
        assert (answer.status_code, answer.json()["file"]) == (200, "cell.yaml")
        headers = {"if-match": answer.headers["etag"]}
    assert client.get("/api/obstacles", params={"file": "cell.yaml"}).json()["obstacles"] == cell
    kinds = {row["path"]: row["kind"] for row in client.get("/api/files").json()}
    assert kinds["cell.yaml"] == "obstacles"


def test_constraints_are_judged_on_each_edit_and_kept(
    client: TestClient, content: dict[str, Any], root: Path
) -> None:
    content["constraints"] = {"facing": [0, 0, 1], "acceptance_deg": 89, "beam_mm": [0, 3000]}
    checked = client.post("/api/check", json={"plan": content, "scene": True}).json()
    assert checked["verdict"] == "weak"
    assert [own["violations"] for own in checked["postures"]] == [[]] * 7
    content["targets"]["psd"]["guess_mm"] = [900, 0, 1400]  # above the arm, where its face looks away
    checked = client.post("/api/check", json={"plan": content, "scene": True}).json()
    assert checked["verdict"] == "violated"
    broken = [each for own in checked["postures"] for each in own["violations"]]
    behind = [each["posture"] for each in broken if each["at"] > 90]
    assert behind
    for i in behind:
        assert "from behind" in " ".join(checked["scene"][i]["violations"])
    assert client.put("/api/plan", json={"file": "held.yaml", "plan": content}).status_code == 200
    assert client.get("/api/plan?file=held.yaml").json()["plan"]["constraints"] == content["constraints"]
    content["constraints"] = {"beam_mm": [300, 200]}
    refused = client.post("/api/check", json={"plan": content})
    assert refused.json()["error"]["key"] == ["plan", "constraints", "beam_mm"]


def test_a_beam_that_the_arm_blocks_is_answered_with_the_link(client: TestClient) -> None:
    """Also where a box stands elsewhere: it is not the box that is touched."""
    content = YAML(typ="safe").load(BLOCKED.read_text(encoding="utf-8"))
    far = {"boxes": [{"name": "far", "min_mm": [5000, 0, 0], "max_mm": [5100, 100, 100]}]}
    asked = {"plan": content, "scene": True, "obstacles": far}
    checked = client.post("/api/check", json=asked).json()
    assert checked["verdict"] == "violated"
    broken = {i: place["violations"] for i, place in enumerate(checked["scene"]) if place["violations"]}
    assert [*broken] == [3, 10, 18] == [i for i, place in enumerate(checked["scene"]) if place["blocked"]]
    assert all("of the arm is in the way" in words[0] for words in broken.values())
    assert checked["touched_boxes"] == [False]
    kept = checked["action"]["does"]["postures_deg"]
    assert len(kept) == 16
    content["postures_deg"] = kept
    assert client.post("/api/check", json={"plan": content}).json()["verdict"] == "pass"
