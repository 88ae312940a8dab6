"""A Stäubli controller as far as the tests need it: it runs VAL3 applications, and saves their data.

Written from the manual of VAL3, without the code that is tested.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from program_arm import PendantArm

from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

ROBOT, TARGET = "tx2_60", (450.0, 0.0, 100.0)
KIND, READER, SUFFIX = "val3", "val3", ".pjx"
STEP_DEG = 6e-4  # the digits of the positions of a plan's program
_DATA = "{http://www.staubli.com/robotics/VAL3/Data/2}"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
JOINTS = [f"j{i}" for i in range(1, 7)]
POSE = ["x", "y", "z", "rx", "ry", "rz"]


def _code(program: Path) -> list[str]:
    text = "".join(ElementTree.parse(program).getroot().itertext())
    return [line.split("//")[0].strip() for line in text.splitlines()]


def carried_out(project: Path, arm: PendantArm) -> Path:
    """The data file that is saved after the application has run."""
    data = project.with_suffix(".dtx")
    tree = ElementTree.parse(data)
    values = {each.get("name"): each[0] for each in tree.iter(f"{_DATA}Data")}
    for statement in _code(project.with_name("start.pgx")):
        if motion := re.fullmatch(r"movej\((\w+),flange,(\w+)\)", statement):
            assert float(values[motion[2]].get("vel")) <= 10
            arm.move([values[motion[1]].get(key) for key in JOINTS])
        elif stored := re.fullmatch(r"(\w+)=herej\(\)", statement):
            values[stored[1]].attrib.update(
                {key: f"{value:.6f}" for key, value in zip(JOINTS, arm.joints(), strict=True)}
            )
        elif statement == "zb_key=get()":
            arm.centre()
        else:
            assert re.fullmatch(r'(begin|end|waitEndMove\(\)|resetMotion\(\)|putln\(".*"\))?', statement)
    ElementTree.register_namespace("", _DATA.strip("{}"))
    ElementTree.register_namespace("xsi", _XSI)
    saved = project.with_name("saved.dtx")
    # As a controller does it: only the file's comments say of which plan it is.
    tree.write(saved, encoding="utf-8", xml_declaration=True)
    return saved


def attributes(keys: list[str], values: Matrix) -> str:
    return " ".join(f'{key}="{value:.6f}"' for key, value in zip(keys, values, strict=True))


def configuration(robot: Robot, row: Matrix) -> str:
    """By the side view of the data sheet: axis 2 is above axis 1, upper arm 290 mm, forearm 310 mm."""
    q2, q3 = np.radians(row[1]), np.radians(row[1] + row[2])
    ahead = 290 * np.sin(q2) + 310 * np.sin(q3)
    elbow, wrist = ("positive" if row[i] > 0 else "negative" for i in (2, 4))
    return f'shoulder="{"lefty" if ahead > 0 else "righty"}" elbow="e{elbow}" wrist="w{wrist}"'


def data(name: str, kind: str, *values: str) -> str:
    rows = "".join(f'\r\n      <Value key="{i}" {value} />' for i, value in enumerate(values))
    head = f'<Data name="{name}" access="private" xsi:type="array" type="{kind}" size="{max(1, len(values))}"'
    return f"    {head}>{rows}\r\n    </Data>"
