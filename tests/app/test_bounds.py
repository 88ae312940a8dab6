"""A server that is asked too much: it refuses, its memory stays bounded, and it answers afterwards."""

import re
import socket
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from app_page import App, app, request, root

MB = 10**6
LONGEST = 64 * MB  # of one body
MOST_KEPT = 2 * LONGEST + 100 * MB  # two uploads under way, and what a server that runs takes more
PROC = pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")

pytestmark = [pytest.mark.long, PROC]


class Server(App):
    @property
    def port(self) -> int:
        return int(root(self.address).rstrip("/").rpartition(":")[2])

    def peak(self) -> int:
        """The most memory that it has held so far, in bytes."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmHWM:\s*(\d+) kB", status)
        assert found is not None
        return int(found[1]) * 1024

    def files(self) -> set[str]:
        return {row["path"] for row in self.ask("files")}

    def answers_again(self) -> bool:
        """Whether it does within half a minute: it has to see first that somebody is gone."""
        end = time.monotonic() + 30
        while time.monotonic() < end:
            try:
                return "plan.yaml" in self.files()
            except urllib.error.HTTPError as error:
                if error.code != 503:
                    raise
                time.sleep(0.5)
        return False

    def connected(self, line: str | None = None, header: str = "") -> socket.socket:
        """A connection, on which the head of a request has been sent."""
        connection = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        if line is not None:
            token = self.address.partition("=")[2]
            ours = ["Host: localhost", "X-Zerobeam: 1", f"Authorization: Bearer {token}"]
            head = [f"{line} HTTP/1.1", *ours, *([header] if header else [])]
            connection.sendall("\r\n".join([*head, "", ""]).encode())
        return connection


@pytest.fixture
def server(root: Path) -> Iterator[Server]:
    with app(root) as opened:
        yield Server(*opened)


def answered(connection: socket.socket) -> int:
    """The status of the answer."""
    return int(connection.makefile("rb").readline().split()[1])


def test_an_upload_of_ten_gigabytes_is_refused(server: Server, root: Path) -> None:
    """Whether its length is stated (nothing is read) or not (it is cut off)."""
    before, begun = server.peak(), server.files()
    upload = "PUT /api/file?file=big.bag"
    with server.connected(upload, f"Content-Length: {10**10}") as stated:
        assert answered(stated) == 413
    block = b"f4240\r\n" + bytes(MB) + b"\r\n"
    with server.connected(upload, "Transfer-Encoding: chunked") as chunked:
        sent = 0
        with suppress(ConnectionError):  # the server hangs up
            while sent < 10**10:
                chunked.sendall(block)
                sent += MB
        assert sent < 10 * LONGEST
    assert server.files() == begun
    assert {path.name for path in root.iterdir()} == {"plan.yaml", "run.jsonl", "sub"}
    assert server.peak() - before < MOST_KEPT


def test_many_uploads_at_once_wait_for_each_other(server: Server) -> None:
    before = server.peak()

    def sent(number: int) -> int:
        body = request(server.address, f"api/file?file=log{number}.csv", bytes(60 * MB), "PUT")
        with urllib.request.urlopen(body, timeout=120) as answer:
            return int(answer.status)

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(sent, range(8))) == [201] * 8
    assert server.peak() - before < 2 * MOST_KEPT  # what was sent and its copy while it is put together
    assert {f"log{number}.csv" for number in range(8)} <= server.files()


def test_of_a_thousand_connections_each_is_answered_or_told_to_come_later(server: Server) -> None:
    before, left, told = server.peak(), 1000, set()
    for _ in range(100):
        with ExitStack() as opened:
            connections = [opened.enter_context(server.connected("GET /api/robots")) for _ in range(left)]
            statuses = [answered(connection) for connection in connections]
        told |= set(statuses)
        left -= statuses.count(200)
        if not left:
            break
    assert told == {200, 503}
    assert left == 0
    assert server.peak() - before < 100 * MB


def test_who_stays_silent_keeps_nobody_out(server: Server) -> None:
    """A thousand connections that ask nothing, or half a question, are closed after a while."""
    with ExitStack() as opened:
        for number in range(1000):
            connection = opened.enter_context(server.connected())
            if number % 2:
                connection.sendall(b"GET /api/robots HTTP/1.1\r\nHost: local")
        assert server.answers_again()


def test_who_sends_slowly_keeps_nobody_out(server: Server) -> None:
    """Hundreds of bodies that do not come to their end: requests without a body are answered."""
    before = server.peak()
    with ExitStack() as opened:
        for _ in range(300):
            sending = server.connected("POST /api/check", f"Content-Length: {4 * MB}")
            connection = opened.enter_context(sending)
            connection.settimeout(0.02)
            with suppress(TimeoutError, ConnectionError):
                connection.sendall(bytes(2 * MB))
        assert "plan.yaml" in server.files()
    assert server.peak() - before < MOST_KEPT
