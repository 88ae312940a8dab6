"""Who replaces a file says which version it was made from: no work of another one is lost."""

import hashlib
import os
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

GOOD_HEADER: dict[str, Any] = {
    "robot": "ur5e",
    "tool": {"kind": "laser", "point_mm": [0, 0, 60], "direction": [0, 0, 1]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.1},
}
Kinds = dict[str, tuple[str, dict[str, Any], dict[str, Any]]]
BOXES: dict[str, Any] = {"floor_mm": 0.0, "boxes": [], "thickness_mm": None}


@pytest.fixture
def kinds(client: TestClient, content: dict[str, Any]) -> Kinds:
    """By end point: a file that is there, what is sent to write it, and the same with another content."""
    client.put("/api/obstacles", json={"file": "cell.yaml", "obstacles": BOXES})
    client.put("/api/header", json={"file": "header.yaml", "header": GOOD_HEADER})
    turned = content | {"postures_deg": content["postures_deg"][:-1]}
    return {
        "plan": ("plan.yaml", {"plan": content}, {"plan": turned}),
        "obstacles": ("cell.yaml", {"obstacles": BOXES}, {"obstacles": BOXES | {"floor_mm": -5.0}}),
        "header": (
            "header.yaml",
            {"header": GOOD_HEADER},
            {"header": GOOD_HEADER | {"noise": {"joint_deg": 0.02, "spot_mm": 0.1}}},
        ),
    }


@pytest.mark.parametrize("kind", ["plan", "obstacles", "header"])
def test_a_file_is_replaced_by_its_version_alone(
    client: TestClient, root: Path, kinds: Kinds, kind: str
) -> None:
    file, sent, other = kinds[kind]
    read = client.get(f"/api/{kind}", params={"file": file})
    version = read.json()["version"]
    assert read.headers["etag"] == f'"{version}"'
    assert hashlib.sha256((root / file).read_bytes()).hexdigest().startswith(version)
    before = (root / file).read_bytes()
    for headers in (
        {},
        {"if-match": '"0000"'},
        {"if-none-match": "*"},
        {"if-match": read.headers["etag"], "if-none-match": "*"},
    ):
        answer = client.put(f"/api/{kind}", json={"file": file} | other, headers=headers)
        assert answer.status_code == 412, headers
        assert answer.json()["error"]["what"]
        assert answer.json()["current"] == {"version": version, "content": read.json()}
        assert (root / file).read_bytes() == before
    answer = client.put(f"/api/{kind}", json={"file": file} | other, headers={"if-match": f'"{version}"'})
    assert answer.status_code == 200
    after = answer.json()["version"]
    assert (answer.headers["etag"], after != version) == (f'"{after}"', True)
    assert client.get(f"/api/{kind}", params={"file": file}).json()["version"] == after
    late = client.put(f"/api/{kind}", json={"file": file} | sent, headers={"if-match": f'"{version}"'})
    assert (late.status_code, late.json()["current"]["version"]) == (412, after)


@pytest.mark.parametrize("kind", ["plan", "obstacles", "header"])
@pytest.mark.long
def test_a_file_that_was_deleted_is_not_made_again_unasked(
    client: TestClient, root: Path, kinds: Kinds, kind: str
) -> None:
    file, sent, _ = kinds[kind]
    version = client.get(f"/api/{kind}", params={"file": file}).headers["etag"]
    (root / file).unlink()
    answer = client.put(f"/api/{kind}", json={"file": file} | sent, headers={"if-match": version})
    assert (answer.status_code, answer.json()["current"]) == (412, None)
    assert not (root / file).exists()
    answer = client.put(f"/api/{kind}", json={"file": file} | sent, headers={"if-none-match": "*"})
    assert answer.status_code == 200


def test_a_broken_file_is_shown_as_such(client: TestClient, root: Path, content: dict[str, Any]) -> None:
    """Somebody's editor has saved half of it meanwhile."""
    version = client.get("/api/plan", params={"file": "plan.yaml"}).headers["etag"]
    (root / "plan.yaml").write_text("schema: zerobeam/plan/1\nrobot: none\n")
    answer = client.put(
        "/api/plan", json={"file": "plan.yaml", "plan": content}, headers={"if-match": version}
    )
    assert answer.status_code == 412
    current = answer.json()["current"]
    assert (current["content"], current["version"] != version.strip('"')) == (None, True)


@pytest.mark.parametrize("kind", ["plan", "obstacles", "header"])
def test_a_file_that_is_read_only_is_not_replaced(
    client: TestClient, root: Path, kinds: Kinds, kind: str
) -> None:
    """By its mode, whoever runs the server: its folder would allow to replace it."""
    file, _, other = kinds[kind]
    version = client.get(f"/api/{kind}", params={"file": file}).headers["etag"]
    before = (root / file).read_bytes()
    (root / file).chmod(0o444)
    answer = client.put(f"/api/{kind}", json={"file": file} | other, headers={"if-match": version})
    assert (answer.status_code, (root / file).read_bytes()) == (400, before)
    assert answer.json()["error"]["what"].endswith("the file is read-only")
    assert sorted(root.glob(".*.part")) == []
    (root / file).chmod(0o644)
    answer = client.put(f"/api/{kind}", json={"file": file} | other, headers={"if-match": version})
    assert answer.status_code == 200


