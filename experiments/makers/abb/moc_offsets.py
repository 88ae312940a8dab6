"""The offsets as changes of an ABB controller's motor calibration offsets (`cal_offset` in MOC.cfg).

Known from public sources: SYSPAR/MOC.cfg of a controller's backup has, in its section MOTOR_CALIB, an entry
`-name "rob1_1"` (older controllers: `irb_1`) with `-cal_offset` for each motor, an angle of the motor's shaft
in rad, from -2 pi to 2 pi (RAPID modules that write it with WriteCfgData refuse others); RWS gives it at
/rw/cfg/MOC/MOTOR_CALIB/instances/rob1_1. Not known: whether the reading rises or falls with it, the gear
ratios of an arm (they are seldom in a backup), and which gears are coupled. So sign and ratios are stated by
who knows them, and the file says how to see from the readings whether they were right:

    change of the reading = sign * change of cal_offset / ratio       (rad at the joint; rad at the motor)
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, located
from ....model.kinematics.pendant import require_link_encoder
from ....model.parsing.reading import did_you_mean, line_numbers, read_other_text, shown
from ..calibration import JointOffset, RobotCalibration
from ..maker import file_of_backup, numbers_of, one_line, require_vendor
from ..plan_programs import filled

Sign = Literal[1, -1]
_NUMBERS = "finite numbers separated by commas"
TURN = 2 * math.pi

_SECTION = re.compile(r"^([A-Z][A-Z0-9_]*):[ \t]*\r?$", re.MULTILINE)
_ENTRY = re.compile(r'(?<![\w-])-name\s+"([^"\n]*)"')
_QUOTED = re.compile(r'"[^"\n]*"')
_COMMENT = re.compile(r"^[ \t]*#[^\n]*", re.MULTILINE)
_NUMBER = r"\s+(-?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])"


@dataclass(frozen=True)
class Gears:
    """Motors of the joints as options state them, joint 1 first: `ratios` are motor turns for one turn of the
    joint, negative where they rotate in opposite directions; `signs` as in the formula above. None where
    not stated."""

    ratios: Sequence[float] | None = None
    signs: Sequence[Sign] | None = None

    @classmethod
    def of_options(cls, ratios: str | None, signs: str | None, n: int) -> Gears:
        """As on the command line, for n joints: numbers separated by commas; one sign may serve for all."""
        values = None if signs is None else numbers_of(signs, "--motor-sign", _NUMBERS)
        if values is not None and (len(values) not in (1, n) or not set(values) <= {1.0, -1.0}):
            raise BadInput(
                "--motor-sign is not understood",
                found=signs,
                allowed=f"1 or -1: one for all joints, or {n} separated by commas",
            )
        each: list[Sign] | None = None
        if values is not None:
            each = [1 if value > 0 else -1 for value in (values * n if len(values) == 1 else values)]
        numbers = None if ratios is None else numbers_of(ratios, "--ratio", _NUMBERS)
        if numbers is not None and (len(numbers) != n or not all(numbers)):
            raise BadInput(
                "--ratio is not understood",
                found=ratios,
                allowed=f"{n} numbers other than 0: motor turns for one turn of each joint, negative if they"
                " rotate in opposite directions",
            )
        return cls(numbers, each)


class _Value(NamedTuple):
    """A number in the file, and the position of its text."""

    number: float
    start: int
    end: int


@dataclass(frozen=True)
class _Change:
    """One motor's new cal_offset; `turns` whole turns of the motor were taken off to keep it in its range.

    `reading` is by how much the joint's reading will have changed, rad, before the turns are put right.
    """

    value: float
    turns: int
    reading: float


def moc_text(
    calibration: RobotCalibration, gears: Gears, against: Path | None = None, unit: str = "rob1"
) -> str:
    """A table of the changes; with `against`, the controller's MOC.cfg, a unified diff of that file.

    The motors of mechanical unit `unit` are those called `<unit>_1` and so on.
    """
    require_vendor(calibration.corrected, "abb", "MOC.cfg")
    require_link_encoder(calibration.corrected, "MOC.cfg")
    _require_turning(calibration)
    values = {"head": calibration.head, "offsets": calibration.offsets, "gears": gears}
    if against is None:
        return _filled({**values, "changes": None})
    text = read_other_text(against)
    if gears.signs is None:
        raise BadInput(
            "the sign must be stated: it is not published whether a reading rises or falls with cal_offset",
            allowed="--motor-sign 1 (it rises, at a positive ratio) or -1, or a sign for each joint: 1,-1,…",
            remedy="raise one cal_offset by 0.1, restart, compare the readings at rest, put it back"
            " (docs/export.md)",
        )
    valid = _COMMENT.sub(_blank, text)
    changes: dict[str, tuple[JointOffset, _Value, _Change]] = {}
    for i, offset in enumerate(calibration.offsets):
        if not offset.exported:
            continue
        motor = f"{unit}_{i + 1}"
        with located(against):
            old = _number(valid, "MOTOR_CALIB", motor, "cal_offset")
            ratio = _ratio(valid, motor, i, gears)
        changes[motor] = offset, old, _change(offset.applied_rad, gears.signs[i], ratio, old.number)
    new = text
    for _, old, change in sorted(changes.values(), key=lambda row: row[1].start, reverse=True):
        new = new[: old.start] + f"{change.value:.6f}" + new[old.end :]
    turned = [motor for motor, (_, _, change) in changes.items() if change.turns]
    head = _filled({**values, "changes": changes, "turned": turned})
    return head + _diff(text, new, one_line(against.name))


def _require_turning(calibration: RobotCalibration) -> None:
    sliding = [o.name for o in calibration.offsets if o.exported and o.kind == "prismatic"]
    if sliding:
        raise BadInput(
            "the offset of a prismatic joint has no motor angle known here",
            found=", ".join(sliding),
            allowed="offsets of revolute joints",
            remedy="leave it out: " + " ".join(f"--without {name}" for name in sliding),
        )


def _change(offset: float, sign: Sign, ratio: float, old: float) -> _Change:
    """The reading is to rise by `offset` (rad), since true = recorded + offset."""
    new = old + sign * ratio * offset
    turns = 0 if -TURN <= new <= TURN else math.floor(new / TURN)
    return _Change(new - turns * TURN, turns, offset - sign * turns * TURN / ratio)


def _ratio(text: str, motor: str, joint: int, gears: Gears) -> float:
    """As in the file's section TRANSMISSION, or as stated; BadInput if they differ or there is neither."""
    written = None
    if motor in _entries(text, "TRANSMISSION"):
        written = _number(text, "TRANSMISSION", motor, "transm_joint").number
    by_option = None if gears.ratios is None else gears.ratios[joint]
    if written is not None and by_option is not None and not math.isclose(written, by_option, rel_tol=1e-6):
        raise BadInput(
            f"the gear ratio of {motor} differs between option and file",
            found=f"--ratio {by_option:g}, transm_joint {written:g}",
            remedy="leave out --ratio, or correct it",
        )
    ratio = by_option if written is None else written
    if not ratio:
        raise BadInput(
            f"the gear ratio of {motor} is not known",
            found="no TRANSMISSION entry of it in the file"
            if written is None
            else f"transm_joint {written:g}",
            allowed="--ratio R1,R2,…: motor turns for one turn of each joint, negative if they rotate in"
            " opposite directions",
            remedy="state them; they are in the arm's documentation, or ask the manufacturer",
        )
    return ratio


