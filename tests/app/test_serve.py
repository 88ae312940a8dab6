"""The app as a process of its own: it starts, answers, bears many connections, and Ctrl-C ends it."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from app_page import App, app, request, root
from command_line import zerobeam

from zerobeam.app.server.serve import listening


@pytest.fixture
def started(root: Path) -> Iterator[App]:
    with app(root) as opened:
        yield opened


def later(asked: Request) -> Any:
    """The answer to a question, asked again while the server says to come later: it has yet to notice who has
    gone."""
    until = time.monotonic() + 60
    while True:
        try:
            return urlopen(asked)
        except HTTPError as error:
            with error:
                if error.code != 503 or time.monotonic() > until:
                    raise
            time.sleep(0.05)


def test_it_answers_many_and_ends_with_ctrl_c(started: App) -> None:
    address, process = started
    port = int(root(address).removesuffix("/").rpartition(":")[2])
    with ExitStack() as opened:
        for _ in range(700):
            opened.enter_context(socket.create_connection(("127.0.0.1", port)))
        assert process.poll() is None
    with later(request(address, "api/files")) as answer:
        assert {row["path"] for row in json.load(answer)} == {"plan.yaml", "run.jsonl"}
        assert "server" not in answer.headers
    # Who has gone is not calculated for: that would take minutes.
    with urlopen(request(address, "api/plan?file=plan.yaml")) as answer:
        plan = json.load(answer)["plan"]
    long = json.dumps({"plan": plan | {"postures_deg": plan["postures_deg"] * 100}}).encode()
    token = address.partition("=")[2]
    head = (
        f"POST /api/check HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\nX-Zerobeam: 1\r\n"
        f"Content-Length: {len(long)}\r\n\r\n"
    )
    for _ in range(40):
        with socket.create_connection(("127.0.0.1", port)) as gone:
            gone.sendall(head.encode() + long)
    with urlopen(request(address, "api/plan?file=plan.yaml"), timeout=60) as answer:
        assert json.load(answer)["plan"] == plan
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (130, "stopped\n")


@pytest.mark.long
def test_ctrl_c_ends_jobs_and_those_who_follow_them(started: App) -> None:
    address, process = started
    body = json.dumps({"command": ["analyse", "run.jsonl", "--ess", "100000"]}).encode()
    with urlopen(request(address, "api/jobs", body)) as answer:
        job = json.load(answer)["id"]
    with urlopen(request(address, f"api/jobs/{job}/events")) as following:
        assert following.readline() == b"id: 1\n"  # it has begun
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)  # the job would take longer
    assert (process.returncode, err) == (130, "stopped\n")


def test_a_port_that_is_taken_and_a_folder_that_is_not_there_are_said(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = zerobeam("app", "--no-open", "--port", port, "--dir", tmp_path).refused()
    assert f"the app cannot listen at 127.0.0.1, port {port}" in said
    assert "--port 0" in said
    assert "does not exist" in zerobeam("app", "--no-open", "--dir", tmp_path / "nowhere").refused()


def test_without_the_extra_one_message_says_how_to_install_it(tmp_path: Path) -> None:
    for missing in ("starlette", "uvicorn"):
        hidden = "import sys, zerobeam.commands.app as app; find = app.find_spec\n"
        hidden += f"app.find_spec = lambda name: None if name == {missing!r} else find(name)\n"
        hidden += "from zerobeam.cli import main; main()"
        command = [sys.executable, "-c", hidden, "app", "--no-open", "--dir", str(tmp_path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert done.stderr.count("error:") == 1
        assert 'pip install "zerobeam[app]"' in done.stderr


@pytest.mark.long
def test_other_commands_load_nothing_of_it(root: Path) -> None:
    told = "import sys; from zerobeam.cli import run; sys.argv[0] = 'zerobeam'; run(); print(*sys.modules)"
    command = [sys.executable, "-c", told, "check", str(root / "plan.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    names = set(done.stdout.splitlines()[-1].split())
    assert "zerobeam.commands.judging" in names
    of_the_app = {"zerobeam.commands.app", "zerobeam.app", "zerobeam.app.server"}
    assert names & {"starlette", "uvicorn", "anyio", *of_the_app} == set()


def test_answers_do_not_wait_for_the_acknowledgement_of_their_heads() -> None:
    """asyncio turns Nagle's algorithm off for sockets that say that they are of TCP."""
    with listening("127.0.0.1", 0) as there:
        there.listen()
        with socket.create_connection(there.getsockname()), there.accept()[0] as accepted:
            assert accepted.proto == socket.IPPROTO_TCP
