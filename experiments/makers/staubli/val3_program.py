"""A plan as a VAL3 application (Stäubli): .pjx, start.pgx, stop.pgx and .dtx in one folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..import_jobs import TaughtPoint
from ..maker import one_line
from ..plan_programs import LOG_PLAN, decimal, head_lines, made_for, percents, short_hash, steps_of

_NAME = re.compile(r"[A-Za-z]\w{0,14}")
_XML = '<?xml version="1.0" encoding="utf-8"?>'
_SPACE = "http://www.staubli.com/robotics/VAL3"
_SCHEMA = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_CONFIRM = (
    "confirm: get() waits for a key of the pendant. If this controller has none, do not use this program:",
    "teach the joint variables zb_p0, zb_p1, ... with the beam on the centre, and import the data file.",
    "confirm: after the jog the controller goes on from where the arm is (resetMotion).",
    "herej() is what the controller sends to the amplifiers: press the key when the arm is still.",
    "At the end save the application, so that the data file has what was recorded.",
)


def val3_program(plan: Plan, motion: ProgramMotion, file: Path) -> dict[Path, str]:
    """The files of an application called as `file`. At each posture it waits for a key, and then stores the
    joints as zb_m0, zb_m1, …, which are those of the plan before."""
    note = made_for(plan, "staubli", "a VAL3 application", 6, "a jointRx")
    if file.suffix.lower() != ".pjx" or not _NAME.fullmatch(file.stem):
        raise BadInput(
            "the file's name is that of the application, and VAL3 does not allow this one",
            found=file.name,
            allowed="a letter, then letters, digits and _: at most 15, and .pjx (zb_plan/zb_plan.pjx)",
            remedy="choose another name for the file, in a folder of its own",
        )
    steps, percent, zone = (
        steps_of(plan, motion),
        min(percents(plan.robot, motion.speed)),
        decimal(motion.zone),
    )
    lines = [f"  // {line}" for line in (*head_lines(plan, motion, note), *_CONFIRM)]
    for step in steps:
        *between, here = step.named
        lines += [
            f"  // posture {step.number}, {one_line(step.target)}",
            *(f"  movej({name},flange,zb_via)" for name in between),
            f"  movej({here},flange,zb_stop)",
            "  waitEndMove()",
            f'  putln("Posture {step.number}: jog the beam onto the centre, then press a key")',
            "  zb_key=get()",
            f"  zb_m{step.number}=herej()",
            "  resetMotion()",
        ]
    rows = [item for step in steps for item in step.named.items()]
    rows += [(f"zb_m{step.number}", step.joints) for step in steps]
    speed = f'accel="20" vel="{percent}" decel="20" tmax="250" rmax="90"'
    blend = "joint" if motion.zone else "off"
    data = [
        *(_data(name, "jointRx", _joints(row)) for name, row in rows),
        _data("zb_via", "mdesc", f'{speed} blend="{blend}" leave="{zone}" reach="{zone}"'),
        _data("zb_stop", "mdesc", f'{speed} blend="off" leave="0" reach="0"'),
        _data("zb_key", "num", 'value="0"'),
        _data("zb_plan", "string", f'value="{LOG_PLAN} {short_hash(plan)}"'),
    ]
    return {
        file: _project(file.stem),
        file.with_name("start.pgx"): _program("start", lines),
        file.with_name("stop.pgx"): _program("stop", ["  resetMotion()"]),
        file.with_suffix(".dtx"): "\n".join(
            [
                _XML,
                f'<Database {_SCHEMA} xmlns="{_SPACE}/Data/2">',
                "  <Datas>",
                *data,
                "  </Datas>",
                "</Database>",
                "",
            ]
        ),
    }


def _joints(row: tuple[float, ...]) -> str:
    return " ".join(f'j{i}="{decimal(round(value, 3), 3)}"' for i, value in enumerate(row, start=1))


def _data(name: str, kind: str, value: str) -> str:
    head = f'    <Data name="{name}" access="private" xsi:type="array" type="{kind}" size="1">'
    return f'{head}<Value key="0" {value} /></Data>'


def _program(name: str, lines: list[str]) -> str:
    code = "\n".join(line.replace("]]>", "]] >") for line in lines)
    return "\n".join(
        [
            _XML,
            f'<Programs {_SCHEMA} xmlns="{_SPACE}/Program/2">',
            f'  <Program name="{name}" access="public">',
            f"    <Code><![CDATA[begin\n{code}\nend]]></Code>",
            "  </Program>",
            "</Programs>",
            "",
        ]
    )


def _project(name: str) -> str:
    return "\n".join(
        [
            _XML,
            f'<Project xmlns="{_SPACE}/Project/3">',
            '  <Parameters version="s7.3.1" stackSize="5000" millimeterUnit="true" />',
            "  <Programs>",
            '    <Program file="start.pgx" />',
            '    <Program file="stop.pgx" />',
            "  </Programs>",
            "  <Database>",
            f'    <Data file="{name}.dtx" />',
            "  </Database>",
            "  <Libraries />",
            "</Project>",
            "",
        ]
    )


def named_positions(text: str, points: Sequence[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a data file: NAME is NAME[0]."""
    return [point._replace(name=point.name.removesuffix("[0]")) for point in points]
