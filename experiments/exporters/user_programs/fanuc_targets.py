"""The targets of a TP program in ASCII (FANUC)."""

from __future__ import annotations

import re

import numpy as np

from ....model.arms.branches import Branch, fanuc_configuration, is_fanuc_configuration
from ....model.arms.joint_three import from_ground, to_ground
from ....model.arms.orientation import orientation
from ....model.arms.poses import from_rpy
from ....model.robot import Matrix
from ...importers.fanuc import GROUP_1, JOINT, position_blocks
from .parts import NULL, NUMBER, Edit, JointTarget, Motion, Parsed, PoseTarget, Source

_DECIMALS = 3  # of the controller's own listings
_STATEMENT = re.compile(r"^[ \t]*\d*[ \t]*:(?P<body>[^;]*);", re.MULTILINE)
_MOTION = re.compile(r"\s*(?P<kind>[JLCAS])\s+(?P<rest>P\[.*|PR\[.*)", re.DOTALL)
_POINT = re.compile(r"(?<![A-Z])P\[\s*(?P<number>\d+)\s*(?::[^\]]*)?\]")
_SHIFTED = re.compile(
    r"Offset|VOFFSET|\bINC\b|Wjnt|PTH\b|COORD|\bMROT\b|TA_REF|Weave|Arc Start|Search", re.IGNORECASE
)
_MOVES_FRAMES = re.compile(r"(?:OFFSET|TOOL_OFFSET|VOFFSET) CONDITION|U(?:FRAME|TOOL)\[[^\]]*\]\s*=")
_NUMBERS = re.compile(r"UF\s*:\s*(?P<frame>\w+)\s*,\s*UT\s*:\s*(?P<tool>\w+)")
_CONFIG = re.compile(
    r"CONFIG\s*:\s*'(?P<letters>[NF]\s*[UD]\s*[TB])\s*,\s*(?P<turns>-?\d+\s*,\s*-?\d+\s*,\s*-?\d+)\s*'"
)
_VALUE = re.compile(
    rf"\b(?P<name>[XYZWPR]|E\d|J\d)\s*=(?P<blank>\s*)(?P<value>{NUMBER}|\*+)\s*(?P<unit>mm|deg)"
)


def fanuc_head(text: str) -> tuple[int, str]:
    """Where remarks at the head of a program are put, and what they begin with."""
    found = re.search(r"^/MN[^\n]*\n", text, re.MULTILINE)
    return (0 if found is None else found.end()), "    :  !"


def fanuc_targets(source: Source) -> Parsed:
    """What is to be corrected in a listing."""
    parsed = Parsed()
    for match in position_blocks(source.text, None):
        if match["number"] not in source.stated.leave:
            _add(match, source, parsed)
    _statements(source, parsed)
    return parsed


def _add(match: re.Match[str], source: Source, parsed: Parsed) -> None:
    name, line = f"P[{match['number']}]", source.line(match.start("number"))
    group = GROUP_1.search(source.text, match.start("block"), match.end("block"))
    if group is None:
        parsed.problems.append((line, f"{name} has no group 1"))
        return
    values = {
        found["name"]: found
        for found in _VALUE.finditer(source.text, group.start("values"), group.end("values"))
    }
    if any("*" in found["value"] for found in values.values()):
        parsed.problems.append((line, f"{name} is not taught"))
    elif JOINT.search(source.text, group.start("values"), group.end("values")):
        _add_joints(name, line, values, source, parsed)
    else:
        _add_pose(name, line, values, group, source, parsed)


def _add_joints(
    name: str, line: int, values: dict[str, re.Match[str]], source: Source, parsed: Parsed
) -> None:
    keys = [f"J{i}" for i in range(1, source.robot.n + 1)]
    if [key for key in values if key.startswith("J")][: len(keys)] != keys or any(
        values[key]["unit"] != "deg" for key in keys
    ):
        parsed.problems.append((line, f"the joints of {name} are not those of the robot"))
        return
    ground = source.stated.j3 == "ground"
    shown = np.array([float(values[key]["value"]) for key in keys])
    joints = from_ground(shown, source.robot) if ground else shown

    def write(new: Matrix) -> list[Edit]:
        written = to_ground(new, source.robot) if ground else new
        return [_edit(values[key], value) for key, value in zip(keys, written.tolist(), strict=True)]

    parsed.targets[name] = JointTarget(name, line, joints, write)


