"""A Denso controller as far as the tests need it: it runs PacScript, and keeps the message output window.

Written from the manuals of PAC and PacScript, without the code that is tested.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

ROBOT, TARGET = "vs060", (400.0, 0.0, 100.0)
KIND, READER, SUFFIX = "pacscript", "pacscript", ".pcs"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program


class PacScriptController:
    """Runs Sub Main; `state` is the global variable I[90], `window` the message output window."""

    def __init__(self, program: str, arm: PendantArm) -> None:
        self.arm, self.state = arm, 0
        self.window: list[str] = []
        self.stops_before = ""  # a motion before which a person stops the program
        lines = [line.split("'")[0].strip() for line in program.splitlines()]
        self.body = lines[lines.index("Sub Main") + 1 : lines.index("End Sub")]
        self.joints: dict[str, list[float]] = {}
        self.line = ""

    def start(self) -> None:
        """One start of the program."""
        chosen, active = 0, True
        for line in filter(None, self.body):
            if line == "Select Case I[90]":
                chosen, active = self.state, False
            elif match := re.fullmatch(r"Case (\d+)", line):
                active = int(match[1]) == chosen
            elif line == "End Select":
                active = True
            elif active:
                if self.stops_before and line == f"Move P, @E {self.stops_before}":
                    return
                self.carry_out(line)

    def carry_out(self, line: str) -> None:
        if match := re.fullmatch(r"(\w+) = J\((.*)\)", line):
            self.joints[match[1]] = [float(value) for value in match[2].split(",")]
        elif line == "zb_here = CurJnt":
            self.joints["zb_here"] = self.arm.joints()
        elif match := re.fullmatch(r"zb_line = (.*)", line):
            axes = re.findall(r"Str\(Joint\((\d), zb_here\)\)", match[1])
            assert match[1] == ' & " " & '.join(f"Str(Joint({axis}, zb_here))" for axis in axes)
            self.line = " ".join(str(np.float32(self.joints["zb_here"][int(axis) - 1])) for axis in axes)
        elif match := re.fullmatch(r"Move P, @E (\w+)", line):
            self.arm.move(self.joints[match[1]])
        elif match := re.fullmatch(r"I\[90\] = (\d+)", line):
            self.state = int(match[1])
        elif match := re.fullmatch(r'PrintDbg "([^"]*)"( & zb_line)?', line):
            self.window.append(match[1] + (self.line if match[2] else ""))
        else:
            assert re.fullmatch(r"Dim \w+ As (Joint|String)|TakeArm Keep = 0|Speed \d+|GiveArm", line), line


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The lines of the window after as many starts as it takes, as a person copies them."""
    controller = PacScriptController(program.read_text(), arm)
    while not controller.window or "All postures" not in controller.window[-1]:
        controller.start()
        if controller.state:
            arm.centre()
    log = program.with_name("zb_plan.log")
    log.write_text("".join(f"10:00:00 {line}\n" for line in controller.window))
    return log


def _numbers(pose: Matrix) -> str:
    """X, Y, Z, RX, RY, RZ."""
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return ", ".join(f"{value:.6f}" for value in [*pose[:3, 3], *turns])
