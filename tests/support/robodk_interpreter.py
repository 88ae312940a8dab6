"""What of RoboDK's Python interface the programs of zerobeam use, on an arm."""

import sys
from types import ModuleType, SimpleNamespace
from unittest import mock

from program_arm import PendantArm


def carried_out(text: str, arm: PendantArm, real: bool = True) -> None:
    """Run the program; it writes its log into the working folder."""

    class Robolink:
        def ItemUserPick(self, message: str, kind: int) -> SimpleNamespace:
            return robot

        def RunMode(self) -> int:
            return 6 if real else 1

        def ShowMessage(self, message: str, popup: bool) -> None:
            assert popup
            if message.startswith("Posture"):
                arm.centre()

    robot = SimpleNamespace(
        Valid=lambda: True,
        Joints=lambda: SimpleNamespace(list=arm.joints),
        setSpeedJoints=lambda speed: None,
        setRounding=lambda zone: None,
        MoveJ=arm.move,
        WaitMove=lambda: None,
    )
    link = ModuleType("robodk.robolink")
    link.Robolink, link.ITEM_TYPE_ROBOT, link.RUNMODE_RUN_ROBOT = Robolink, 2, 6
    package = ModuleType("robodk")
    package.robolink = link
    with mock.patch.dict(sys.modules, {"robodk": package, "robodk.robolink": link}):
        exec(compile(text, "program.py", "exec"), {"__name__": "__main__"})
