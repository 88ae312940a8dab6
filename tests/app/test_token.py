"""Without the token nobody is answered: another account of this machine reaches the server too."""

import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from app_page import app, root
from child import ZEROBEAM, child
from starlette.testclient import TestClient

from zerobeam.app.server.guard import Access
from zerobeam.app.server.index import Folder
from zerobeam.app.server.serve import application, leading_to
from zerobeam.model.errors import BadInput

TOKEN = "open-sesame"
WRONG = [
    {},
    {"cookie": "zerobeam-8800=wrong"},
    {"cookie": f"zerobeam-8801={TOKEN}"},  # of another port
    {"cookie": f"zerobeam-token={TOKEN}"},
    {"authorization": f"Bearer {TOKEN}x"},
    {"authorization": f"Basic {TOKEN}"},
    {"authorization": TOKEN},
]


@pytest.fixture(params=["127.0.0.1", "0.0.0.0"], ids=["loopback", "host"])
def stranger(root: Path, request: pytest.FixtureRequest) -> Iterator[TestClient]:
    """Who reaches the server and has no token; the header that pages send costs nothing."""
    base = "http://127.0.0.1:8800" if request.param == "127.0.0.1" else "http://192.168.0.7:8800"
    served = application(Folder(root), Access(request.param, TOKEN))
    with TestClient(served, base_url=base, headers={"X-Zerobeam": "1"}, follow_redirects=False) as client:
        yield client


def _routes(client: TestClient) -> list[tuple[str, str]]:
    served: Any = client.app
    client.get("/api/files", headers={"authorization": f"Bearer {TOKEN}"})  # answered once all are loaded
    return [
        (
            method,
            re.sub(r"\{path:path\}", "plan.yaml", route.path).replace("{id}", "1").replace("{ticket}", "x"),
        )
        for route in served.routes
        for method in sorted(route.methods)
    ]


def test_a_person_without_the_token_reads_how_to_get_in(stranger: TestClient) -> None:
    for path in ("/", "/report/plan.yaml"):
        answer = stranger.get(path, headers={"accept": "text/html,*/*;q=0.8", "cookie": "zerobeam-8800=old"})
        assert answer.status_code == 401
        assert answer.headers["content-type"].startswith("text/html")
        assert "Open the address that the terminal shows" in answer.text
        assert "script" not in answer.headers["content-security-policy"]
        assert TOKEN not in answer.text
    assert "error" in stranger.get("/").json()  # to a program


@pytest.mark.parametrize("headers", WRONG, ids=map(str, WRONG))
@pytest.mark.one_in(3)
def test_every_route_is_closed(stranger: TestClient, root: Path, headers: dict[str, str]) -> None:
    (root / "page.html").write_text("swordfish")
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    routes = [*_routes(stranger), ("GET", "/page/main.js"), ("GET", "/shown/x/page.html"), ("GET", "/none")]
    assert len(routes) > 40
    for method, path in routes:
        queries = ["", "?file=plan.yaml", f"?file=new.yaml&token={TOKEN}"]
        for query in queries[: 1 if headers else 2 if (method, path) == ("GET", "/") else 3]:
            body = None if method in ("GET", "HEAD") else b'{"command": ["analyse", "run.jsonl"]}'
            answer = stranger.request(method, f"{path}{query}", content=body, headers=headers)
            assert answer.status_code in (401, 403), (method, path, query)
            assert "set-cookie" not in answer.headers
            assert "swordfish" not in answer.text
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == before


def test_the_address_opens_the_page_and_leaves_a_cookie(stranger: TestClient) -> None:
    assert stranger.get("/?token=wrong").status_code == 401
    assert stranger.get(f"/api/robots?token={TOKEN}").status_code == 401
    assert stranger.post(f"/?token={TOKEN}").status_code == 401
    page = stranger.get(f"/?token={TOKEN}")
    assert page.status_code == 200
    assert TOKEN not in page.text
    (cookie,) = page.headers.get_list("set-cookie")
    assert cookie == f"zerobeam-8800={TOKEN}; HttpOnly; Path=/; SameSite=Strict"
    assert stranger.get("/api/files").status_code == 200  # by the cookie, which the client keeps
    assert stranger.get("/").status_code == 200
    assert stranger.get("/page/main.js").status_code == 200
    assert stranger.get("/api/files", headers={"host": "evil.example"}).status_code == 403
    both = {"cookie": f"zerobeam-8800=of an earlier server; zerobeam-8800={TOKEN}"}
    assert stranger.get("/api/files", headers=both).status_code == 200


