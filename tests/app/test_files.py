"""Files into the folder and out of it: new ones only, below it only, shown where they can do nothing."""

from pathlib import Path

import pytest
from starlette.testclient import TestClient


def test_a_file_is_written_and_comes_back_as_it_was(client: TestClient, root: Path) -> None:
    content = bytes(range(256))
    answer = client.put("/api/file", params={"file": "sub/log.csv"}, content=content)
    assert answer.status_code == 201
    assert (answer.json()["file"], answer.json()["bytes"]) == ("sub/log.csv", 256)
    assert (root / "sub/log.csv").read_bytes() == content
    back = client.get("/api/file", params={"file": "sub/log.csv"})
    assert back.content == content
    assert "attachment" in back.headers["content-disposition"]


def test_a_file_of_a_new_folder_makes_it(client: TestClient, root: Path) -> None:
    """As of a controller's backup, which is sent file by file."""
    answer = client.put("/api/file", params={"file": "Cell 7/TASK1/A.mod"}, content=b"MODULE A")
    assert answer.status_code == 201
    assert (root / "Cell 7/TASK1/A.mod").read_bytes() == b"MODULE A"
    refused = client.put("/api/file", params={"file": "run.jsonl/A.mod"}, content=b"MODULE A")
    assert refused.status_code in (400, 422)


@pytest.mark.parametrize("name", ["run.jsonl", "none/log.csv", "sub"])
def test_nothing_is_replaced(client: TestClient, root: Path, name: str) -> None:
    before = {path: path.read_bytes() for path in root.parent.rglob("*") if path.is_file()}
    answer = client.put("/api/file", params={"file": name}, content=b"x", headers={"if-match": "*"})
    assert answer.status_code == (412 if name == "none/log.csv" else 400)
    assert answer.json()["error"]["what"]
    assert {path: path.read_bytes() for path in root.parent.rglob("*") if path.is_file()} == before


def test_a_page_of_the_folder_is_shown_alone(client: TestClient, root: Path) -> None:
    """No same origin, no connection: what a report's name or a foreign page's script does stays within it."""
    (root / "page.html").write_text("<script>fetch('/api/files')</script>")
    policy = client.get("/report/page.html").headers["content-security-policy"]
    assert "sandbox allow-scripts;" in policy
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy
    assert "allow-same-origin" not in policy
    assert "sandbox" not in client.get("/").headers["content-security-policy"]
