"""Files into the folder and out of it: new ones only, below it only, shown where they can do nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from starlette.testclient import TestClient


def test_a_file_is_written_and_comes_back_as_it_was(client: TestClient, root: Path) -> None:
    content = bytes(range(256))
    answer = client.put("/api/file", params={"file": "sub/log.csv"}, content=content)
    assert (answer.status_code, answer.json()) == (201, {"file": "sub/log.csv", "bytes": 256})
    assert (root / "sub/log.csv").read_bytes() == content
    back = client.get("/api/file", params={"file": "sub/log.csv"})
    assert back.content == content
    assert "attachment" in back.headers["content-disposition"]


NOT_NEW = ["plan.yaml", "../outside.yaml", ".bashrc", "sub/.x/y", "none/log.csv", "", "sub"]


@pytest.mark.parametrize("name", NOT_NEW)
def test_nothing_is_replaced_or_written_elsewhere(client: TestClient, root: Path, name: str) -> None:
    before = {path: path.read_bytes() for path in root.parent.rglob("*") if path.is_file()}
    answer = client.put("/api/file", params={"file": name}, content=b"x")
    assert answer.status_code == 400
    assert answer.json()["error"]["what"]
    assert {path: path.read_bytes() for path in root.parent.rglob("*") if path.is_file()} == before


def test_what_is_hidden_or_elsewhere_is_not_sent(client: TestClient, root: Path) -> None:
    (root / ".secret").write_text("swordfish")
    (root / "link.html").symlink_to(root.parent / "outside.yaml")
    for name in (".secret", "link.html", "../outside.yaml", "sub", "none"):
        for address in (f"/api/file?file={name}", f"/report/{name}"):
            answer = client.get(address)
            assert answer.status_code in (400, 404)
            assert "swordfish" not in answer.text


def test_a_page_of_the_folder_is_shown_alone(client: TestClient, root: Path) -> None:
    """No same origin, no connection: what a report's name or a foreign page's script does stays within it."""
    (root / "page.html").write_text("<script>fetch('/api/files')</script>")
    policy = client.get("/report/page.html").headers["content-security-policy"]
    assert "sandbox allow-scripts;" in policy
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy
    assert "allow-same-origin" not in policy
    assert "sandbox" not in client.get("/").headers["content-security-policy"]
