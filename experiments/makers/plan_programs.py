"""A plan as a program: its postures in their order, slow moves, text in ASCII, and its files; and the sheets
by which a person enters new zeros, filled likewise.

The template of a language says what it has; names and numbers come in by one writer, which lets no name out
of the line, the string or the remark that it is in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.plan import Plan
from ...model.files.robot_file import Vendor
from ...model.files.whole_file import refuse_existing, write_whole
from ...model.kinematics.pendant import Pendant, pendant_of, require_link_encoder
from ...model.kinematics.robot import Robot
from ...words.wording import again_words
from ..command_options import ProgramMotion
from ..plans.constraints import require_constraints
from .calibration import NO_ROBOT, RobotCalibration
from .maker import PlanProgram, folder_of, one_line, plan_programs, require_vendor

LOG = "zerobeam posture"  # what a line of a program's log begins with, before number, unit and values
LOG_PLAN = "zerobeam plan"  # … and the line that says of which plan it is
REHEARSAL = "zerobeam rehearsal"

_DIGITS = 9  # decimals of a degree (mm): more than a plan is written with
_SHOWN_HASH = 12
_SUPPOSED_TOP = 1000.0  # deg/s, of a joint whose speed the robot file does not state: faster than any


@dataclass(frozen=True)
class PlanStep:
    """One posture of a plan: its number (from 0), the name of its target and what it repeats, degrees (mm if
    prismatic) as the controller counts them, to the last digit of the plan, and those of the intermediate
    postures on the way to it; `first` counts the positions of the steps before."""

    number: int
    target: str
    joints: tuple[float, ...]
    via: tuple[tuple[float, ...], ...]
    first: int = 0

    @property
    def label(self) -> str:
        """`target` as ASCII on one line."""
        return one_line(self.target)

    @property
    def named(self) -> dict[str, tuple[float, ...]]:
        """All joints on the way and the posture's by their names in a program: zb_v3_1, zb_v3_2, zb_p3."""
        between = {f"zb_v{self.number}_{i}": row for i, row in enumerate(self.via, start=1)}
        return {**between, f"zb_p{self.number}": self.joints}


def steps_of(plan: Plan, motion: ProgramMotion) -> list[PlanStep]:
    """The postures of a plan in its order."""
    pendant, display = pendant_of(plan.robot, motion.j3), plan.robot.display

    def rows(joints: np.ndarray) -> tuple[tuple[float, ...], ...]:
        return rounded(pendant.counted(joints * display))

    steps: list[PlanStep] = []
    for i, joints in enumerate(rows(plan.postures)):
        first = steps[-1].first + len(steps[-1].named) if steps else 0
        steps.append(PlanStep(i, called(plan, i), joints, rows(plan.via_of(i)), first))
    return steps


def called(plan: Plan, posture: int) -> str:
    """The target of a posture of the plan, and that it repeats another: what people read in a program."""
    return plan.called[posture] + again_words(plan.repeated_by(posture))


def rounded(joints: Matrix) -> tuple[tuple[float, ...], ...]:
    """Rows of joints to the last digit of a plan."""
    return tuple(tuple(round(value, _DIGITS) + 0.0 for value in row) for row in joints.tolist())


def short_hash(plan: Plan) -> str:
    """Enough of the plan's hash to know it again."""
    return plan.sha256[:_SHOWN_HASH]


def head_lines(plan: Plan, motion: ProgramMotion, note: str | None) -> list[str]:
    """Lines of ASCII, for a comment: what the program is of, and what to look at before it is started."""
    robot = one_line(plan.robot.name)
    lines = [
        f"zerobeam: plan {one_line(plan.path.name)} of {robot}, {len(plan.postures)} postures",
        f"{LOG_PLAN} {short_hash(plan)}",
        f"Joint moves in the plan's order, no joint faster than about {motion.speed:g} deg/s.",
        "Not checked: collisions on the way. First run: reduced speed, a hand on the enabling switch.",
    ]
    counting = Pendant(plan.robot, motion.j3).counting
    if counting is not None:
        lines.append(one_line(counting[0].upper() + counting[1:] + "."))
    if not plan.via:
        lines.append("The plan states no intermediate postures: the arm goes straight from one to the next.")
    return lines if note is None else [*lines, f"Note: {one_line(note)}."]


