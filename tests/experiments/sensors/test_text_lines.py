"""Instruments that send lines: by TCP, at a serial port, into a file. What is old is refused."""

import io
import os
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import zerobeam
from live_controllers import LiveArm, TcpStandIn, UrStandIn

from zerobeam.experiments.sensors.attached import InstrumentLines, ReadingRefused, line_pattern
from zerobeam.experiments.sensors.sensors_file import LineSource, read_sensors_file
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.run import read_run

POINT = "{} {} {}"


class Source:
    """A source of lines: what is `put` is sent."""

    def __init__(self, put: Callable[[bytes], object], stated: dict[str, Any], heard: list[bytes]) -> None:
        self.put, self.stated, self.heard = put, stated, heard


def tcp() -> Iterator[Source]:
    heard: list[bytes] = []
    connections: list[socket.socket] = []

    def serve(connection: socket.socket) -> None:
        connections.append(connection)
        while True:
            heard.append(server.received(connection, 1))

    def put(content: bytes) -> None:
        while not connections:
            time.sleep(0.005)
        connections[-1].sendall(content)

    with TcpStandIn(serve) as server:
        yield Source(put, {"tcp": f"127.0.0.1:{server.port}"}, heard)


def serial() -> Iterator[Source]:
    import pty
    import tty

    near, far = pty.openpty()
    tty.setraw(far)
    device = os.ttyname(far)
    yield Source(lambda content: os.write(near, content), {"serial": {"device": device, "baud": 9600}}, [])
    os.close(near)
    os.close(far)


def file(folder: Path) -> Iterator[Source]:
    path = folder / "points.txt"

    def put(content: bytes) -> None:
        with path.open("ab") as file:
            file.write(content)

    yield Source(put, {"file": path.name}, [])


@pytest.fixture(params=["tcp", "serial", "file"])
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Source]:
    yield from {"tcp": tcp, "serial": serial, "file": lambda: file(tmp_path)}[request.param]()


def opened(source: Source, folder: Path, line: str = POINT, unit: str = "mm", **more: Any) -> InstrumentLines:
    stated = LineSource.model_validate({**source.stated, "line": line, "unit": unit, "wait_s": 0.5, **more})
    return InstrumentLines("tracker", stated, folder, [True] * line.count("{}"))


def later(*calls: Callable[[], object]) -> threading.Thread:
    """Calls after the reading has begun, one after another."""

    def run() -> None:
        for call in calls:
            time.sleep(0.15)
            call()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_only_what_begins_after_the_asking_is_read(source: Source, tmp_path: Path) -> None:
    """A line before, the half of one, its other half, and then the reading in two parts."""
    lines = opened(source, tmp_path)
    source.put(b"1 2 3\r\n4 5")
    time.sleep(0.1)
    thread = later(lambda: source.put(b"00 6\n7.5 -8e1"), lambda: source.put(b" .9\n"))
    assert lines.read() == "7.5 -80.0 0.9"
    thread.join()
    source.put(b"9 9 9\n")  # whole, and older than the next asking
    time.sleep(0.1)
    thread = later(lambda: source.put(b"1 1 1\n"))
    assert lines.read() == "1.0 1.0 1.0"
    thread.join()
    lines.close()


def test_what_is_no_reading_is_refused(source: Source, tmp_path: Path) -> None:
    lines = opened(source, tmp_path)
    with pytest.raises(ReadingRefused, match=r"tracker sent no line in 0\.5 s$"):
        lines.read()
    source.put(b"1 2 3\n")
    time.sleep(0.1)
    with pytest.raises(ReadingRefused, match=r"no line in 0\.5 s; 1 came before the joints were read"):
        lines.read()
    thread = later(lambda: source.put(b"1 2\n1 2 3 4\nbeam lost\n"))
    with pytest.raises(ReadingRefused, match='sent "beam lost", which is not the line'):
        lines.read()
    thread.join()
    lines.close()


def test_an_instrument_that_is_asked(tmp_path: Path) -> None:
    for source in tcp():
        gauge = opened(source, tmp_path, "DIM {} {*}", "in", ask="?\r")
        thread = later(lambda source=source: source.put(b"DIM +0.5000 ok\r\n"))
        assert gauge.read() == "12.7"
        thread.join()
        assert b"".join(source.heard) == b"?\r"
        gauge.close()


def test_a_source_that_is_not_there_or_goes(tmp_path: Path) -> None:
    with pytest.raises(RigFault, match="tracker cannot be opened"):
        opened(Source(lambda content: None, {"tcp": "127.0.0.1:1"}, []), tmp_path)
    for source in tcp():
        lines = opened(source, tmp_path)
        source.put(b"")
    with pytest.raises(RigFault, match="is lost"):
        lines.read()
    lines.close()


