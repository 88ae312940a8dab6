"""The joints of a real controller, read only: the contract of a client, and why joints are not taken."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.kinematics.pendant import Pendant
from ..transport import Stream


@dataclass(frozen=True)
class LiveAddress:
    """Where a controller is; `options` are those of its scheme."""

    scheme: str
    host: str
    port: int
    options: Mapping[str, str]

    def number(self, option: str, usual: int, most: int) -> int:
        """A whole number from 1 to `most`; BadInput for anything else."""
        text = self.options.get(option, str(usual))
        if not (re.fullmatch(r"[0-9]{1,6}", text) and 1 <= int(text) <= most):
            raise BadInput(f"{option}= is not understood", found=text[:100], allowed=f"1 to {most}")
        return int(text)


@dataclass(frozen=True, eq=False)
class JointReading:
    """`joints` (n,) deg (mm if prismatic), joint 1 first, as the controller counts them; `stamp` is when they
    were measured, by a clock that only advances."""

    joints: Matrix
    stamp: float


class LiveJoints(ABC):
    """A connection to the controller at `address`; a method may raise LinkFault.

    `identity` is what the controller says of itself, empty where it was not asked; `resolution` deg (mm), a
    number or (n,), is one count of its joints; `between_links` says that joint 3 is counted from link 2
    whatever the pendant does; `ticks` of the stamp are a second, None where that is not published.
    """

    identity: str = ""
    resolution: float | Matrix = 0.0
    between_links: bool = False
    ticks: float | None = None
    _stream: Stream

    @abstractmethod
    def __init__(self, address: LiveAddress, pendant: Pendant) -> None: ...

    def read(self) -> JointReading:
        """The joints, measured after the call, within one deadline."""
        self._stream.begin()
        return self._reading()

    @abstractmethod
    def _reading(self) -> JointReading:
        """What the controller answers."""

    def close(self) -> None:
        """End the connection; safe more than once."""
        self._stream.close()


class OtherArm(Exception):
    """The controller is that of another arm than the plan's."""


class JointsRefused(Exception):
    """The joints are not taken now; `why` is a sentence for the person."""

    def __init__(self, kind: Literal["connection", "stale", "moving"], why: str) -> None:
        self.kind, self.why = kind, why
        super().__init__(why)