def require_axes(
    robot: Robot, most: int, holder: str, remedy: str = "csv, ros and robodk hold every robot"
) -> None:
    """BadInput for an arm that a language's joint positions cannot hold."""
    sliding = [joint.name for joint in robot.joints if joint.kind == "prismatic"]
    if robot.n > most or sliding:
        raise BadInput(
            f"{holder} has no place for this robot's joints",
            found=f"{robot.n} joints" + (f", prismatic: {one_line(', '.join(sliding))}" if sliding else ""),
            allowed=f"at most {most} revolute joints",
            remedy=remedy,
        )


def top_speeds(robot: Robot) -> list[float]:
    """(n,) degrees (mm) a second; 1000 where the robot file states none."""
    return [_SUPPOSED_TOP if joint.speed is None else joint.speed * joint.display for joint in robot.joints]


def percents(robot: Robot, speed: float) -> list[int]:
    """(n,) percent of each joint's top speed that is not faster than `speed` deg/s; 1 at least."""
    return [min(100, max(1, math.floor(round(100 * speed / top, 6)))) for top in top_speeds(robot)]


def decimal(value: float, least: int = 1) -> str:
    """A number without exponent, to its last digit and with `least` decimals at least."""
    whole, _, fraction = np.format_float_positional(value, trim="0").partition(".")
    return f"{whole}.{fraction.ljust(least, '0')}" if least else f"{whole}.{fraction}".removesuffix(".0")


def filled(
    file: Path,
    values: Mapping[str, object],
    quote: Callable[[str], str] = str,
    escape: Callable[[str], str] = str,
    line: Callable[[str], str] = one_line,
) -> list[str]:
    """The text of a template, or those of its blocks in their order.

    Whatever is filled in is ASCII on one line (or as `line` makes it), and as the language has to `escape`
    it; `quote` is its filter.
    """

    def safe(value: object) -> str:
        return escape(line(str(value)))

    environment = Environment(
        loader=FileSystemLoader(file.parent),
        undefined=StrictUndefined,
        finalize=safe,
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
    )
    environment.filters |= {
        "ascii": ascii,
        "degrees": math.degrees,
        "number": _number,
        "numbers": _numbers,
        "quote": quote,
        "radians": math.radians,
        "wrapped": wrap,
    }
    loaded = environment.get_template(file.name)
    parts = loaded.blocks.values() or [loaded.root_render_func]
    return ["".join(part(loaded.new_context({**values}))) for part in parts]


def _number(value: float, least: int = 1, digits: int | None = None) -> str:
    return decimal(value if digits is None else round(value, digits) + 0.0, least)


def _numbers(row: Iterable[float], least: int = 1, digits: int | None = None, between: str = ",") -> str:
    return between.join(_number(value, least, digits) for value in row)


def context_of(
    plan: Plan, motion: ProgramMotion, name: str, tool: str | None, note: str | None
) -> Mapping[str, object]:
    """What every template has, by its names, joints as the controller counts them: `head` and `steps` for
    people and machines, `rows` all joints by their names, `axes` their number in a row, `percents` of each
    joint's top speed and `percent` the least of them; `name` is the stem of the file; the lines of its log
    are `plan_line`, and those that begin with `log` (`rehearsal` where nothing is measured). `note` is what
    there is to check of the robot."""
    steps, each = tuple(steps_of(plan, motion)), tuple(percents(plan.robot, motion.speed))
    return {
        "plan": plan,
        "motion": motion,
        "name": name,
        "tool": tool,
        "head": tuple(head_lines(plan, motion, note)),
        "steps": steps,
        "rows": {label: row for step in steps for label, row in step.named.items()},
        "axes": plan.robot.n,
        "percents": each,
        "percent": min(each),
        "hash": short_hash(plan),
        "plan_line": f"{LOG_PLAN} {short_hash(plan)}",
        "log": LOG,
        "rehearsal": REHEARSAL,
    }


def program_of(kind: str) -> tuple[PlanProgram, Vendor | None]:
    """The kind of program of this name, and whose controllers it is for; BadInput where there is none."""
    programs = {program.name: (program, vendor) for program, vendor in plan_programs()}
    if kind not in programs:
        raise BadInput("unknown kind of program", found=kind, allowed=", ".join(programs))
    return programs[kind]


def program_texts(kind: str, plan: Plan, motion: ProgramMotion, file: Path) -> Mapping[Path, str]:
    """The files of a program and their texts: one, or several where the language has them.

    BadInput for a robot of another vendor, joints that the language cannot hold, options that it has no place
    for, and a name that the controller does not allow.
    """
    program, _ = program_of(kind)
    motion.require_only(kind, program.options)
    return program.texts(plan, motion, file)


