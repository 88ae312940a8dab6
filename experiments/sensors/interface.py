"""What a rig asks of the sensors that come with its controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ...model.arrays import Matrix
from .camera import Camera, Image
from .psd import Psd


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
