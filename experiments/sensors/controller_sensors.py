"""The sensors that come with a controller: what a rig requires of them, and those of the simulated one.

The latter answer by TCP, one JSON object a line, each answered by one line:

    {"ask": "sheets"} → {"psds": {NAME: {…}}, "camera": {…} or null}
    {"ask": "currents", "target": NAME, "samples": N} → {"currents": [[x+, x-, y+, y-], …]}, null: lost
    {"ask": "image", "target": NAME} → {"width": W, "height": H, "grey": base64, row by row}

What cannot be answered is {"error": "…"}. Currents take N / rate seconds before they are answered, an image
none. The fields of the sheets are those of `Psd` and `Camera` (mm, rad, pixels).
"""

from __future__ import annotations

import base64
import json
import socket
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import RigFault
from .camera import Camera, Image
from .psd import Psd

_ANSWER_S = 5.0


class Sensors(Protocol):
    """The sensors next to the controller: PSDs by target, and a camera or none."""

    psds: Mapping[str, Psd]
    camera: Camera | None

    def currents(self, target: str, samples: int) -> Matrix:
        """(samples, 4) of that target's PSD; a sample that did not arrive is a row of NaN."""
        ...

    def image(self, target: str) -> Image:
        """(height, width) grey values 0 to 255, with that target's PSD in view."""
        ...


class RemoteSensors:
    """The sensors of a simulated controller by TCP; RigFault where they do not answer."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=_ANSWER_S)
        except OSError as error:
            raise RigFault(f"no sensors at {host}, port {port}: {error.strerror or error}") from None
        self._lines = self._socket.makefile("rwb")
        sheets = self._ask(ask="sheets")
        self.psds: Mapping[str, Psd] = {name: Psd(**_arrays(psd)) for name, psd in sheets["psds"].items()}
        self.camera = None if sheets["camera"] is None else Camera(**_arrays(sheets["camera"]))

    def currents(self, target: str, samples: int) -> Matrix:
        return np.array(self._ask(ask="currents", target=target, samples=samples)["currents"], dtype=float)

    def image(self, target: str) -> Image:
        reply = self._ask(ask="image", target=target)
        grey = np.frombuffer(base64.b64decode(reply["grey"]), dtype=np.uint8)
        return grey.reshape(reply["height"], reply["width"])

    def close(self) -> None:
        self._lines.close()
        self._socket.close()

    def _ask(self, **what: Any) -> dict[str, Any]:
        try:
            self._lines.write(json.dumps(what).encode() + b"\n")
            self._lines.flush()
            reply = json.loads(self._lines.readline())
        except (OSError, ValueError):
            raise RigFault("the sensors do not answer: is the simulated controller still there?") from None
        if "error" in reply:
            raise RigFault(f"the sensors refuse: {reply['error']}")
        return dict(reply)


def _arrays(sheet: dict[str, Any]) -> dict[str, Any]:
    """Vectors and matrices of a data sheet, as they were before they became JSON."""
    return {key: np.array(value) if isinstance(value, list) else value for key, value in sheet.items()}
