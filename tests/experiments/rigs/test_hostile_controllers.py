"""Controllers that never end what they send, or send more than a reading needs: one error, bounded memory.

Nothing here asserts a time: a reading that does not end fails by the test's own limit.
"""

import base64
import hashlib
import json
import socket
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest
from live_controllers import STAND_INS, Closed, TcpStandIn, robot_of

from zerobeam.experiments.rigs import transport
from zerobeam.experiments.rigs.at_rest import open_joints
from zerobeam.experiments.rigs.joint_clients import JointsRefused, WebSocket
from zerobeam.experiments.rigs.transport import LARGEST, BoundedSocket, LinkFault, Stream
from zerobeam.model.errors import RigFault
from zerobeam.model.kinematics.pendant import pendant_of

MB = 1 << 20
Serve = Callable[[socket.socket], None]


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "ANSWER_S", 0.15)


@pytest.fixture
def patient(impatient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what ends by its size, or by itself, however busy the machine is."""
    monkeypatch.setattr(transport, "ANSWER_S", 30.0)


@contextmanager
def bounded_memory() -> Iterator[None]:
    """At most what a reading may have, twice over: as bytes and as what is made of them."""
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 3 * LARGEST, f"{peak / MB:.0f} MB"


class Hostile(TcpStandIn):
    """Sends `content` again and again, after what it says first to who connects."""

    def __init__(self, content: bytes, pause: float = 0.0, first: Serve = lambda connection: None) -> None:
        self.content, self.pause, self.first = content, pause, first
        super().__init__(self.flood)

    def flood(self, connection: socket.socket) -> None:
        self.first(connection)
        connection.settimeout(0.05)
        rest = b""
        while not self._over.wait(self.pause):
            rest = rest or self.content
            with suppress(TimeoutError):
                rest = rest[connection.send(rest) :]


def opening(connection: socket.socket) -> None:
    """The opening handshake of a bridge."""
    lines = b""
    while not lines.endswith(b"\r\n\r\n"):
        if not (part := connection.recv(4096)):
            raise Closed
        lines += part
    at = lines.lower().index(b"sec-websocket-key:") + len(b"sec-websocket-key:")
    key = lines[at:].split(b"\r\n")[0].strip()
    accept = base64.b64encode(hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest())
    connection.sendall(
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
    )


def greeted(connection: socket.socket) -> None:
    """The answers of RTDE up to the start of data."""
    for content in (b"V\x01", b"O\x01DOUBLE,VECTOR6D"):
        connection.recv(4096)
        connection.sendall((2 + len(content)).to_bytes(2, "big") + content)


def frame(first: int, content: bytes) -> bytes:
    size = len(content)
    if size < 126:
        return bytes([first, size]) + content
    return bytes([first, 127]) + size.to_bytes(8, "big") + content


def other(text: str) -> bytes:
    return frame(0x81, json.dumps({"op": "publish", "topic": "/other", "msg": text}).encode())


FLOODS: dict[str, tuple[str, bytes, float, Serve]] = {
    "ros: endless pings": ("ros", frame(0x89, b"x"), 0.0, opening),
    "ros: pings now and then": ("ros", frame(0x89, b"x"), 0.05, opening),
    "ros: pings too large": ("ros", frame(0x89, bytes(70_000)), 0.0, opening),
    "ros: empty frames": ("ros", frame(0x01, b"") + frame(0x00, b""), 0.0, opening),
    "ros: a message that never ends": ("ros", frame(0x01, b"x" * 100), 0.0, opening),
    "ros: frames of 2 MB": ("ros", frame(0x01, b"x" * 2 * MB), 0.0, opening),
    "ros: a frame of 4 TB": ("ros", bytes([0x81, 127]) + (1 << 42).to_bytes(8, "big"), 0.0, opening),
    "ros: other topics": ("ros", other("x"), 0.0, opening),
    "ros: endless headers": ("ros", b"HTTP/1.1 101\r\n" + b"x: y\r\n" * 1000, 0.0, lambda _: None),
    "ros: a header that drips": ("ros", b"H", 0.05, lambda _: None),
    "ur: text packages": ("ur", (60_003).to_bytes(2, "big") + b"M" + b"x" * 60_000, 0.0, greeted),
    "ur: empty text packages": ("ur", b"\0\3M", 0.0, greeted),
    "ur: text packages now and then": ("ur", b"\0\3M", 0.05, greeted),
    "ur: drip": ("ur", b"\0", 0.05, lambda _: None),
    "fanuc: other packets": ("fanuc", b'{"Communication": "FRC_SystemFault"}\r\n', 0.0, lambda _: None),
    "fanuc: large packets": ("fanuc", b'{"x": "' + b"y" * 900_000 + b'"}\r\n', 0.0, lambda _: None),
    "fanuc: packets now and then": ("fanuc", b'{"x": 1}\r\n', 0.05, lambda _: None),
    "fanuc: a line without an end": ("fanuc", b"x" * 1000, 0.0, lambda _: None),
    "kuka: drip": ("kuka", b"\0", 0.05, lambda _: None),
}


@pytest.mark.parametrize(("scheme", "content", "pause", "first"), FLOODS.values(), ids=FLOODS)
@pytest.mark.one_in(4)
def test_what_never_ends_is_one_error(scheme: str, content: bytes, pause: float, first: Serve) -> None:
    with Hostile(content, pause, first) as server, bounded_memory():
        url, pendant = f"{scheme}://127.0.0.1:{server.port}", pendant_of(robot_of(scheme))
        with pytest.raises((RigFault, JointsRefused), match="look at the connection"):
            open_joints(url, pendant).take()


def test_answers_to_other_requests_that_never_end_are_one_error() -> None:
    """By UDP: what is no answer to this request is passed over, within the one deadline."""
    other_answer = b"YERC\x20\x00\x00\x00\x03\x01\x01\xff\0\0\0\x80" + b"9" * 8 + b"\xf5" + bytes(7)
    over = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server, bounded_memory():
        server.bind(("127.0.0.1", 0))
        server.settimeout(10.0)
        url, pendant = f"yaskawa://127.0.0.1:{server.getsockname()[1]}", pendant_of(robot_of("yaskawa"))

        def flood() -> None:
            _, client = server.recvfrom(100)
            while not over.wait(0.01):
                server.sendto(other_answer, client)

        thread = threading.Thread(target=flood, daemon=True)
        thread.start()
        with pytest.raises((RigFault, JointsRefused), match="look at the connection"):
            open_joints(url, pendant).take()
        over.set()
        thread.join()


@pytest.mark.one_in(3)
@pytest.mark.parametrize("content", [frame(0x8A, b"none"), frame(0x01, b""), other("x")])
def test_draining_ends(content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bridge that sends for ever, and never the answer to the ping."""
    monkeypatch.setattr(transport, "ANSWER_S", 1.0)  # longer than a busy machine lets it be silent
    with Hostile(content, 0.0, opening) as server:
        bridge = WebSocket("127.0.0.1", server.port)
        with pytest.raises(LinkFault, match=r"MB for one reading|does not come to an end"):
            bridge.drain()
        bridge.close()


@pytest.mark.usefixtures("patient")
def test_large_frames_are_joined_once() -> None:
    """Just within the limit: a message of many frames is read whole."""
    parts = [frame(0x01, b"a" * 1000), *(frame(0x00, b"b" * 1000) for _ in range(2000)), frame(0x80, b"c")]
    with Hostile(b"".join(parts), 0.01, opening) as server, bounded_memory():
        bridge = WebSocket("127.0.0.1", server.port)
        message = bridge.message()
        bridge.close()
    assert (len(message), message[0], message[-1]) == (2_001_001, "a", "c")


@pytest.mark.usefixtures("patient")
def test_each_reading_has_its_own_limit() -> None:
    """Readings one after the other may be many: only one of them is limited."""
    with Hostile(b"x" * 100_000) as server:
        stream = Stream("127.0.0.1", server.port)
        for _ in range(3):
            stream.begin()
            assert len(stream.exactly(LARGEST // 2)) == LARGEST // 2
        stream.begin()
        with pytest.raises(LinkFault, match="more than 4 MB"):
            stream.exactly(2 * LARGEST)
        stream.close()


def test_silence_is_a_time_out() -> None:
    with TcpStandIn(server_waits) as server:
        connected = socket.create_connection(("127.0.0.1", server.port))
        reading = BoundedSocket(connected, "it", LinkFault, 0.05)
        with pytest.raises(TimeoutError):
            reading.recv(1)
        reading.close()


def test_a_silence_at_the_end_of_a_reading_is_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not "does not answer" of who has answered all the time."""
    clock = iter([0.0, 0.14, 0.16])  # the reading begins; 0.01 s are left; it has ended
    with TcpStandIn(server_waits) as server:
        connected = socket.create_connection(("127.0.0.1", server.port))
        monkeypatch.setattr(transport, "monotonic", lambda: next(clock))
        reading = BoundedSocket(connected, "it", LinkFault, 0.05)
        with pytest.raises(LinkFault, match=r"it does not come to an end within 0\.15 s"):
            reading.recv(1)
        monkeypatch.undo()
        reading.close()


def server_waits(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.settimeout(2.0)
        connection.recv(1)


@pytest.mark.usefixtures("patient")
def test_the_stand_ins_are_read_as_before() -> None:
    """The control: the same clients read what ends."""
    from live_controllers import LiveArm

    for scheme in ("ur", "ros", "fanuc"):
        kind = STAND_INS[scheme]
        with kind(LiveArm([10.0] * robot_of(scheme).n)) as server:
            joints = open_joints(server.url, pendant_of(robot_of(scheme)))
            assert abs(joints.take()[0] - 10.0) < 1e-6
            joints.close()


def http(first: bytes, then: bytes, pause: float = 0.0) -> Hostile:
    def answered(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(first)

    return Hostile(then, pause, answered)


OK = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
ANSWERS = {
    "endless body": (OK + b"\r\n", b"x" * 100_000, 0.0),
    "body that drips": (OK + b"\r\n", b"x", 0.05),
    "endless chunks": (OK + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n", 0.0),
    "chunks now and then": (OK + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n", 0.05),
    "a large body": (OK + b"Content-Length: 99999999999\r\n\r\n", b"x" * 100_000, 0.0),
    "headers that drip": (OK + b"x: ", b"y", 0.05),
    "endless headers": (OK, b"x: y\r\n", 0.0),
    "continue for ever": (b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.0),
    "a refusal without an end": (b"HTTP/1.1 400 Bad\r\n\r\n", b"x" * 100_000, 0.0),
    "packed": (OK + b"Content-Encoding: gzip\r\nContent-Length: 10\r\n\r\n", b"x" * 10, 0.0),
}


@pytest.mark.parametrize(("first", "then", "pause"), ANSWERS.values(), ids=ANSWERS)
@pytest.mark.one_in(3)
def test_http_of_a_controller_ends(
    first: bytes, then: bytes, pause: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("abb_robot_client")
    from zerobeam.experiments.rigs.abb import rws_client
    from zerobeam.experiments.rigs.abb.rws_client import ControllerAccess, Secret

    monkeypatch.setattr(rws_client, "ANSWER_S", 0.15)
    monkeypatch.setattr(rws_client, "_BUSY_S", ())
    with http(first, then, pause) as server, bounded_memory():
        access = ControllerAccess("127.0.0.1", server.port, "user", Secret("secret"))
        session = rws_client.RwsSession(access)
        with pytest.raises(RigFault, match="joints"):
            session.ask("joints", lambda rws: rws.get_jointtarget())
        session._rws._session.close()