def test_the_cookie_is_of_the_port_that_the_browser_asks(stranger: TestClient) -> None:
    """Not that of the server: two servers behind two tunnels have two cookies."""
    for port, host in ((9001, "localhost:9001"), (80, "localhost")):
        answer = stranger.get(f"/?token={TOKEN}", headers={"host": host})
        assert answer.headers["set-cookie"].startswith(f"zerobeam-{port}=")


def test_each_server_has_its_token_and_says_it_nowhere() -> None:
    tokens = {Access().token for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 32
    assert "sesame" not in repr(Access(token=TOKEN))


def test_a_page_of_the_folder_is_shown_by_a_ticket(client: TestClient, root: Path) -> None:
    """Its links have no cookie; they lead to what is beside and below it, and nowhere else."""
    for name in (
        "history/fleet.html",
        "history/arms/a b/arm.html",
        "history/fleet.csv",
        "other/x.html",
        "top.html",
    ):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)
    (root / "history" / "way").symlink_to(root / "other")
    way = client.get("/report/history/fleet.html", follow_redirects=False)
    assert (way.status_code, way.text) == (303, "")
    start = way.headers["location"].removesuffix("fleet.html")
    assert start.startswith("/shown/")
    stranger = TestClient(client.app, base_url="http://127.0.0.1:8800")
    for name in ("fleet.html", "arms/a%20b/arm.html", "fleet.csv"):
        assert stranger.get(f"{start}{name}").status_code == 200, name
    assert "sandbox allow-scripts;" in stranger.get(f"{start}fleet.html").headers["content-security-policy"]
    for name in (
        "%2e%2e/other/x.html",
        "%2e%2e/top.html",
        "%2e%2e/plan.yaml",
        "way/x.html",
        "../../api/files",
    ):
        answer = stranger.get(f"{start}{name}")
        assert answer.status_code in (400, 401, 403), name
        assert "html" not in answer.text
    ticket = start.split("/")[2]
    for name in ("top.html", "other/x.html", "plan.yaml", "historyx/y.html"):
        assert stranger.get(f"/shown/{ticket}/{name}").status_code in (400, 403), name
    top = client.get("/report/top.html", follow_redirects=False).headers["location"]
    assert stranger.get(top).status_code == 200
    assert (
        stranger.get(top.replace("top.html", "plan.yaml")).status_code == 403
    )  # the whole folder is not beside it
    with TestClient(application(Folder(root), Access()), base_url="http://127.0.0.1:8800") as other:
        assert other.get(f"{start}fleet.html").status_code == 403  # of another server


ASKING = """
import sys, urllib.error, urllib.request
asked = [("GET", ""), ("GET", "api/files"), ("GET", "page/app.js")]
asked += [("PUT", "api/file?file=x"), ("POST", "api/jobs")]
for method, path in asked:
    body = None if method == "GET" else b'{"command": ["run"]}'
    request = urllib.request.Request(sys.argv[1] + path, body, {"X-Zerobeam": "1"}, method=method)
    try:
        urllib.request.urlopen(request)
        print("open", path)
    except urllib.error.HTTPError as error:
        print(error.code)
"""


def test_a_real_server_is_closed_to_who_has_no_token(tmp_path: Path) -> None:
    """A process of its own asks, of which the server knows no more than of one of another account."""
    with app(tmp_path) as server:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", server.address)
        words = [sys.executable, "-I", "-c", ASKING, root(server.address)]
        done = subprocess.run(words, capture_output=True, text=True, check=True, env={})
        assert done.stdout.split() == ["401"] * 5
        assert list(tmp_path.iterdir()) == []
        assert server.ask("files") == []


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="no command line has the address there")
@pytest.mark.long
def test_the_browser_is_opened_without_the_token_in_its_command_line(tmp_path: Path) -> None:
    """Every account of a machine can read the command lines of all; this user alone reads the file."""
    (tmp_path / "dir").mkdir()
    browser, said = tmp_path / "browser", tmp_path / "said"
    browser.write_text(f'#!/bin/sh\necho "$@" > {said}.part; mv {said}.part {said}\n')
    browser.chmod(0o700)
    command = [*ZEROBEAM, "app", "--port", "0", "--dir", str(tmp_path / "dir")]
    with child(command, env=os.environ | {"BROWSER": f"{browser} %s"}, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        address = process.stdout.readline().removeprefix("The app: ").strip()
        while not said.exists():
            assert process.poll() is None
            time.sleep(0.02)
        opened = said.read_text().strip()
        assert opened.startswith("file://")
        file = Path(unquote(urlsplit(opened).path))
        assert f'url={address}"' in file.read_text()
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
        assert not file.exists()
    shutil.rmtree(tmp_path / "dir" / ".zerobeam")
    (tmp_path / "dir" / ".zerobeam").symlink_to(tmp_path)
    with pytest.raises(BadInput, match="not below"):
        leading_to(tmp_path / "dir", address)
