"""Lights in a picture: bright blobs, the two LEDs that mark a PSD, the laser's spot near them; and pictures
by OpenCV."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.errors import BadInput, RigFault, missing_extra
from ...model.parsing.confinement import confining_folder, require_within
from ...model.parsing.reading import require_regular
from .detectors import Camera, Image
from .sensors_file import CameraBeside

# A pixel is lit where it is so many standard deviations above the background: one pixel of noise in 10⁹,
# and three of them side by side never. The standard deviation is that of normal noise with the same median
# and 95 % quantile: lights may fill a twentieth of the picture, and noise that is cut off below, at black,
# does not look smaller than it is (its median absolute deviation does).
_FACTOR = 6.0
_QUANTILES = (0.5, 0.95)
_NORMAL = 1.645
# Pixels: a hot one has no neighbours, and a window, a lamp or a hand is no marker.
_SMALLEST = 3
_LARGEST_SHARE = 0.02
# A blob is taken to reach so many of its standard deviations (5e-4 of a Gaussian is outside); the ring of so
# many pixels around that is its local background. No lens makes a blob that is narrower, px.
_REACH = 3.5
_RING = 2
_NARROWEST = 0.8
# The centroid has converged when it moves less, px: after three steps or so, and more where a blob is
# saturated.
_STANDS = 1e-4
_STEPS = 50
_FULL = 255
# A covered lens gives no more than this, grey values.
_BLACK = 2.0
# Two markers differ by less than this: factor in light and in area, share of their separation in the picture.
_ALIKE = 2.0
_ASTRAY = 0.25
# One pair is chosen before another where it is nearer to what is expected by so much of what is allowed.
_CLEARLY = 0.5


@dataclass(frozen=True)
class Blob:
    """One light in a picture: its centroid (x, y) px, and how it shines.

    `area` pixels are lit; `light` is the sum of the grey values above the local background and `saturated`
    the share of the area at full scale. A blob that is `cut` extends over the edge of the picture, so that
    its centre is unknown.
    """

    x: float
    y: float
    area: int
    light: float
    saturated: float
    cut: bool


@dataclass(frozen=True)
class Pair:
    """The two markers."""

    first: Blob
    second: Blob

    @property
    def pixels(self) -> Matrix:
        """(2, 2) x and y of the first and of the second."""
        return np.array([[self.first.x, self.first.y], [self.second.x, self.second.y]])


@dataclass(frozen=True)
class NoPair:
    """Why the markers are not known, and how many lights were seen."""

    reason: str
    lights: int


def blobs(image: Image) -> list[Blob]:
    """The lights in a picture (height, width), brightest first."""
    return _blobs(image.astype(np.int16), image == _FULL)


def spot_between(dark: Image, lit: Image) -> list[Blob]:
    """The lights in `lit` that are not in `dark`, brightest first: the laser's spot and its reflections.

    LEDs and ambient light cancel, if the camera has not moved in between.
    """
    return _blobs(lit.astype(np.int16) - dark, lit == _FULL)


def is_black(image: Image) -> bool:
    """Whether no light at all reaches the camera: neither a background nor anything that shines."""
    return _background(image.astype(np.int16))[0] <= _BLACK and not blobs(image)


def marker_pair(lights: Sequence[Blob], expected: Matrix | None = None) -> Pair | NoPair:
    """The two of the blobs that are the LEDs.

    They are alike in light and area; `expected` (2, 2), the pixels where the first and the second should be,
    says how far apart they are and in which direction, and so which is which. Where they are in the picture
    is not held against them: that is what the picture is taken for. Without `expected` the left one is the
    first. Where a second pair would do nearly as well, neither is taken.
    """
    if len(lights) < 2:
        return NoPair("only one light in the picture" if lights else "no light in the picture", len(lights))
    pairs = [_in_order(*two, expected) for two in combinations(lights, 2)]
    ranked = sorted(((_strangeness(*pair, expected), pair) for pair in pairs), key=lambda entry: entry[0])
    likely = [entry for entry in ranked if entry[0] <= 1]
    if not likely:
        how = "alike" if expected is None else "alike and as far apart as expected"
        return NoPair(f"no two lights are {how}", len(lights))
    best, (first, second) = likely[0]
    if len(likely) > 1 and likely[1][0] < best + _CLEARLY:
        return NoPair("more than one pair of lights could be the markers", len(lights))
    if first.cut or second.cut:
        return NoPair("a marker is cut off by the edge of the picture", len(lights))
    return Pair(first, second)


def _in_order(one: Blob, other: Blob, expected: Matrix | None) -> tuple[Blob, Blob]:
    """First and second, by the expected direction from the one to the other."""
    right, down = (1.0, 0.0) if expected is None else expected[1] - expected[0]
    return (one, other) if (other.x - one.x) * right + (other.y - one.y) * down >= 0 else (other, one)


def _strangeness(first: Blob, second: Blob, expected: Matrix | None) -> float:
    """The penalty of this pair; above 1 it is none."""
    against = [0.0]
    if not (first.cut or second.cut):  # how bright a light is that is cut off is not known
        against.append(abs(math.log(first.light / second.light)) / math.log(_ALIKE))
        against.append(abs(math.log(first.area / second.area)) / math.log(_ALIKE))
    if expected is not None:
        right, down = expected[1] - expected[0]
        astray = math.hypot(second.x - first.x - right, second.y - first.y - down)
        against.append(astray / (_ASTRAY * math.hypot(right, down)))
    return float(np.max(against))  # NaN where one of the markers is not expected in front of the camera


def _background(grey: NDArray[np.int16]) -> tuple[float, float]:
    """The background of a picture, and how far above it a pixel is lit, in grey values."""
    middle, high = np.quantile(grey[::3, ::3], _QUANTILES)  # a ninth of the pixels suffices
    # Grey values are whole: a deviation may be larger by half of one than it looks.
    return float(middle), _FACTOR * float(high - middle + 0.5) / _NORMAL


def _blobs(grey: NDArray[np.int16], full: NDArray[np.bool_]) -> list[Blob]:
    """The lights in a picture or in a difference of two; `full` says where it is saturated."""
    background, threshold = _background(grey)
    from scipy import ndimage  # slow to come, and a cell without a camera does without

    labels, _ = ndimage.label(grey > background + threshold, np.ones((3, 3)))
    lights = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        inside = labels[box] == label
        area = int(np.count_nonzero(inside))
        if _SMALLEST <= area <= _LARGEST_SHARE * grey.size:
            # As wide as a Gaussian of which so much is above the threshold. The top of a faint one is noise.
            above = math.log((float(grey[box][inside].max()) - background) / threshold)
            sigma = max(math.sqrt(area / (2 * math.pi * max(above, 0.5))), _NARROWEST)
            blob = _blob(grey, full, labels, label, box, sigma)
            if blob is not None and blob.light > area * threshold:
                lights.append(blob)
    return sorted(lights, key=lambda blob: -blob.light)


def _blob(
    grey: NDArray[np.int16],
    full: NDArray[np.bool_],
    labels: NDArray[np.int32],
    label: int,
    box: tuple[slice, slice],
    sigma: float,
) -> Blob | None:
    """The light with this label in this box, some `sigma` px wide; None where it has no centre."""
    row, column = ((side.start + side.stop - 1) // 2 for side in box)
    half = math.ceil(max(_REACH * sigma, *((side.stop - side.start) / 2 + 1 for side in box)))
    far = half + _RING
    window = np.s_[max(row - far, 0) : row + far + 1, max(column - far, 0) : column + far + 1]
    height, width = grey.shape
    down, right = np.arange(height)[window[0]] - row, np.arange(width)[window[1]] - column
    near = (np.abs(down) <= half)[:, None] & (np.abs(right) <= half)
    inside = labels[window] == label
    others = (labels[window] != 0) & ~inside
    ring = ~near & ~others
    local = float(grey[window][ring].mean()) if ring.any() else 0.0
    shine = np.where(near & ~others, grey[window] - local, 0.0)
    centre = _centroid(shine, down, right, sigma)
    if centre is None:
        return None
    return Blob(
        x=column + centre[0],
        y=row + centre[1],
        area=int(np.count_nonzero(inside)),
        light=float(shine.sum()),
        saturated=float(full[window][inside].mean()),
        cut=min(row, column) < half or row + half >= height or column + half >= width,
    )


def _centroid(
    shine: Matrix, down: NDArray[np.int_], right: NDArray[np.int_], sigma: float
) -> tuple[float, float] | None:
    """(x, y) where the centroid is that of the light weighed by a Gaussian around it; None: nowhere.

    The weights keep out the noise of the pixels far off: as good as a fit of the Gaussian, and as free of
    bias (the windowed centroid of SExtractor, XWIN_IMAGE). The threshold has no part in it: weighing lit
    pixels alone would pull the centroid to their middles.
    """
    x = y = 0.0
    for _ in range(_STEPS):
        across, along = (np.exp(-(((side - at) / sigma) ** 2) / 2) for side, at in ((right, x), (down, y)))
        rows = shine @ across
        light = float(along @ rows)
        if light <= 0:
            return None
        # The weights draw the centroid of a Gaussian as wide as they are half the way back.
        step_x = 2 * float(along @ shine @ (across * (right - x))) / light
        step_y = 2 * float((along * (down - y)) @ rows) / light
        x, y = x + step_x, y + step_y
        if not (right[0] <= x <= right[-1] and down[0] <= y <= down[-1]):
            return None
        if math.hypot(step_x, step_y) < _STANDS:
            return x, y
    return None


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
