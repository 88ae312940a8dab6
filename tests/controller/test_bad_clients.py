"""Clients that send what is none of the protocol, or go away: an error or nothing, and the server goes on."""

import re
import socket
import struct
import time
from collections.abc import Iterator

import numpy as np
import pytest
from abb_controller.service import SimulatedController
from controllers import Client, controller

from zerobeam.experiments.sensors.detectors import RemoteSensors

DIGEST = (
    'GET /x HTTP/1.1\r\nAuthorization: Digest username="Default User", realm="validusers@robapi.abb",'
    ' uri="/x", qop="auth", nc=00000001, cnonce="y", nonce="{nonce}", response="{response}"\r\n\r\n'
)


@pytest.fixture
def there(capfd: pytest.CaptureFixture[str]) -> Iterator[SimulatedController]:
    """A controller that still answers at the end, and has said nothing of all that."""
    with controller() as simulated:
        yield simulated
        client, sensors = Client(simulated.url), RemoteSensors("127.0.0.1", simulated.sensor_port)
        assert client.get_operation_mode() == "AUTO"
        assert sensors.currents("psd", 3).shape == (3, 4)
        client.close()
        sensors.close()
    assert capfd.readouterr() == ("", "")


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=10)


def answer(port: int, sent: bytes) -> bytes:
    """All that comes back."""
    with connected(port) as line:
        line.sendall(sent)
        line.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: line.recv(65536), b""))


def status(answered: bytes) -> int:
    return int(answered.split(maxsplit=2)[1])


def gone(port: int, sent: bytes, after_s: float = 0.0) -> None:
    """A client that asks, and resets the connection."""
    with connected(port) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        line.sendall(sent)
        time.sleep(after_s)


def test_a_digest_that_is_not_ascii_is_no_password(there: SimulatedController) -> None:
    challenge = answer(there.port, b"GET /x HTTP/1.1\r\n\r\n").decode()
    (nonce,) = re.findall(r'nonce="(\w+)"', challenge)
    for response in ("é" * 32, "0" * 32):
        sent = DIGEST.format(nonce=nonce, response=response).encode("latin-1")
        assert status(answer(there.port, sent)) == 401


@pytest.mark.parametrize(
    ("sent", "expected"),
    [
        (b"GET http://[ HTTP/1.1\r\n\r\n", 400),
        (b"BREW / HTTP/1.1\r\n\r\n", 501),
        (b"GET /" + b"x" * 70_000 + b" HTTP/1.1\r\n\r\n", 414),
        (b"GET / HTTP/1.1\r\nCookie: \xff\xfe=;;=\x01\r\nContent-Length: -5\r\n\r\n", 401),
    ],
)
def test_what_is_no_request_is_an_error(there: SimulatedController, sent: bytes, expected: int) -> None:
    assert status(answer(there.port, sent)) == expected


@pytest.mark.parametrize(
    "sent",
    [
        *(b"[" * 900, b'{"ask":' * 140, b"[" * 5000, b"\xff\xfe", b'"sheets"', b"null", b"{}"),
        b'{"ask": []}',
        b'{"ask": "currents", "target": 7, "samples": 3}',
        b'{"ask": "currents", "target": {}, "samples": 1e99}',
    ],
)
def test_what_is_no_question_to_the_sensors_is_an_error(there: SimulatedController, sent: bytes) -> None:
    assert answer(there.sensor_port, sent + b"\n").startswith(b'{"error": ')


def test_clients_that_go_away(there: SimulatedController) -> None:
    for _ in range(3):
        gone(there.port, b"GET /rw/panel/opmode HT")
        gone(there.port, b"POST /x HTTP/1.1\r\nContent-Length: 100\r\n\r\nabc")
        gone(there.sensor_port, b'{"ask": "currents", "target": "psd", "samples": 100}\n')
        gone(there.sensor_port, b'{"ask": "im')
    gone(there.sensor_port, b'{"ask": "image", "target": "psd"}\n' * 20, 0.3)


def test_noise(there: SimulatedController) -> None:
    draws = np.random.default_rng(1)
    for size in draws.integers(1, 3000, size=20):
        for port in (there.port, there.sensor_port):
            gone(port, draws.bytes(int(size)), 0.01)
            answer(port, draws.bytes(int(size)))
