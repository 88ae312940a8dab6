"""Pictures by OpenCV, from files, a video and a stream on loopback: fresh, grey, of the right size."""

import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from beside import CAMERA

from zerobeam.experiments.sensors.detectors import Camera, Image
from zerobeam.experiments.sensors.markers import Pictures, open_camera
from zerobeam.experiments.sensors.sensors_file import CameraBeside
from zerobeam.model.errors import BadInput, RigFault

cv2 = pytest.importorskip("cv2")

HEIGHT, WIDTH = 48, 64
SHEET = Camera(WIDTH, HEIGHT, (70.0, 71.0), (31.5, 23.5), (0.0,) * 5, np.eye(4))


def opened(place: Path, **source: Any) -> Pictures:
    return open_camera(CameraBeside.model_validate({**CAMERA, **source}), SHEET, place)


def scene(number: int) -> Image:
    """A picture that no other one is like."""
    return np.random.default_rng(number).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)


@pytest.fixture
def numbered(tmp_path: Path) -> Path:
    """A folder with six pictures, and a file that is none."""
    (tmp_path / "pictures").mkdir()
    for number in range(6):
        cv2.imwrite(str(tmp_path / f"pictures/shot-{number:03d}.png"), scene(number))
    (tmp_path / "pictures/notes.txt").write_text("no picture")
    return tmp_path


@pytest.mark.parametrize("source", [{"folder": "pictures"}, {"video": "pictures/shot-%03d.png"}])
@pytest.mark.parametrize("held", [0, 2])
def test_pictures_come_in_order_and_those_that_are_held_are_passed_over(
    numbered: Path, source: dict[str, Any], held: int
) -> None:
    camera = opened(numbered, **source, held_frames=held)
    for number in range(held, 6, held + 1):
        np.testing.assert_array_equal(camera.picture(), scene(number))
    for _ in range(2):  # no old picture again
        with pytest.raises(RigFault, match=r"no picture comes from .*pictures.* --resume"):
            camera.picture()
    camera.close()


def test_a_video_in_colour_becomes_grey(tmp_path: Path) -> None:
    """Three frames of even colours, 8 bits lossily coded."""
    greys = (40, 120, 200)
    writer = cv2.VideoWriter(
        str(tmp_path / "three.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (WIDTH, HEIGHT)
    )
    for grey in greys:
        writer.write(np.full((HEIGHT, WIDTH, 3), grey, dtype=np.uint8))
    writer.release()
    camera = opened(tmp_path, video="three.avi")
    for grey in greys:
        picture = camera.picture()
        assert picture.shape == (HEIGHT, WIDTH)
        assert picture.dtype == np.uint8
        assert abs(float(picture.mean()) - grey) < 2
    camera.close()


def test_the_grey_of_a_colour_is_that_of_its_light(tmp_path: Path) -> None:
    """Rec. 601: 0.299 R + 0.587 G + 0.114 B; OpenCV has them as B, G, R."""
    (tmp_path / "p").mkdir()
    cv2.imwrite(str(tmp_path / "p/0.png"), np.full((HEIGHT, WIDTH, 3), (10, 100, 200), dtype=np.uint8))
    for source in ({"folder": "p"}, {"video": "p/%d.png"}):
        camera = opened(tmp_path, **source)
        assert abs(float(camera.picture().mean()) - (0.114 * 10 + 0.587 * 100 + 0.299 * 200)) < 1
        camera.close()


@pytest.mark.parametrize("source", [{"folder": "p"}, {"video": "p/%d.png"}])
def test_a_picture_of_another_size_is_a_fault(tmp_path: Path, source: dict[str, Any]) -> None:
    (tmp_path / "p").mkdir()
    cv2.imwrite(str(tmp_path / "p/0.png"), scene(0).T.copy())
    camera = opened(tmp_path, **source)
    with pytest.raises(RigFault, match="48 by 64 pixels of uint8, by the sensors file 64 by 48"):
        camera.picture()
    camera.close()


def test_a_picture_that_is_cut_off_or_empty_is_a_fault(tmp_path: Path) -> None:
    (tmp_path / "p").mkdir()
    for name, content in (("0.png", b""), ("1.png", b"no picture")):
        (tmp_path / "p" / name).write_bytes(content)
    camera = opened(tmp_path, folder="p")
    for _ in range(2):
        with pytest.raises(RigFault, match="no picture comes"):
            camera.picture()


def test_what_is_not_there_is_told(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match="no pictures"):
        opened(tmp_path, folder="empty")
    with pytest.raises(BadInput, match="cannot be read"):
        opened(tmp_path, folder="none")
    with pytest.raises(RigFault, match=r"none.avi cannot be opened"):
        opened(tmp_path, video="none.avi")
    with pytest.raises(RigFault, match="camera 99 cannot be opened"):
        opened(tmp_path, device=99)


class _Stream(BaseHTTPRequestHandler):
    """A camera on the network: each connection has the picture of its number, again and again."""

    connections = 0

    def do_GET(self) -> None:
        grey = 30 * _Stream.connections
        _Stream.connections += 1
        picture = cv2.imencode(".jpg", np.full((HEIGHT, WIDTH), grey, dtype=np.uint8))[1].tobytes()
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
        self.end_headers()
        head = b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(picture)
        try:
            for _ in range(50):
                self.wfile.write(head + picture + b"\r\n")
        except OSError:
            pass  # it has seen enough

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def stream() -> Iterator[str]:
    _Stream.connections = 0
    with ThreadingHTTPServer(("127.0.0.1", 0), _Stream) as server:
        serving = threading.Thread(target=server.serve_forever, args=(0.02,))
        serving.start()
        yield f"http://127.0.0.1:{server.server_port}/camera.mjpg"
        server.shutdown()
        serving.join()


def test_a_stream_is_asked_anew_for_every_picture(stream: str, tmp_path: Path) -> None:
    camera = opened(tmp_path, video=stream, held_frames=1)
    # The first was taken on opening, to see whether the size is right.
    assert [round(float(camera.picture().mean())) for _ in range(3)] == [30, 60, 90]
    camera.close()


def test_a_streams_password_is_in_no_message(
    stream: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    url = stream.replace("http://", "http://me:geheim@")
    wrong_size = {"video": url, "width_px": 65}
    stated = CameraBeside.model_validate({**CAMERA, **wrong_size})
    sheet = Camera(65, HEIGHT, (70.0, 71.0), (31.5, 23.5), (0.0,) * 5, np.eye(4))
    for source, why in ((url, "65 by 48"), (url.replace("http:", "nothing:"), "cannot be opened")):
        with pytest.raises(RigFault, match=why) as fault:
            open_camera(stated.model_copy(update={"video": source}), sheet, tmp_path)
        assert "geheim" not in str(fault.value)
    told = capfd.readouterr()
    assert told.out + told.err == ""


def test_without_the_extra_there_is_one_message(monkeypatch: pytest.MonkeyPatch, numbered: Path) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(BadInput, match=r'pip install "zerobeam\[camera\]"'):
        opened(numbered, folder="pictures")