def _add_pose(
    name: str,
    line: int,
    values: dict[str, re.Match[str]],
    group: re.Match[str],
    source: Source,
    parsed: Parsed,
) -> None:
    part = slice(*group.span("values"))
    numbers, config = _NUMBERS.search(source.text[part]), _CONFIG.search(source.text[part])
    keys = list("XYZWPR")
    if numbers is None or config is None or any(key not in values for key in keys):
        parsed.problems.append((line, f"{name} is not understood: UF, UT, CONFIG, X to R are wanted"))
        return
    if any(key[0] in "EJ" and float(found["value"]) for key, found in values.items()):
        parsed.problems.append((line, f"{name} has positions of external axes, which may carry the robot"))
        return
    frames = []
    for word, option, stated, number in (
        ("tool frame", "--tool", source.stated.tools, numbers["tool"]),
        ("user frame", "--frame", source.stated.frames, numbers["frame"]),
    ):
        frame = stated.get(number, NULL if number == "0" else stated.get("") if number.isdecimal() else None)
        if frame is None:
            parsed.problems.append(
                (line, f"{name}: {word} {number} is not known; state {option} {number}=X,Y,Z,W,P,R")
            )
            return
        frames.append(frame)
    letters = " ".join(re.findall(r"[A-Z]", config["letters"]))
    turns = tuple(int(turn) for turn in config["turns"].split(","))
    start = group.start("values")

    def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
        new = [*pose[:3, 3].tolist(), *orientation(pose[:3, :3]).roll_pitch_yaw]
        edits = [_edit(values[key], value) for key, value in zip(keys, new, strict=True)]
        if branch is None or is_fanuc_configuration(letters, turns, branch, joints):
            return edits
        word, now = fanuc_configuration(branch, joints)
        return [
            *edits,
            Edit(start + config.start("letters"), start + config.end("letters"), word),
            Edit(start + config.start("turns"), start + config.end("turns"), ", ".join(map(str, now))),
        ]

    parsed.targets[name] = PoseTarget(
        name,
        line,
        from_rpy([float(values[key]["value"]) for key in keys]),
        frames[0],
        frames[1],
        lambda branch, joints: is_fanuc_configuration(letters, turns, branch, joints),
        f"{letters}, {config['turns']}",
        write,
    )


def _edit(found: re.Match[str], value: float) -> Edit:
    """A number in the room of the old one and of the blanks before it."""
    blank, old = found.span("blank"), found.span("value")
    if abs(float(found["value"]) - value) <= 0.5 * 10.0**-_DECIMALS:
        return Edit(*old, found["value"])
    return Edit(blank[0], old[1], f"{value + 0.0:.{_DECIMALS}f}".rjust(old[1] - blank[0]))


def _statements(source: Source, parsed: Parsed) -> None:
    begun = re.search(r"^/MN", source.text, re.MULTILINE)
    end = re.search(r"^/POS", source.text, re.MULTILINE)
    if begun is None or end is None:
        parsed.problems.append((1, "the listing has no part /MN"))
        return
    left = {f"P[{name}]" if name.isdecimal() else name.upper() for name in source.stated.leave}
    first = True
    apart = _STATEMENT.sub(lambda found: "\n" * found[0].count("\n"), source.text[begun.end() : end.start()])
    if lost := re.search(r"(?<![A-Z])P\[", apart):
        line = source.line(begun.end()) + apart.count("\n", 0, lost.start())
        parsed.problems.append((line, "this line is not understood"))
    for statement in _STATEMENT.finditer(source.text, begun.end(), end.start()):
        body, line = statement["body"], source.line(statement.start("body"))
        if body.lstrip().startswith(("!", "//", "--")):
            continue
        motion = _MOTION.match(body)
        if motion is None:
            if _MOVES_FRAMES.search(body):
                parsed.problems.append((line, f"{body.strip()}: frames are changed when the program runs"))
            elif re.search(r"(?<![A-Z])P\[", body):
                parsed.problems.append((line, f"{body.strip()}: a position is used when the program runs"))
            elif re.match(r"\s*[JLCAS]\s+\w*P\w*\[", body):
                parsed.problems.append((line, f"{body.strip()}: this motion is not understood"))
            first = first or bool(re.match(r"\s*(?:LBL\[|CALL\b)", body))
            continue
        register = re.match(r"PR\[\s*(\d+)\s*(?::[^\]]*)?\]", motion["rest"])
        kept = register is not None and f"PR[{register[1]}]" in left
        if register is not None and kept and not re.search(r"P(?:R)?\[", motion["rest"][register.end() :]):
            parsed.motions.append(Motion(None, line, False, True))
            continue
        points = [f"P[{found['number']}]" for found in _POINT.finditer(motion["rest"])]
        shifted = _SHIFTED.search(motion["rest"])
        if not points or "PR[" in motion["rest"] or re.search(r"(?<![A-Z])P\[\s*[A-Z]", motion["rest"]):
            parsed.problems.append(
                (line, f"{body.strip()}: its target or shift is computed when the program runs (--leave?)")
            )
        elif shifted is not None:
            parsed.problems.append((line, f"{body.strip()}: {shifted[0]} is not understood"))
        for point in points:
            if point in parsed.targets:
                parsed.motions.append(Motion(point, line, motion["kind"] != "J", first))
            elif point in left:
                parsed.motions.append(Motion(None, line, False, True))
            elif not any(point in said for _, said in parsed.problems):
                parsed.problems.append((line, f"{point} is not in the listing"))
            first = False
