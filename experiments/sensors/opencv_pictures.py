"""Pictures by OpenCV: of a camera of this computer, of a stream, or of files that simulate one."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...model.errors import BadInput, RigFault, missing_extra
from ...model.parsing.confinement import confining_folder, require_within
from ...model.parsing.reading import require_regular
from .camera import Camera, Image
from .sensors_file import CameraBeside

_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff"}
_NETWORK = re.compile(r"(https?|rtsps?|rtmps?|rtp|srt|udp|tcp)://")  # other URLs may lead to files
_ANSWER_MS = 5000
_NOTHING: tuple[bool, Any] = (False, None)


class Capture(Protocol):
    """The part of OpenCV's VideoCapture that is used."""

    def grab(self) -> bool:
        """Take the next frame."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """That frame, decoded: (height, width) or (height, width, 3) BGR, uint8."""
        ...

    def release(self) -> None:
        """Close it."""
        ...


class Pictures:
    """Pictures of a source that `opened` opens, as grey values; RigFault where no frame comes.

    For every picture `held` frames are passed over: they may be older than the asking. `anew`: it is opened
    for every picture, since a stream that is not read piles up frames without end.
    """

    def __init__(
        self, called: str, opened: Callable[[], Capture], held: int, sheet: Camera, *, anew: bool = False
    ) -> None:
        self._cv2 = _opencv()
        self._called, self._opened, self._held, self._sheet = called, opened, held, sheet
        self._kept = None if anew else opened()

    def picture(self) -> Image:
        """(height, width) of the camera's data sheet."""
        capture = self._kept or self._opened()
        try:
            grabbed = all(capture.grab() for _ in range(self._held + 1))
            came, frame = capture.retrieve() if grabbed else _NOTHING
        finally:
            if capture is not self._kept:
                capture.release()
        if not came:
            raise RigFault(
                f"no picture comes from {self._called}: look at the camera and its cable, then go on "
                "with --resume"
            )
        if frame.shape[:2] != (self._sheet.height, self._sheet.width) or frame.dtype != np.uint8:
            raise RigFault(
                f"the pictures of {self._called} have {frame.shape[1]} by {frame.shape[0]} pixels of "
                f"{frame.dtype}, by the sensors file {self._sheet.width} by {self._sheet.height} of uint8: "
                "focal length, centre and distortion hold for that size only"
            )
        return np.asarray(frame if frame.ndim == 2 else self._cv2.cvtColor(frame, self._cv2.COLOR_BGR2GRAY))

    def close(self) -> None:
        if self._kept is not None:
            self._kept.release()


class _Folder:
    """The pictures of a folder in the order of their names."""

    def __init__(self, folder: Path) -> None:
        try:
            files = sorted(file for file in folder.iterdir() if file.suffix.lower() in _SUFFIXES)
        except OSError as error:
            raise BadInput(f"the folder of pictures cannot be read: {error.strerror}", file=folder) from None
        if not files:
            raise BadInput("the folder has no pictures", allowed=", ".join(sorted(_SUFFIXES)), file=folder)
        for file in files:
            require_regular(file)
        self._files: Iterator[Path] = iter(files)
        self._file: Path | None = None

    def grab(self) -> bool:
        self._file = next(self._files, None)
        return self._file is not None

    def retrieve(self) -> tuple[bool, Any]:
        assert self._file is not None
        cv2 = _opencv()
        # As the sensor has it: not turned by what the file says of the camera's attitude.
        how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        content = np.frombuffer(self._file.read_bytes(), dtype=np.uint8)
        picture = cv2.imdecode(content, how) if content.size else None
        return picture is not None, picture

    def release(self) -> None:
        pass


def open_camera(settings: CameraBeside, sheet: Camera, folder: Path) -> Pictures:
    """The camera of a sensors file, whose paths are relative to `folder`; RigFault where it does not open.

    A camera is asked for a picture at once, so that a wrong size is known before anything
    moves; files would be one picture short after that.
    """
    if settings.folder is not None:
        pictures = folder / settings.folder
        require_within(pictures)
        return Pictures(f"the folder {pictures}", lambda: _Folder(pictures), settings.held_frames, sheet)
    stream = settings.video is not None and "://" in settings.video
    source = (
        settings.device
        if settings.video is None
        else settings.video
        if stream
        else str(folder / settings.video)
    )
    if settings.video is not None and not stream:
        require_within(folder / settings.video)
    elif settings.video is not None and confining_folder() is not None and not _NETWORK.match(settings.video):
        raise BadInput("this is no stream that the app opens", found=settings.video, allowed=_NETWORK.pattern)
    # A URL may hold a password: it is in no message.
    called = (
        "the camera's stream" if stream else f"the video {source}" if settings.video else f"camera {source}"
    )
    camera = Pictures(
        called, lambda: _capture(source, called, sheet), settings.held_frames, sheet, anew=stream
    )
    if stream or settings.device is not None:
        try:
            camera.picture()
        except BaseException:
            camera.close()
            raise
    return camera


def _capture(source: str | int | None, called: str, sheet: Camera) -> Capture:
    cv2 = _opencv()
    if isinstance(source, str) and "://" in source:
        waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _ANSWER_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _ANSWER_MS]
        capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, waits)
    else:
        if isinstance(source, str) and Path(source).exists():
            require_regular(Path(source))
        capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        capture.release()
        raise RigFault(f"{called} cannot be opened: is it there, does another program have it?")
    if isinstance(source, int):
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, sheet.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, sheet.height)
    return capture  # type: ignore[no-any-return]


def _opencv() -> Any:
    # What it and FFmpeg would print, URLs with their passwords too, is said in messages.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ImportError:
        raise missing_extra("a camera", "camera") from None
    silence = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel  # OpenCV 4, 5
    silence(0)
    return cv2