def write_program(
    kind: str,
    plan: Plan,
    motion: ProgramMotion,
    file: Path,
    *,
    force: bool = False,
    keep: Sequence[Path | None] = (),
) -> tuple[list[Path], list[str]]:
    """Write a plan as a program; the files, and sentences that a person must see.

    With `force` other files are replaced, but none of those to `keep`. BadInput for a plan that breaks its
    constraints.
    """
    texts = program_texts(kind, plan, motion, file)
    require_constraints(plan)
    for path in texts:
        refuse_existing(path, force=force, keep=keep)
    for path, text in texts.items():
        write_whole(path, text, force=force)
    program, vendor = program_of(kind)
    notes = [
        None if vendor is None else require_vendor(plan.robot, vendor, f"a program in {kind}"),
        program.notes(plan, motion) if program.notes else Pendant(plan.robot, motion.j3).counting,
        program.overwrites(plan, motion) if program.overwrites else None,
    ]
    return list(texts), [*plan.warnings, *(note for note in notes if note is not None)]


# Sheets by which a person changes the zero of each joint in a controller.
#
# All of them set the reading at the true zero. True = reading + offset, so the joint is truly at zero where
# the controller reads -offset. Once that reading is set to zero, a new reading is the old one plus the
# offset.

_MOST = 10.0  # deg: no offset of a calibrated arm is as large
# Of the angle of a wrist's joint, by how much its motor moves each joint behind it, at most: KUKA $COUP_COMP
# A4 to A5 1/85, FANUC $INTERACTION 0.0091 to 0.0112 (public backups). A controller takes that into account,
# so a new zero of J4 alone makes J5 read otherwise.
_DRIVEN = 1 / 85
_WRIST = 3  # joints before it
_ROUNDED = 0.001  # deg, of a display


def sheet_text(
    robot: Robot,
    calibration: RobotCalibration,
    vendor: Vendor,
    pendant: Pendant | None = None,
    *,
    wrist_driven: bool = True,
    **values: object,
) -> str:
    """The sheet of a maker, whose folder has its two blocks, with what the `pendant` must read once the
    values are in; without one, the encoders must measure between links. `values` are what the blocks take
    besides. BadInput for a robot of another vendor, a prismatic joint, and for an offset that no calibrated
    arm has. `wrist_driven`: motors of the wrist move the joints behind them, and the values leave that out.
    """
    require_vendor(robot, vendor, "this sheet")
    if pendant is None:
        require_link_encoder(robot, "this sheet")
        pendant = Pendant(robot)
    sliding = [offset.name for offset in calibration.offsets if offset.kind == "prismatic"]
    if sliding:
        raise BadInput("the sheet is for revolute joints", found=f"prismatic: {', '.join(sliding)}")
    changes = pendant.counted(np.array([offset.applied for offset in calibration.offsets]))
    named = list(zip(pendant.names, changes.tolist(), strict=True))
    too_large = [f"{name} {change:+.3f} deg" for name, change in named if abs(change) > _MOST]
    if too_large:
        raise BadInput(
            "the zero of a joint would move by more than an offset of a calibrated arm",
            found=", ".join(too_large),
            allowed=f"at most {_MOST:g} deg",
            remedy="compare joint columns, signs and zeros of the run with the pendant",
        )
    values |= {"offsets": calibration.offsets, "pendant": pendant, "robot": robot}
    blocks = filled(folder_of(vendor) / "sheet.j2", values)
    about, table = (block.splitlines() for block in blocks)
    (text,) = filled(
        Path(__file__).with_name("sheet.j2"),
        {
            "head": calibration.head,
            "about": about,
            "simulated": NO_ROBOT if NO_ROBOT in calibration.warnings else None,
            "table": table,
            "changes": [
                (name, change, _driven(changes, i) if wrist_driven else 0.0)
                for i, (name, change) in enumerate(named)
            ],
            "rounding": _ROUNDED,
        },
    )
    return text


def _driven(changes: Matrix, i: int) -> float:
    """By how much the new zeros of the joints of the wrist before joint `i` (from 0) may change its reading,
    with what the display rounds."""
    before = float(np.abs(changes[_WRIST:i]).sum())
    return _DRIVEN * before + _ROUNDED if before else 0.0
