"""The sensors of the simulated cell: what the PSD's amplifier and the camera see at the arm's real state.

They are not the controller's, and a real cell has them elsewhere; they are here because the simulated
beam is. In the same process `CellSensors` reads them, from another one `RemoteSensors` by TCP (the protocol:
experiments/sensors/detectors.py).
"""

import base64
import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from socketserver import StreamRequestHandler, ThreadingTCPServer
from typing import Any

import numpy as np

from abb_controller.irc5 import Irc5
from abb_controller.rws_server import QuietServer
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.sensors.detectors import Image, Psd
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import ZerobeamError

_LONGEST_LINE = 1000
_MOST_SAMPLES = 10_000


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


class SensorServer(QuietServer, ThreadingTCPServer):
    """Answers for the sensors of a controller's cell."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], controller: Irc5) -> None:
        self._sensors = CellSensors(controller)
        super().__init__(address, _SensorHandler)

    def reply(self, request: dict[str, Any]) -> dict[str, Any]:
        sensors, what, target = self._sensors, request.get("ask"), str(request.get("target"))
        if what == "sheets":
            camera = None if sensors.camera is None else asdict(sensors.camera)
            return {"psds": {name: asdict(psd) for name, psd in sensors.psds.items()}, "camera": camera}
        if what == "currents":
            samples = request.get("samples")
            if not isinstance(samples, int) or not 1 <= samples <= _MOST_SAMPLES:
                return {"error": f"samples: 1 to {_MOST_SAMPLES} are given at a time, not {samples}"}
            rows = sensors.currents(target, samples).tolist()
            return {"currents": [[None if np.isnan(value) else value for value in row] for row in rows]}
        if what == "image":
            image = sensors.image(target)
            grey = base64.b64encode(np.ascontiguousarray(image).tobytes()).decode()
            return {"height": image.shape[0], "width": image.shape[1], "grey": grey}
        return {"error": f"ask for sheets, currents or image, not {what}"}


class _SensorHandler(StreamRequestHandler):
    server: SensorServer
    disable_nagle_algorithm = True

    def handle(self) -> None:
        while line := self.rfile.readline(_LONGEST_LINE):
            try:
                request = json.loads(line)
                reply = (
                    self.server.reply(request) if isinstance(request, dict) else {"error": "no JSON object"}
                )
            except (ValueError, RecursionError):  # nested too deeply
                reply = {"error": "no JSON"}
            except ZerobeamError as error:
                reply = {"error": str(error)}
            self.wfile.write(json.dumps(reply, default=np.ndarray.tolist).encode() + b"\n")