@pytest.mark.parametrize("kind", ["plan", "obstacles", "header"])
def test_a_folder_in_place_of_a_file_is_a_refusal(
    client: TestClient, root: Path, kinds: Kinds, kind: str
) -> None:
    file, _, other = kinds[kind]
    version = client.get(f"/api/{kind}", params={"file": file}).headers["etag"]
    (root / file).unlink()
    (root / file).mkdir()
    for headers in ({"if-match": version}, {"if-none-match": "*"}):
        answer = client.put(f"/api/{kind}", json={"file": file} | other, headers=headers)
        assert answer.status_code == 400, headers
        what = answer.json()["error"]["what"]
        assert what == "something else has this name" or "folder" in what
    assert (root / file).is_dir()


def test_a_linked_file_has_the_version_of_what_is_there(
    client: TestClient, root: Path, content: dict[str, Any]
) -> None:
    (root / "link.yaml").symlink_to("plan.yaml")
    read = client.get("/api/plan", params={"file": "link.yaml"})
    assert read.json()["file"] == "plan.yaml"
    content["postures_deg"].pop()
    answer = client.put(
        "/api/plan",
        json={"file": "link.yaml", "plan": content},
        headers={"if-match": read.headers["etag"]},
    )
    assert (answer.status_code, answer.json()["file"]) == (200, "plan.yaml")
    assert (root / "link.yaml").is_symlink()


def test_a_file_is_replaced_as_it_is_sent(client: TestClient, root: Path) -> None:
    (root / "sensors.yaml").write_text("a: 1\n")
    read = client.get("/api/file", params={"file": "sensors.yaml"})
    put = {"params": {"file": "sensors.yaml"}, "content": b"a: 2\n"}
    taken = client.put("/api/file", **put)
    assert taken.status_code == 412
    assert taken.json()["current"] == {"version": read.headers["etag"].strip('"'), "content": "a: 1\n"}
    answer = client.put("/api/file", **put, headers={"if-match": read.headers["etag"]})
    assert answer.status_code == 200
    assert (root / "sensors.yaml").read_text() == "a: 2\n"
    again = client.get(
        "/api/file",
        params={"file": "sensors.yaml"},
        headers={"if-none-match": f'"{answer.json()["version"]}"'},
    )
    assert (again.status_code, again.content) == (304, b"")
    (root / "sensors.yaml").write_bytes(b"\xff\x00")
    taken = client.put("/api/file", **put)
    assert (taken.status_code, taken.json()["current"]["content"]) == (412, None)


@pytest.mark.parametrize("file", ["run.jsonl", "result.json"])
def test_what_was_measured_is_never_replaced(client: TestClient, root: Path, file: str) -> None:
    (root / "result.json").write_text('{\n "schema": "zerobeam/result/1"}')
    before = (root / file).read_bytes()
    version = client.get("/api/file", params={"file": file}).headers["etag"]
    for headers in ({}, {"if-match": version}, {"if-match": "*"}):
        answer = client.put("/api/file", params={"file": file}, content=b"x", headers=headers)
        assert answer.status_code == 400
        assert "exists already" in answer.json()["error"]["what"]
    assert (root / file).read_bytes() == before


def test_the_list_of_files_is_sent_where_it_has_changed(client: TestClient, root: Path) -> None:
    first = client.get("/api/files")
    versions = {row["path"]: row["version"] for row in first.json()}
    assert versions["plan.yaml"] == client.get("/api/plan?file=plan.yaml").json()["version"]
    assert versions["run.jsonl"] == client.get("/api/file?file=run.jsonl").headers["etag"].strip('"')
    same = client.get("/api/files", headers={"if-none-match": first.headers["etag"]})
    assert (same.status_code, same.content, same.headers["etag"]) == (304, b"", first.headers["etag"])
    text, facts = (root / "plan.yaml").read_text(), (root / "plan.yaml").stat()
    (root / "plan.yaml").write_text(text.replace("0.05", "0.06", 1))  # as long, and at the same time
    os.utime(root / "plan.yaml", ns=(facts.st_atime_ns, facts.st_mtime_ns))
    other = client.get("/api/files", headers={"if-none-match": first.headers["etag"]})
    assert other.status_code == 200
    assert {row["path"] for row in other.json() if row["version"] != versions[row["path"]]} == {"plan.yaml"}


def test_what_another_one_writes_meanwhile_is_kept(
    client: TestClient, root: Path, content: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new name that is taken between the look at it and the writing: a conflict, and nothing is lost."""
    from zerobeam.app.server.answers import plans

    real = plans.write_plan

    def late(path: Path, *of: Any, **how: Any) -> None:
        path.write_text("somebody: else\n")
        real(path, *of, **how)

    monkeypatch.setattr(plans, "write_plan", late)
    answer = client.put("/api/plan", json={"file": "new.yaml", "plan": content})
    assert answer.status_code == 412
    assert (root / "new.yaml").read_text() == "somebody: else\n"


def test_versions_are_described(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    for path in ("/api/plan", "/api/obstacles", "/api/header", "/api/file"):
        described = paths[path]["put"]
        assert "If-Match" in [row["name"] for row in described["parameters"]]
        ref = described["responses"]["412"]["content"]["application/json"]["schema"]["$ref"]
        assert ref.endswith("ConflictAnswer")
