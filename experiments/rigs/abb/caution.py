"""How carefully an ABB arm is driven: speed, confirmation, the laser's output."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from ....model.errors import BadInput
from ....model.files.reading import shown
from ....model.kinematics.robot import Robot

USUAL_SHARE = 0.25  # of the joints' top speeds
_IO_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")  # RAPID's names; all three go into an address


@dataclass(frozen=True)
class Signal:
    """A digital output, by the names that Robot Web Services have for it, its network and its device."""

    name: str = "zb_laser"
    network: str = "Local"
    unit: str = "DRV_1"

    def __post_init__(self) -> None:
        if not all(_IO_NAME.fullmatch(part) for part in (self.network, self.unit, self.name)):
            raise BadInput(
                "this is not a digital output of the controller",
                found=shown(str(self)),
                allowed="NETWORK/UNIT/NAME, each a letter and then letters, digits and _, 32 in all",
                remedy=f"state it as listed under /rw/iosystem/signals, such as --laser {Signal()}",
            )

    @classmethod
    def stated(cls, text: str) -> Signal:
        """From NETWORK/UNIT/NAME."""
        network, _, rest = text.partition("/")
        unit, _, name = rest.partition("/")
        return cls(name, network, unit)

    def __str__(self) -> str:
        return f"{self.network}/{self.unit}/{self.name}"


@dataclass(frozen=True)
class Caution:
    """How the arm may move: `confirm` is asked once, before the first motion, with what is going to happen.

    `share` is of the joints' top speeds, in (0, 1]. `egm_port` is the own UDP port that EGM comes to,
    `laser` the output that switches the laser.
    """

    confirm: Callable[[str], bool]
    share: float = USUAL_SHARE
    egm_port: int = 6510
    laser: Signal = Signal()

    def __post_init__(self) -> None:
        if not 0.01 <= self.share <= 1:
            raise BadInput(
                "the speed is a share of the joints' top speeds", found=self.share, allowed="0.01 to 1"
            )
        if not 0 < self.egm_port < 65536:
            raise BadInput("--egm-port is a UDP port", found=self.egm_port, allowed="1 to 65535")


def require_six_axes(robot: Robot, drives: str, remedy: str) -> None:
    """BadInput for an arm of other joints; `drives` names the rig or controller, `remedy` what to do."""
    if robot.n != 6 or any(joint.kind != "revolute" for joint in robot.joints):
        raise BadInput(
            f"{drives} drives arms of six revolute joints",
            found=f"{robot.name}: {robot.n} joints",
            remedy=remedy,
        )
