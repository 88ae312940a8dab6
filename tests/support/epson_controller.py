"""An Epson controller as far as the tests need it: it runs functions of SPEL+, and keeps their log.

Written from the language's reference, without the code that is tested. The arm has the lengths of a built-in
one of another maker: what is tested are the files.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN

TARGET = (500.0, 0.0, 100.0)
KIND, READER, SUFFIX = "spel", "spel", ".prg"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program


def robot_file(folder: Path) -> str:
    text = (BUILT_IN / "rs007n.yaml").read_text().replace("vendor: kawasaki", "vendor: epson")
    path = folder / "mine.yaml"
    path.write_text(text.replace("name: rs007n", "name: mine").replace("model: RS007N", "model: mine"))
    return str(path)


class SpelController:
    """Runs one function; `kept` are the Preserve variables."""

    def __init__(self, program: str, arm: PendantArm) -> None:
        self.arm, self.log = arm, ""
        self.lines = [line.split("'")[0].strip() for line in program.splitlines()]
        begin = next(i for i, line in enumerate(self.lines) if line.startswith("Function "))
        assert [line for line in self.lines[:begin] if line] == ["Global Preserve Integer zb_next"]
        self.body = self.lines[begin + 1 : self.lines.index("Fend")]
        self.variables: dict[str, int | str] = {"zb_next": 0}
        self.printed: list[str] = []
        self.answer = 1

    def value(self, text: str) -> int | str:
        parts: list[int | str] = []
        for part in re.findall(r'"[^"]*"|FmtStr\$\(.*?, "[0.]+"\)|[\w$]+|[-+]', text):
            if part.startswith('"'):
                parts.append(part[1:-1])
            elif match := re.fullmatch(r'FmtStr\$\((.*), "(0(?:\.(0+))?)"\)', part):
                number = re.fullmatch(r"Agl\((\d)\)", match[1])
                of = self.arm.joints()[int(number[1]) - 1] if number else float(self.variables[match[1]])
                parts.append(f"{of:.{len(match[3] or '')}f}")
            elif part in "+-":
                parts.append(part)
            else:
                parts.append(int(part) if part.isdigit() else self.variables[part])
        result = parts[0] if parts[0] != "-" else -int(parts[1])
        for sign, each in zip(parts[1::2], parts[2::2], strict=False) if parts[0] != "-" else ():
            result = result + each if sign == "+" else int(result) - int(each)  # type: ignore[operator]
        return result

    def start(self) -> None:
        """One start of the function; a person gives the answer, 1 where the beam is on the centre."""
        runs: list[bool] = []  # of each If and Select around a line, whether its present part is carried out
        chosen: int | str = ""
        for line in filter(None, self.body):
            word = line.split()[0]
            if match := re.fullmatch(r"If (\w+) ([=>]) (\d+) Then", line):
                left, right = int(self.variables.get(match[1], 0)), int(match[3])
                runs.append(left == right if match[2] == "=" else left > right)
            elif line == "EndIf" or line == "Send":
                runs.pop()
            elif word == "Select":
                chosen = self.value(line[7:])
                runs.append(False)
            elif word == "Case":
                runs[-1] = self.value(line[5:]) == chosen
            elif all(runs):
                self.carry_out(line)

    def carry_out(self, line: str) -> None:
        if match := re.fullmatch(r"Go JA\((.*)\)", line):
            self.arm.move([float(value) for value in match[1].split(",")])
        elif match := re.fullmatch(r"Input (\w+)", line):
            self.variables[match[1]] = self.answer
        elif match := re.fullmatch(r"Print #30, (.*)", line):
            self.log += f"{self.value(match[1])}\n"
        elif match := re.fullmatch(r"Print (.*)", line):
            self.printed.append(str(self.value(match[1])))
        elif match := re.fullmatch(r"(zb_\w+\$?) = (.*)", line):
            self.variables[match[1]] = self.value(match[2])
        else:
            assert re.fullmatch(
                r"(Integer|String) \w+\$?|Motor On|Power Low|Speed \d+|Accel 10, 10"
                r"|AOpen \"zb_plan.log\" As #30|Close #30",
                line,
            ), line


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The log of as many starts as it takes."""
    controller = SpelController(program.read_text(), arm)
    while not controller.printed or "All postures" not in controller.printed[-1]:
        controller.start()
        if controller.variables["zb_next"]:
            arm.centre()
    log = program.with_name("zb_plan.log")
    log.write_text(controller.log)
    return log


def _numbers(pose: Matrix) -> list[str]:
    """X, Y, Z, U, V, W."""
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    return [f"{value:.6f}" for value in [*pose[:3, 3], *turns]]


def _words(row: Matrix) -> list[int]:
    """1 or 2 for hand, elbow and wrist, by the side view of the arm, whose joint 3 turns against joint 2."""
    lower, fore = np.radians([row[1], row[1] - row[2]])
    ahead = 355 * np.sin(lower) + 375 * np.sin(fore)
    return [1 + int(each) for each in (ahead < 0, row[2] > 0, row[4] < 0)]
