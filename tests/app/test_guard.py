"""Who may ask what of the app: no other site, no other folder, nothing without end."""

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from zerobeam.app.server import guard
from zerobeam.app.server.guard import Access
from zerobeam.app.server.index import Folder
from zerobeam.app.server.requests import EndPoint
from zerobeam.app.server.serve import application


def test_messages_do_not_say_where_the_folder_is(client: TestClient, root: Path) -> None:
    answer = client.get("/api/plan", params={"file": "sub/nowhere.yaml"})
    assert answer.json()["error"]["what"] == "sub/nowhere.yaml: there is no such file"
    assert str(root) not in answer.text


@pytest.mark.parametrize(
    "path",
    ["/page/../server/guard.py", "/page/%2e%2e/server/guard.py", "/page//etc/passwd", "/page/", "/page/x"],
)
def test_of_the_page_only_its_own_files_are_sent(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:8800", 200),
        ("localhost", 200),
        ("[::1]:8800", 200),
        ("evil.example", 403),
        ("evil.example:8800", 403),
        ("localhost.evil.example", 403),
        ("127.0.0.1.evil.example:8800", 403),
        ("192.168.0.7:8800", 403),
        ("", 403),
    ],
)
def test_another_host_is_refused(client: TestClient, host: str, status: int) -> None:
    assert client.get("/api/files", headers={"host": host}).status_code == status


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"origin": "http://127.0.0.1:8800"}, 200),
        ({"origin": "http://127.0.0.1:9999"}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"x-zerobeam": "0"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
    ],
)
def test_a_post_of_another_site_is_refused(client: TestClient, headers: dict[str, str], status: int) -> None:
    assert client.post("/api/robot", json={"robot": "ur5e"}, headers=headers).status_code == status


def test_every_end_point_that_is_no_get_needs_the_header(root: Path) -> None:
    app = application(Folder(root), Access())
    with TestClient(app, base_url="http://localhost") as client:
        for route in app.routes:
            for method in set(getattr(route, "methods", ())) - {"GET", "HEAD"}:
                path = getattr(route, "path", "").replace("{id}", "1")
                assert client.request(method, path, json={}).status_code == 403, (method, path)


@pytest.mark.parametrize("path", ["/", "/page/x", "/api/robots", "/api/nothing", "/../x"])
def test_every_answer_has_the_headers(client: TestClient, path: str) -> None:
    headers = client.get(path).headers
    assert headers["content-security-policy"].startswith("default-src 'self';")
    assert "unsafe" not in headers["content-security-policy"]
    assert "frame-ancestors 'self'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in headers


def test_a_body_that_states_to_be_large_is_refused_unread(client: TestClient) -> None:
    answer = client.post("/api/check", headers={"content-length": str(10**10)}, content=b"{}")
    assert answer.status_code == 413


def test_a_body_without_end_is_cut_off(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    sent = 0

    def body() -> Iterator[bytes]:
        nonlocal sent
        while sent < 2000:
            sent += 1
            yield b" " * 10_000

    answer = client.post("/api/check", content=body())
    assert answer.status_code == 400
    assert "too large" in answer.json()["error"]["what"]
    monkeypatch.setattr(guard, "LARGEST_BODY", 10**6)
    sent = 0
    assert client.post("/api/check", content=body()).status_code == 413


def test_script_in_a_name_comes_back_as_text(client: TestClient, root: Path) -> None:
    name = "<script>alert(1)<script>.yaml"
    os.rename(root / "plan.yaml", root / name)
    for answer in (
        client.get("/api/files"),
        client.get("/api/plan", params={"file": "<script>"}),
        client.post("/api/robot", json={"robot": "<script>"}),
    ):
        assert answer.headers["content-type"] == "application/json"
        assert "<script>" in answer.text
    assert client.get("/api/plan", params={"file": name}).status_code == 200


def test_a_fault_of_ours_says_nothing_of_itself(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: Folder) -> None:
        raise RuntimeError("swordfish")

    monkeypatch.setattr("zerobeam.app.server.routes.END_POINTS", [EndPoint("/api/robots", "GET", "", broken)])
    app = application(Folder(root), Access(token="open-sesame"))
    with TestClient(app, base_url="http://localhost", raise_server_exceptions=False) as client:
        answer = client.get("/api/robots", headers={"authorization": "Bearer open-sesame"})
    assert answer.status_code == 500
    assert "swordfish" not in answer.text
    assert answer.json()["error"]["what"] == "this is a fault of zerobeam itself"
    assert "swordfish" in capsys.readouterr().err


def test_end_points_that_cannot_be_loaded_are_a_fault_and_the_page_is_there(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fault() -> None:
        app, ours = application(Folder(root), Access(token="t")), {"authorization": "Bearer t"}
        with TestClient(app, "http://localhost", raise_server_exceptions=False, headers=ours) as client:
            assert client.get("/api/robots").json()["error"]["what"] == "this is a fault of zerobeam itself"
            assert client.get("/").status_code == 200

    monkeypatch.setitem(sys.modules, "zerobeam.app.server.routes", None)
    with pytest.raises(ImportError):  # at the end, too
        fault()
    assert "zerobeam.app.server.routes" in capsys.readouterr().err


def test_the_head_names_every_module_that_is_loaded_at_first_and_no_other(client: TestClient) -> None:
    named = set(re.findall(r'rel="modulepreload" href="/page/([^"]+)"', client.get("/").text))
    assert {"App.js", "core/api.js", "vendor/preact/preact.js", "vendor/signals/core.js"} <= named
    assert not any(name.startswith(("plan/", "scene/", "vendor/three/")) for name in named)


def test_the_page_and_its_files_are_sent(client: TestClient) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    names = re.findall(r'(?:src|href)="(?:/page/|page/)([^"]+)"', page.text)
    assert names
    for name in [*names, "fonts/IBMPlexSans-Regular.woff2"]:
        answer = client.get(f"/page/{name}")
        assert answer.status_code == 200, name
        assert answer.content


def test_the_import_map_alone_is_let_in_by_its_hash(client: TestClient) -> None:
    import base64
    import hashlib

    from zerobeam.app.server.guard import page_policy

    inline = b'{"imports": {"preact": "/page/vendor/preact/preact.js"}}'
    page = b'<script type="importmap">%s</script><script>alert(1)</script>' % inline
    digest = base64.b64encode(hashlib.sha256(inline).digest()).decode()
    assert f"script-src 'self' 'sha256-{digest}';" in page_policy(page)
    assert page_policy(page).count("sha256-") == 1
    assert "unsafe" not in client.get("/").headers["content-security-policy"]


def test_page_files_are_kept_by_their_etag(client: TestClient) -> None:
    first = client.get("/page/vendor/preact/preact.js")
    assert first.status_code == 200
    again = client.get("/page/vendor/preact/preact.js", headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    licence = client.get("/page/vendor/preact/LICENSE.txt")
    assert licence.headers["content-type"].startswith("text/plain")
    assert client.get("/page/vendor/packages.json").status_code == 200