def _entries(text: str, section: str) -> dict[str, tuple[int, int]]:
    """From and to of each entry of a section, by its name; none if there is no such section."""
    heads = list(_SECTION.finditer(text))
    spans: dict[str, tuple[int, int]] = {}
    for i, head in enumerate(heads):
        if head.group(1) != section:
            continue
        end = heads[i + 1].start() if i + 1 < len(heads) else len(text)
        starts = list(_ENTRY.finditer(text, head.end(), end))
        for j, entry in enumerate(starts):
            name = entry.group(1)
            if name in spans:
                raise BadInput(f"duplicate entry in {section}", found=shown(name))
            spans[name] = entry.end(), starts[j + 1].start() if j + 1 < len(starts) else end
    return spans


def _blank(match: re.Match[str]) -> str:
    """Nothing in place of what was found, so that all places stay."""
    return " " * len(match.group())


def _number(text: str, section: str, name: str, key: str) -> _Value:
    entries = _entries(text, section)
    if name not in entries:
        raise BadInput(
            f"the file has no motor {name!r} in {section}",
            found=one_line(", ".join(entries)) or f"no entry of {section}",
            allowed="--unit NAME: the mechanical unit, of which the motors are called NAME_1, NAME_2, …",
            remedy=did_you_mean(name, entries) or "give the MOC.cfg of this robot's backup",
        )
    start, end = entries[name]
    # A text of the file must not be taken for a key of it.
    entry = _QUOTED.sub(_blank, text[start:end])
    line = line_numbers(text)(start)
    values = list(re.finditer(rf"(?<![\w-])-{key}{_NUMBER}", entry))
    if len(values) != 1:
        raise BadInput(
            f"{name} has no {key}" if not values else f"{name} has {key} more than once",
            allowed=f"-{key} with a number, once",
            remedy="calibrate the motor first" if key == "cal_offset" else None,
            line=line,
        )
    if key == "cal_offset" and not re.search(r"(?<![\w-])-valid_cal_offset(?![\w-])", entry):
        raise BadInput(
            f"the calibration offset of {name} is not valid by the file itself",
            found="no -valid_cal_offset",
            remedy="calibrate the motor first, and record the measurements after that",
            line=line,
        )
    value = values[0]
    if not math.isfinite(float(value.group(1))):
        raise BadInput(f"{key} of {name} is too large", found=value.group(1)[:40], line=line)
    return _Value(float(value.group(1)), start + value.start(1), start + value.end(1))