def test_a_stream_that_was_not_read_for_long_gives_its_newest_line(tmp_path: Path) -> None:
    """More waits in the queues than is read at once."""
    for source in tcp():
        lines = opened(source, tmp_path)
        source.put(b"".join(b"%d 0 0\n" % i for i in range(20_000)))
        time.sleep(0.1)
        thread = later(lambda source=source: source.put(b"99999 0 0\n"))
        assert lines.read().startswith("99999.0 ")
        thread.join()
        lines.close()


@pytest.mark.parametrize(
    ("line", "text", "numbers"),
    [
        ("{} {} {}", "1\t-2.5   3e-3", ("1", "-2.5", "3e-3")),
        ("P{*},{},{}", "P12 ok,1.0,2.0", ("1.0", "2.0")),
        ("({})", "(5)", ("5",)),
        ("{},{}", "1,2,3", None),
        ("{}", "1.2.3", None),
    ],
)
def test_patterns(line: str, text: str, numbers: tuple[str, ...] | None) -> None:
    match = line_pattern(line).fullmatch(text)
    assert (match and match.groups()) == numbers


SENSORS = """schema: zerobeam/sensors/1
instruments:
  tracker: {tcp: "127.0.0.1:%d", line: "{} {} {}", unit: m, wait_s: 2}
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("schema: zerobeam/sensors/1\n", "no sensors in this file"),
        ("schema: zerobeam/sensors/1\npsds: {}\ncamera: null\n", "no sensors in this file"),
        (SENSORS.replace('tcp: "127.0.0.1:%d", ', ""), "lines of the instrument come from is not clear"),
        (SENSORS.replace("%d", "0"), "not the address of a server"),
        (SENSORS.replace('tcp: "127.0.0.1:%d"', "file: a.txt, ask: x"), "a file cannot be asked"),
    ],
)
def test_a_sensors_file_of_instruments_is_checked(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "sensors.yaml").write_text(text)
    with pytest.raises(BadInput, match=words):
        read_sensors_file(tmp_path / "sensors.yaml")


AT = [20.0, -80.0, 70.0, -40.0, 60.0, 10.0]


@pytest.mark.long
def test_a_tracker_is_read_in_a_live_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its point comes by TCP in metres. An arm that leaves while it is read is refused, and read again."""
    (tmp_path / "plan.yaml").write_text(
        "schema: zerobeam/plan/1\nrobot: ur5e\ngeometry: exact\nnoise: {joint_deg: 0.01}\n"
        "instruments:\n  tracker:\n    kind: tracker\n    sigma_mm: 0.02\n    guess_mm: [3000, 0, 800]\n"
        f"    reflectors: {{R1: {{guess_mm: [0, 0, 60]}}}}\npostures_deg:\n  - {AT}\n"
    )
    arm = LiveArm(AT)
    sent = 0

    def serve(connection: socket.socket) -> None:
        nonlocal sent
        while True:
            time.sleep(0.1)
            connection.sendall(b"2.5 -0.25 0.125\n")
            sent += 1
            if sent == 8:  # between the joints and the reading, or at the second look
                arm.go(np.add(AT, 1.0).tolist(), 0.05)

    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * 8))
    with TcpStandIn(serve) as server, UrStandIn(arm) as controller:
        (tmp_path / "sensors.yaml").write_text(SENSORS % server.port)
        how = ["--rig", controller.url, "--sensors", tmp_path / "sensors.yaml"]
        answer = zerobeam("run", tmp_path / "plan.yaml", *how, "-o", tmp_path / "run.jsonl")
    run = read_run(tmp_path / "run.jsonl")
    (shot,) = run.shots
    assert shot.readings["measured_mm"] == (2500.0, -250.0, 125.0), answer.err
    at = AT if "moved" not in answer.err and "moves" not in answer.err else np.add(AT, 1.0)
    np.testing.assert_allclose(shot.joints_deg, at, atol=1e-6)
    assert "sensors sha256" in run.header.provenance


def test_the_file_of_the_page_is_what_is_read(tmp_path: Path) -> None:
    page = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "live.md"
    (text,) = re.findall(r"^```yaml\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (tmp_path / "sensors.yaml").write_text(text)
    sources = read_sensors_file(tmp_path / "sensors.yaml").instruments
    assert {name: line_pattern(source.line).groups for name, source in sources.items()} == {
        "tracker": 3,
        "gauge": 1,
        "bar": 1,
    }
    assert sources["gauge"].ask == "?\r"
