"""The sensors of the simulated cell: what the PSD's amplifier and the camera see at the arm's real state.

They are not the controller's, and a real cell has them elsewhere; they are here because the simulated beam
does. In the same process `CellSensors` reads them, from another one `RemoteSensors` by TCP: one JSON object a
line, each answered by one line.

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
import time
from collections.abc import Mapping
from dataclasses import asdict
from socketserver import StreamRequestHandler, ThreadingTCPServer
from typing import Any

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import RigFault, ZerobeamError
from ..rigs.simulated.simulator import SimulatedRig
from ..sensors.camera import Camera, Image
from ..sensors.psd import Psd
from .irc5 import Irc5
from .unruffled import Unruffled

_LONGEST_LINE = 1000
_MOST_SAMPLES = 10_000
_ANSWER_S = 5.0


class CellSensors:
    """The sensors of a controller's cell, in the same process."""

    def __init__(self, controller: Irc5) -> None:
        self._controller = controller
        self.psds: Mapping[str, Psd] = controller.cell.psds
        self.camera = controller.cell.camera

    def currents(self, target: str, samples: int) -> Matrix:
        """(samples, 4) of that target's PSD; a sample that did not arrive is a row of NaN."""
        if target in self.psds:
            time.sleep(samples / self.psds[target].rate)
        return self._now(target).currents(samples)

    def image(self, target: str) -> Image:
        """(height, width) grey values with that target's PSD in view."""
        return self._now(target).image()

    def _now(self, target: str) -> SimulatedRig:
        with self._controller.lock:
            return self._controller.cell.before(target)


class SensorServer(Unruffled, ThreadingTCPServer):
    """Answers for the sensors of a controller's cell."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], controller: Irc5) -> None:
        self._sensors = CellSensors(controller)
        super().__init__(address, _Handler)

    def reply(self, asked: dict[str, Any]) -> dict[str, Any]:
        sensors, what, target = self._sensors, asked.get("ask"), str(asked.get("target"))
        if what == "sheets":
            camera = None if sensors.camera is None else asdict(sensors.camera)
            return {"psds": {name: asdict(psd) for name, psd in sensors.psds.items()}, "camera": camera}
        if what == "currents":
            samples = asked.get("samples")
            if not isinstance(samples, int) or not 1 <= samples <= _MOST_SAMPLES:
                return {"error": f"samples: 1 to {_MOST_SAMPLES} are given at a time, not {samples}"}
            rows = sensors.currents(target, samples).tolist()
            return {"currents": [[None if np.isnan(value) else value for value in row] for row in rows]}
        if what == "image":
            image = sensors.image(target)
            grey = base64.b64encode(np.ascontiguousarray(image).tobytes()).decode()
            return {"height": image.shape[0], "width": image.shape[1], "grey": grey}
        return {"error": f"ask for sheets, currents or image, not {what}"}


class RemoteSensors:
    """The same sensors by TCP; RigFault where they do not answer."""

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


class _Handler(StreamRequestHandler):
    server: SensorServer
    disable_nagle_algorithm = True

    def handle(self) -> None:
        while line := self.rfile.readline(_LONGEST_LINE):
            try:
                asked = json.loads(line)
                reply = self.server.reply(asked) if isinstance(asked, dict) else {"error": "no JSON object"}
            except (ValueError, RecursionError):  # nested too deeply
                reply = {"error": "no JSON"}
            except ZerobeamError as error:
                reply = {"error": str(error)}
            self.wfile.write(json.dumps(reply, default=np.ndarray.tolist).encode() + b"\n")


def _arrays(sheet: dict[str, Any]) -> dict[str, Any]:
    """Vectors and matrices of a data sheet, as they were before they became JSON."""
    return {key: np.array(value) if isinstance(value, list) else value for key, value in sheet.items()}