def _filled(values: Mapping[str, object]) -> str:
    """What a person must know and do: lines of remarks."""
    (text,) = filled(Path(__file__).with_name("moc.j2"), values)
    return text


def _diff(old: str, new: str, name: str) -> str:
    """A unified diff. Lines end at line feeds alone: carriage returns are kept as they are."""
    rows = difflib.unified_diff(_lines(old), _lines(new), name, name, n=3)
    return "".join(row if row.endswith("\n") else f"{row}\n\\ No newline at end of file\n" for row in rows)


def _lines(text: str) -> list[str]:
    return re.findall(r"[^\n]*\n|[^\n]+", text)


def reading_change(old: Path, new: Path, gears: Gears, joints: int) -> Matrix:
    """(n,) degrees by which joints read more with the cal_offsets of the new MOC.cfg than with the old ones,
    each a file or the folder of a backup, by the formula above for gears that are not coupled.

    BadInput where the sign or a ratio of a motor that was changed is not known. Whole turns of a motor are in
    the revolution counters: of all changes by such turns the smallest is taken.
    """
    paths = [file_of_backup(path, "MOC.cfg") for path in (old, new)]
    texts = [_COMMENT.sub(_blank, read_other_text(path)) for path in paths]
    change = np.zeros(joints)
    for i in range(joints):
        motor, values = f"rob1_{i + 1}", []
        for path, text in zip(paths, texts, strict=True):
            with located(path):
                values.append(_number(text, "MOTOR_CALIB", motor, "cal_offset").number)
        if values[0] == values[1]:
            continue
        if gears.signs is None:
            raise BadInput(
                "MOC.cfg alone does not say by how much the readings changed",
                found=f"{motor}: cal_offset {values[0]:g} -> {values[1]:g}",
                allowed="--motor-sign 1 or -1, and --ratio where the file has no transmission: gears that are"
                " not coupled",
                remedy="state --entered instead: by how much more each joint reads at the same place, by the"
                " pendant before and after",
            )
        with located(paths[1]):
            ratio = _ratio(texts[1], motor, i, gears)
        turned = math.remainder(values[1] - values[0], TURN)
        change[i] = math.degrees(gears.signs[i] * turned / ratio)
    return change
