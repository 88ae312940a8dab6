"""What a backup of a FANUC controller says of its encoders: SYSMAST.VA and SYMOTN.VA, as text.

A reading is B r with r_j = ±(pulses_j - $MASTER_COUN[j]) / $PARAM_GROUP[1].$ENCSCALES[j]: the sign is minus
where $PARAM_GROUP[1].$MOSIGN[j] is FALSE, and B has the coupling of the wrist: $MRR_GRP[1].$INTERACTION, rad
for a pulse. $MRR_GRP[1].$AXS_COUPLE[3] is -2 where the encoder of joint 3 measures the angle between links 2
and 3, and 0 where it measures from the ground. By these, with $DMR_GRP[1].$SPC_COUNT as the pulses, 24 of 26
public backups (R-2000iB/210F, R-2000iB/185L, M-900iA/260L; JuniorNatalin/VASC) give $SCR_GRP[1].$MCH_ANG
to 0.001 deg in all six joints. The other two were saved while the arm moved.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.options import J3
from ....model.parsing.confinement import require_within
from ....model.parsing.reading import read_bytes, shown

_FIELD = re.compile(r"\s*Field:\s+(?P<name>\S+)(?P<rest>.*)")
_ARRAY = re.compile(r"\s+(?:Access: \w+:?\s+)?ARRAY\[(\d+)\] OF (\w+)\s*")
_SCALAR = re.compile(r"\s+Access: \w+: (?P<kind>\w+(?:\[\d+\])?) = (?P<value>.*)")
_ENTRY = re.compile(r"\s+\[(\d+)\] = (.*)")
_COUPLED: dict[int, J3] = {-2: "link", 0: "ground"}
_NONE, _STRONGEST = 1e-6, 0.1  # of a wrist's couplings: those of the public backups are 0.009 to 0.011
FEWEST_PULSES, MOST_PULSES = 100.0, 2e6  # for a degree; those of $MRR_GRP are for a radian, 1e7 and more
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class FanucBackup:
    """Of the joints that were asked for: master counts, pulses for a degree with their sign, and how the
    joints (n,) follow from their encoders alone, both degrees: joints = coupling (n, n) @ encoders."""

    model: str
    master: tuple[int, ...]
    per_degree: tuple[float, ...]
    coupling: Matrix
    encoder3: J3


def read_fanuc_backup(folder: Path, joints: int) -> FanucBackup:
    """The two files of the folder, or of the folder of a file. BadInput, with the line, for one that is
    damaged, an arm that is not mastered, or one that is coupled otherwise than described above."""
    mast, motn = _file_of(folder, "sysmast.va"), _file_of(folder, "symotn.va", "sysmotn.va")
    if mast.scalar("$DMR_GRP[1].$MASTER_DONE", _boolean) is not True:
        raise BadInput(
            "the robot of this backup is not mastered",
            found="$DMR_GRP[1].$MASTER_DONE = FALSE",
            remedy="master the robot, and make another backup",
            file=mast.path,
        )
    counts = mast.array("$DMR_GRP[1].$MASTER_COUN", "INTEGER", int, joints)
    scales = motn.array("$PARAM_GROUP[1].$ENCSCALES", "REAL", _scale, joints)
    rising = motn.array("$PARAM_GROUP[1].$MOSIGN", "BOOLEAN", _boolean, joints)
    couple = motn.array("$MRR_GRP[1].$AXS_COUPLE", "SHORT", int, joints)
    if joints < 3 or couple[2] not in _COUPLED or any(couple[:2] + couple[3:]):
        raise BadInput(
            "the coupling of the axes of this arm is not worked out here",
            found=f"$MRR_GRP[1].$AXS_COUPLE = {', '.join(map(str, couple))}",
            allowed="-2 (the encoder of joint 3 measures the angle between links 2 and 3) or 0 (from the"
            " ground) at [3], 0 at the others",
            file=motn.path,
        )
    model = motn.scalar("$SCR_GRP[1].$ROBOT_ID", lambda text: text.strip().strip("'").strip())
    signs = [1.0 if up else -1.0 for up in rising]
    return FanucBackup(
        model,
        tuple(counts),
        tuple(sign * scale for sign, scale in zip(signs, scales, strict=True)),
        _coupling(motn, np.degrees(scales), rising),
        _COUPLED[couple[2]],
    )


def count_change(old_folder: Path, new_folder: Path, joints: int) -> Matrix:
    """(n,) degrees by which joints read more with the new master counts than with the old ones, joint 3 from
    link 2. BadInput where the backups are of two arms."""
    old, new = (read_fanuc_backup(folder, joints) for folder in (old_folder, new_folder))
    same_gears = old.per_degree == new.per_degree and np.array_equal(old.coupling, new.coupling)
    if old.model != new.model or not same_gears:
        raise BadInput("the two backups are not of one arm", found=f"{old.model}, {new.model}")
    counts = (np.array(old.master) - np.array(new.master)) / np.array(old.per_degree)
    change = np.asarray(old.coupling @ counts)
    if old.encoder3 == "ground":
        change[2] += change[1]
    return change


def _coupling(motn: _VaFile, per_rad: Matrix, rising: Sequence[bool]) -> Matrix:
    """(n, n) what the encoders of the wrist do to the joints behind them, ones on the diagonal; by the pulses
    for a radian (n,)."""
    joints = len(rising)
    coupling = np.eye(joints)
    for i in range(joints):
        name = f"$MRR_GRP[1].$INTERACTION[{i + 1}].$INTERACTION"
        row = np.array(motn.array(name, "REAL", float, joints)) * per_rad
        row[i] = 0.0  # its size is 1; its sign is not that of the pulses
        used = [int(j) for j in np.flatnonzero(np.abs(row) > _NONE)]
        in_wrist = all(3 <= j < i and rising[i] and rising[j] for j in used)
        if not in_wrist or np.abs(row).max() > _STRONGEST:
            raise BadInput(
                "the coupling of the axes of this arm is not worked out here",
                found=f"{name}: {', '.join(f'J{j + 1} {row[j]:+.4f}' for j in used)}",
                allowed=f"joints of the wrist that drive those behind them, by less than {_STRONGEST:g}, all"
                " with $MOSIGN TRUE",
                file=motn.path,
            )
        coupling[i, used] = row[used]
    return coupling


@dataclass(frozen=True)
class _VaFile:
    """Lines of a file of system variables."""

    path: Path
    lines: Sequence[str]

    def array(self, name: str, kind: str, read: Callable[[str], _Value], count: int) -> list[_Value]:
        """The first `count` values of an array that must be whole."""
        at, rest = self._field(name)
        head = _ARRAY.fullmatch(rest)
        if head is None or head[2] != kind or int(head[1]) < count:
            raise self._damaged(at, f"ARRAY of {count} or more {kind} behind {name}")
        values: list[_Value] = []
        for number in range(1, int(head[1]) + 1):
            line = at + number
            entry = _ENTRY.fullmatch(self.lines[line]) if line < len(self.lines) else None
            if entry is None or int(entry[1]) != number:
                raise self._damaged(line, f"[{number}] = … of {name}")
            if number <= count:
                values.append(self._value(line, entry[2], read, name))
        return values

    def scalar(self, name: str, read: Callable[[str], _Value]) -> _Value:
        at, rest = self._field(name)
        value = _SCALAR.fullmatch(rest)
        if value is None:
            raise self._damaged(at, f"a value behind {name}")
        return self._value(at, value["value"], read, name)

    def _value(self, at: int, text: str, read: Callable[[str], _Value], name: str) -> _Value:
        try:
            value = read(text.strip())
            if isinstance(value, float) and not np.isfinite(value):
                raise ValueError
        except ValueError:
            raise self._damaged(at, f"a value of {name}") from None
        return value

    def _field(self, name: str) -> tuple[int, str]:
        """The line of a field, from 0, and what is behind its name."""
        places = [
            (at, field["rest"])
            for at, line in enumerate(self.lines)
            if name in line and (field := _FIELD.fullmatch(line)) is not None and field["name"] == name
        ]
        if len(places) != 1:
            raise BadInput(
                "the file of system variables is not whole",
                found=f"{name} {'twice or more' if places else 'is missing'}",
                allowed=f"{name} once",
                remedy="save the backup again, as text (.VA)",
                file=self.path,
                line=places[1][0] + 1 if places else None,
            )
        return places[0]

    def _damaged(self, at: int, allowed: str) -> BadInput:
        return BadInput(
            "the file of system variables is damaged",
            found=shown(self.lines[at].strip()) if at < len(self.lines) else "the end of the file",
            allowed=allowed,
            remedy="save the backup again, as text (.VA)",
            file=self.path,
            line=min(at, len(self.lines) - 1) + 1,
        )


def _file_of(folder: Path, *names: str) -> _VaFile:
    require_within(folder)
    if folder.is_file():
        folder = folder.parent
    if not folder.is_dir():
        raise BadInput("there is no such folder", file=folder, allowed="the folder of a backup")
    paths = sorted(path for path in folder.iterdir() if path.name.lower() in names)
    if len(paths) != 1:
        raise BadInput(
            "the backup is not understood",
            found=", ".join(path.name for path in paths) or f"no {names[0].upper()}",
            allowed=f"{names[0].upper()} once, as text",
            remedy="make a backup of all files (FILE, backup, all of above) with the .VA files",
            file=folder,
        )
    return _VaFile(paths[0], read_bytes(paths[0]).decode("latin-1").splitlines())


def _scale(text: str) -> float:
    value = float(text)
    if not FEWEST_PULSES <= value <= MOST_PULSES:
        raise ValueError
    return value


def _boolean(text: str) -> bool:
    if text not in ("TRUE", "FALSE"):
        raise ValueError
    return text == "TRUE"
