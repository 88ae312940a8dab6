"""The conversion of a backup: each position, what a person must look at, what is refused, the new files."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ...model.arrays import Matrix
from ...model.kinematics.inverse import reach
from ...model.records import internal, it, key, record
from ...words.wording import listed
from .arm_change import ArmChange, MovedPosition, PositionFrames
from .position import (
    AT_RUN_TIME,
    BackupReading,
    DoubtfulLine,
    NotConvertible,
    PositionLanguage,
    TaughtPosition,
    What,
)
from .program_backup import Backup, reading_of

POSITIONS_SCHEMA: Final = "zerobeam/positions/1"
_STEP = 100.0  # mm
_STRETCH, _LEAP = 2.0, 60.0  # mm of a relative move in which no joint turns by so many degrees (mm)
_EXACT_MM, _EXACT_RAD = 1e-5, 1e-7  # of inverse kinematics
_MOST_NAMED = 8  # tools and frames
_UNITS = 3.0  # of the last digit: what reading back and inverting may be off, beside a near singularity


@record
class PositionRow:
    """One position as it is written, before and after."""

    file: Annotated[str, it("its path in the backup")]
    line: Annotated[int, it("of its first number, from 1")]
    name: Annotated[str, it("as its controller calls it")]
    kind: Annotated[Literal["cartesian", "joints"], it("what its numbers are")]
    tool: Annotated[str | None, it("that it is used with, null of joints or where nothing says it")]
    frame: Annotated[str | None, it("the same of its work object, base or user frame")]
    configuration: Annotated[str | None, it("that it states")]
    before: Annotated[tuple[float, ...], it("its numbers, in the units of its language")]
    after: Annotated[tuple[float, ...] | None, it("the same once converted, null where nothing is")]
    joints_deg: Annotated[
        tuple[float, ...] | None, it("of the arm there, as its readings are before", unit="deg (mm)")
    ]
    moved_mm: Annotated[float | None, it("that the arm would be off without the conversion", unit="mm")]
    uncertainty_mm: Annotated[
        float | None,
        it(
            "U (k = 2) of the TCP's place with the estimated arm, of `reach`; null where an offset that moves"
            " it is not determined by the data, assumed or excluded, and of `keep`, which keeps places"
            " whatever the calibration is worth",
            unit="mm",
        ),
    ] = None


@record
class ListedLine:
    """A line that a person must look at, and accept."""

    file: Annotated[str, it("its path in the backup")]
    line: Annotated[int, it("from 1")]
    kind: Annotated[str, it("relative, computed, elsewhere (stored), call, group")]
    sentence: Annotated[str, it("what is there")]
    text: Annotated[str, it("the line itself")]
    shift_mm: Annotated[float | None, it("by which a relative move ends elsewhere than before", unit="mm")]
    per_100_mm: Annotated[bool, it("whether the shift is for 100 mm, as the offset is not in numbers")]
    accepted: Annotated[bool, it("whether --accept names it")]


@record
class Refusal:
    """A line for which nothing is converted."""

    file: Annotated[str, it("its path in the backup")]
    line: Annotated[int, it("from 1")]
    sentence: Annotated[str, it("why")]


@record
class FrameRow:
    """A tool or frame."""

    what: Annotated[Literal["tool", "frame"], it("what it is")]
    name: Annotated[str, it("as the backup has it; empty: that which it leaves open")]
    place: Annotated[str, it("file and line that define it, or the option")]
    numbers: Annotated[
        tuple[float, ...] | None, it("its pose in the form of the language, null where not known")
    ]
    new_numbers: Annotated[
        tuple[float, ...] | None, it("the same after the conversion, where that is another")
    ]


@record
class TextEdit:
    """Bytes of a file that were replaced."""

    start: Annotated[int, it("place in the old file, bytes from 0")]
    old: Annotated[str, it("as Latin-1 text")]
    new: Annotated[str, it("the same")]


@record
class ConvertedFile:
    """A file that was converted."""

    file: Annotated[str, it("its path in the backup")]
    sha256: Annotated[str, it("of the old bytes")]
    new_sha256: Annotated[str, it("of the new bytes")]
    positions_sha256: Annotated[
        str, it("of the new numbers of all its positions, whatever else changes in it")
    ]
    edits: Annotated[tuple[TextEdit, ...], it("in the order of the old file")]


@record
class EnteredJoint:
    """By how much more a joint reads at the same place."""

    joint: Annotated[str, it("J1, J2, …; joint 3 is the angle between links 2 and 3")]
    value: Annotated[float, it("that was entered", unit="deg (mm)")]


@record(kw_only=True)
class Conversion:
    """What is in a backup, and what became of it. `content` has the new files; `single`: it is one file of a
    backup."""

    schema: Annotated[Literal["zerobeam/positions/1"], it("kind and version of the document")] = (
        POSITIONS_SCHEMA
    )
    command: Annotated[Literal["show", "keep", "reach"], it("what was done")]
    backup: Annotated[str, it("name of the file or folder")]
    language: Annotated[str, it("of its programs")]
    robot: Annotated[str | None, it("the arm")] = None
    entered: Annotated[tuple[EnteredJoint, ...], it("zeros, of keep")] = ()
    source: Annotated[str, it("where the zeros or the calibration are from")] = ""
    run_sha256: Annotated[str | None, it("of the run, if one was named")] = None
    frames: Annotated[tuple[FrameRow, ...], it("tools and frames that positions are used with")] = ()
    positions: Annotated[tuple[PositionRow, ...], it("all of them")] = ()
    listed: Annotated[tuple[ListedLine, ...], it("what a person must look at")] = ()
    refused: Annotated[tuple[Refusal, ...], it("why nothing is written")] = ()
    to_state: Annotated[tuple[str, ...], it("options that have to be stated")] = ()
    notes: Annotated[tuple[str, ...], it("sentences to be read with it")] = ()
    files: Annotated[tuple[ConvertedFile, ...], it("those that were converted")] = ()
    content: Annotated[Mapping[str, bytes], internal] = field(default_factory=dict)
    single: Annotated[bool, internal] = False

    @property
    @key("whether files were converted")
    def converted(self) -> bool:
        return bool(self.files)

    @property
    def open_lines(self) -> list[ListedLine]:
        """Lines that nobody has accepted."""
        return [line for line in self.listed if not line.accepted]

    @property
    @key("name of the position that shows most whether the conversion is right, null where there is none")
    def approach(self) -> str | None:
        moved = [row for row in self.positions if row.moved_mm is not None]
        if not moved:
            return None
        row = max(moved, key=lambda row: row.moved_mm or 0.0)
        return f"{row.name} ({row.file}, line {row.line})"


@dataclass(frozen=True)
class StatedFrames:
    """Poses of tools and frames that options state, by what they are and name ("": any that is open)."""

    old: Mapping[tuple[What, str], Matrix] = field(default_factory=dict)
    new: Mapping[tuple[What, str], Matrix] = field(default_factory=dict)
    base: Matrix | None = None


class _Frames:
    """The tools and frames of positions; what is to be stated, and what cannot be used."""

    def __init__(
        self, reading: BackupReading, language: PositionLanguage, stated_frames: StatedFrames
    ) -> None:
        self.reading, self.language, self.options = reading, language, stated_frames
        self.to_state: dict[str, None] = {}
        self.rows: dict[tuple[What, str], FrameRow] = {}

    def of(self, one: TaughtPosition) -> tuple[PositionFrames, PositionFrames] | None:
        """Those before and after; None where one is not known yet. NotConvertible where it never is."""
        base = self.options.base if self.options.base is not None else self.reading.base
        base = np.eye(4) if base is None else base
        poses = {what: self._pose(what, getattr(one, what)) for what in ("frame", "tool")}
        if None in poses.values():
            return None
        old = PositionFrames(base, poses["frame"][0], poses["tool"][0])  # type: ignore[index]
        return old, PositionFrames(base, poses["frame"][1], poses["tool"][1])  # type: ignore[index]

    def _pose(self, what: What, name: str | None) -> tuple[Matrix, Matrix] | None:
        name = "" if name is None else name
        if name == AT_RUN_TIME:
            raise NotConvertible(f"its {what} is chosen when the program runs: its routine sets several")
        defined = self.reading.frames.get((what, name))
        old = self.options.old.get((what, name))
        origin = f"--{what}"
        if old is None and defined is not None:
            origin = f"{defined.file.name}, line {defined.line}"
            old = defined.pose
            if old is None:
                raise NotConvertible(f"its {what} {name}: {defined.why} ({origin})")
        if old is None and name in self.language.null:
            old, origin = np.eye(4), "none"
        if old is None:
            old = self.options.old.get((what, ""))
        if old is None:
            label = f"{name}=" if name else ""
            self.to_state[f"--{what} {label}{self.language.form}"] = None
            self.rows[what, name] = FrameRow(what, name, "not in the backup", None, None)
            return None
        new = self.options.new.get((what, name), self.options.new.get((what, ""), old) if not name else old)
        numbers = tuple(map(float, self.language.pose_numbers(old)))
        other = None if new is old else tuple(map(float, self.language.pose_numbers(new)))
        self.rows[what, name] = FrameRow(what, name, origin, numbers, other)
        return old, new


def shown_backup(backup: Backup) -> Conversion:
    """What is in a backup: positions, tools and frames, lines to look at, lines for which it is refused."""
    frames = _Frames(backup.reading, backup.language, StatedFrames())
    refused = [Refusal(one.file.name, one.line, one.sentence) for one in backup.reading.refused]
    for one in backup.reading.positions:
        if one.kind == "cartesian":
            try:
                frames.of(one)
            except NotConvertible as error:
                refused.append(Refusal(one.file.name, one.line, f"{one.label}: {error}"))
    return Conversion(
        command="show",
        backup=backup.path.name,
        language=backup.language.name,
        frames=tuple(frames.rows[key] for key in sorted(frames.rows)),
        positions=tuple(_row(one, None) for one in backup.reading.positions),
        listed=tuple(_listed(one, frozenset(), None) for one in _in_order(backup.reading.doubtful)),
        refused=tuple(sorted(dict.fromkeys(refused), key=lambda one: (one.file, one.line))),
        to_state=tuple(frames.to_state),
        notes=tuple(_where_frames_are(backup, frames)),
        single=backup.single,
    )


def _where_frames_are(backup: Backup, frames: _Frames) -> Iterator[str]:
    """What has the tools and frames that a file alone leaves open."""
    if backup.single and frames.to_state and backup.language.frames_in:
        yield (
            f"{backup.language.frames_in} of the backup may have what is to be stated: name the folder or zip"
            " of the whole backup, or a file beside it."
        )


def _to_measure_again(backup: Backup, frames: _Frames) -> Iterator[str]:
    """Which tools and frames the arm may have measured by its old zeros, and what that does."""
    measured = {
        key
        for key, one in backup.reading.frames.items()
        if one.pose is not None and not np.allclose(one.pose, np.eye(4), atol=_EXACT_MM)
    }
    used = {key: row for key, row in frames.rows.items() if key[1] in ("", row.name)}
    measured |= {key for key, row in used.items() if row.place.startswith("--")}
    measured -= {key for key, row in used.items() if row.new_numbers is not None}
    if measured:
        named = [f"{what} {name}".rstrip() for what, name in sorted(measured, key=_tools_first)]
        yield (
            f"Measure again what this arm measured with the old zeros, of {listed(named, _MOST_NAMED)}:"
            " converted positions are right with them as they are, what is taught or calculated from now on"
            " is not. State one that was measured again by --new-tool or --new-frame: positions are then"
            " written for it. Workspaces and interference zones are not read: check them too."
        )


def _tools_first(key: tuple[What, str]) -> tuple[bool, int, str]:
    what, name = key
    return what != "tool", len(name), name


def converted_backup(
    backup: Backup,
    arm: ArmChange,
    stated_frames: StatedFrames,
    accepted: Collection[tuple[str, int]],
    about: Conversion,
) -> Conversion:
    """The backup with each position converted, or why it is not: nothing is converted in part.

    `accepted` are files and lines that a person has looked at, `about` says what is known before.
    """
    reading, frames = backup.reading, _Frames(backup.reading, backup.language, stated_frames)
    refused = [Refusal(one.file.name, one.line, one.sentence) for one in reading.refused]
    moved: dict[int, tuple[MovedPosition, PositionFrames, PositionFrames]] = {}
    none = PositionFrames(np.eye(4), np.eye(4), np.eye(4))
    in_joints = {one.name: one for one in reading.positions if one.kind == "joints"}
    for number, one in enumerate(reading.positions):
        if arm.poses_only and one.kind == "joints":
            continue
        try:
            pair = frames.of(one) if one.kind == "cartesian" else (none, none)
            if pair is not None:
                moved[number] = (arm.moved(one, *pair, in_joints.get(one.near or "")), *pair)
        except NotConvertible as error:
            refused.append(Refusal(one.file.name, one.line, f"{one.label}: {error}"))
    stay = [one for one in reading.positions if arm.poses_only and one.kind == "joints"]
    if stay and len(stay) == len(reading.positions):
        sentence = "all positions are in joints: taught on the arm, they stay, and nothing is to be corrected"
        refused.append(Refusal(stay[0].file.name, stay[0].line, sentence))
    listed = tuple(
        _listed(one, accepted, _shift(one, reading, moved, arm)) for one in _in_order(reading.doubtful)
    )
    rows = [_row(one, moved.get(number)) for number, one in enumerate(reading.positions)]
    notes = [*about.notes, *_where_frames_are(backup, frames), *_quarters(reading, moved)]
    if not arm.poses_only:
        notes += _to_measure_again(backup, frames)
    answer = replace(
        about,
        notes=tuple(notes),
        single=backup.single,
        frames=tuple(frames.rows[key] for key in sorted(frames.rows)),
        positions=tuple(rows),
        listed=listed,
        refused=tuple(sorted(dict.fromkeys(refused), key=lambda one: (one.file, one.line))),
        to_state=tuple(frames.to_state),
    )
    if refused or answer.to_state or answer.open_lines or not moved:
        return answer
    edits = _edits(backup, {number: each for number, (each, *_) in moved.items()})
    content = {name: _applied(backup.content[name], of_file) for name, of_file in edits.items()}
    unsound = _not_inverted(backup, content, arm, moved)
    if unsound:
        return replace(answer, refused=tuple(unsound))
    texts = reading_of(backup.language, {**backup.content, **content}, backup.chosen).positions
    files = tuple(
        ConvertedFile(
            name,
            hashlib.sha256(backup.content[name]).hexdigest(),
            hashlib.sha256(content[name]).hexdigest(),
            positions_sha256([one for one in texts if one.file.name == name]),
            tuple(of_file),
        )
        for name, of_file in edits.items()
    )
    return replace(answer, files=files, content=content)


def positions_sha256(positions: Sequence[TaughtPosition]) -> str:
    """Of the names and numbers of positions: the same where a controller has written a file anew."""
    text = "\n".join(f"{one.label} {' '.join(f'{value:.6g}' for value in one.values)}" for one in positions)
    return hashlib.sha256(text.encode()).hexdigest()


def _in_order(lines: Sequence[DoubtfulLine]) -> list[DoubtfulLine]:
    return sorted(dict.fromkeys(lines), key=lambda one: (one.file.name, one.line))


def _row(
    one: TaughtPosition, moved: tuple[MovedPosition, PositionFrames, PositionFrames] | None
) -> PositionRow:
    each = None if moved is None else moved[0]
    return PositionRow(
        one.file.name,
        one.line,
        one.label,
        one.kind,
        one.tool if one.kind == "cartesian" else None,
        one.frame if one.kind == "cartesian" else None,
        ", ".join(one.configuration) or None,
        one.values,
        None if each is None else each.values,
        None if each is None else tuple(each.before.tolist()),
        None if each is None else each.moved_mm,
        None if each is None else each.uncertainty_mm,
    )


def _quarters(
    reading: BackupReading, moved: Mapping[int, tuple[MovedPosition, PositionFrames, PositionFrames]]
) -> Iterator[str]:
    """Which stated configurations are written otherwise: a joint passes a quarter turn, no arm flips."""
    rows = [(reading.positions[number], each) for number, (each, *_) in moved.items()]
    changed = [
        f"{one.file.name}:{one.line} {', '.join(one.configuration)} to {', '.join(each.configuration)}"
        for one, each in rows
        if each.configuration and each.configuration != one.configuration
    ]
    if changed:
        yield (
            "A joint passes a quarter turn: its stated configuration is written otherwise, and the arm does"
            f" not flip: {listed(changed, 6)}."
        )


def _listed(
    one: DoubtfulLine, accepted: Collection[tuple[str, int]], shift: tuple[float, bool] | None
) -> ListedLine:
    text = one.file.text.split("\n")
    return ListedLine(
        one.file.name,
        one.line,
        one.kind,
        one.sentence,
        " ".join(text[one.line - 1].split())[:100] if one.line <= len(text) else "",
        None if shift is None else shift[0],
        shift is not None and shift[1],
        (one.file.name, one.line) in accepted,
    )


# Relative moves


def _shift(
    one: DoubtfulLine,
    reading: BackupReading,
    moved: Mapping[int, tuple[MovedPosition, PositionFrames, PositionFrames]],
    arm: ArmChange,
) -> tuple[float, bool] | None:
    """mm by which a relative move ends elsewhere than before, and whether that is for 100 mm: from the
    position that it starts at, or where nothing says that from the one that is converted most."""
    if one.kind != "relative":
        return None
    poses = [number for number in moved if reading.positions[number].kind == "cartesian"]
    starts = [number for number in poses if reading.positions[number].name == one.name]
    starts = starts or sorted(poses, key=lambda number: -moved[number][0].moved_mm)[:1]
    if not starts:
        return None
    steps = np.diag([_STEP] * 3) if one.offset is None else np.array([one.offset])
    every: tuple[What, ...] = ("frame", "tool") if one.axes is None else (one.axes,)
    shifts = [
        _shift_at(*moved[number], step, axes, arm) for number in starts for step in steps for axes in every
    ]
    known = [shift for shift in shifts if shift is not None]
    return (max(known), one.offset is None) if known else None


def _shift_at(
    moved: MovedPosition, old: PositionFrames, new: PositionFrames, step: Matrix, axes: What, arm: ArmChange
) -> float | None:
    robot, display = arm.robot, arm.robot.display
    by, ends = np.eye(4), []
    for joints, frames in ((moved.before, old), (moved.after, new)):
        pose = frames.pose(robot.fk(joints, "deg"))
        row = joints / display
        for share in np.linspace(0, 1, 2 + int(np.linalg.norm(step) / _STRETCH))[1:]:
            by[:3, 3] = share * step
            flange = frames.flange(by @ pose if axes == "frame" else pose @ by)
            rows, arrived = reach(robot, flange, row[None])
            if not arrived[0] or np.abs((rows[0] - row) * display).max() > _LEAP:
                return None
            row = rows[0]
        ends.append(row * display)
    try:
        meant = arm.change(ends[0])
    except NotConvertible:
        return None
    places = (robot.fk(np.array([meant, ends[1]]), "deg") @ old.tool)[:, :3, 3]
    return float(np.linalg.norm(places[0] - places[1]))


# What is written


def _edits(backup: Backup, moved: Mapping[int, MovedPosition]) -> dict[str, list[TextEdit]]:
    edits: dict[str, list[TextEdit]] = {}
    for number, each in moved.items():
        one, language = backup.reading.positions[number], backup.language
        texts = [
            _number(value, one.file.text[start:end], digits)
            for value, (start, end), digits in zip(
                each.values, one.spans, _decimals(one, language), strict=True
            )
        ]
        of_file = edits.setdefault(one.file.name, [])
        for (start, end), text in zip(one.spans, texts, strict=True):
            if text != one.file.text[start:end]:
                of_file.append(
                    _in_room(one.file.text, start, end, text)
                    if language.padded
                    else TextEdit(start, one.file.text[start:end], text)
                )
        for (start, end), text in zip(one.configuration_spans, each.configuration, strict=True):
            if text != one.file.text[start:end]:
                of_file.append(TextEdit(start, one.file.text[start:end], text))
    return {name: sorted(of_file, key=lambda edit: edit.start) for name, of_file in edits.items() if of_file}


def _number(value: float, old: str, decimals: int) -> str:
    """A number with so many decimals; the old text where that is as near."""
    if abs(float(old) - value) <= 0.5 * 10.0**-decimals:
        return old
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _in_room(text: str, start: int, end: int, new: str) -> TextEdit:
    blanks = len(text[:start]) - len(text[:start].rstrip(" ")) if text[start - 1 : start] == " " else 0
    return TextEdit(start - blanks, text[start - blanks : end], new.rjust(end - start + blanks))


def _applied(content: bytes, edits: Sequence[TextEdit]) -> bytes:
    text = content.decode("latin-1")
    for edit in reversed(edits):
        text = text[: edit.start] + edit.new + text[edit.start + len(edit.old) :]
    return text.encode("latin-1")


def _not_inverted(
    backup: Backup,
    content: Mapping[str, bytes],
    arm: ArmChange,
    moved: Mapping[int, tuple[MovedPosition, PositionFrames, PositionFrames]],
) -> list[Refusal]:
    """Positions that, read back from the new files and inverted, are not the old ones to the last digit."""
    again = reading_of(backup.language, {**backup.content, **content}, backup.chosen).positions
    before = backup.reading.positions
    if [(one.label, one.line, one.kind) for one in again] != [
        (one.label, one.line, one.kind) for one in before
    ]:
        return [Refusal(backup.path.name, 1, "read back, the new files have other positions")]
    refused = []
    for number, (each, *frames) in moved.items():
        old, new = before[number], again[number]
        decimals = _decimals(old, backup.language)
        written = np.abs(np.array(new.values) - each.values) <= 0.5001 * 10.0 ** -np.array(decimals)
        if (
            not written.all()
            or new.configuration != each.configuration
            or not _inverts(old, new, each, frames, arm)
        ):
            sentence = (
                f"{old.label}: read back and inverted, it is not as before to {_UNITS:g} units of its digits"
            )
            refused.append(Refusal(old.file.name, old.line, sentence))
    return refused


def _inverts(
    old: TaughtPosition,
    new: TaughtPosition,
    moved: MovedPosition,
    frames: Sequence[PositionFrames],
    arm: ArmChange,
) -> bool:
    """Whether a position that was written gives the old one again."""
    digits = 10.0 ** -np.array(_decimals(old, arm.language))
    if old.kind == "joints":
        joints = arm.values_of(arm.undo(arm.joints_of(new.values, new.axes)), new.axes)
        return bool((np.abs(np.array(joints) - old.values) <= _UNITS * digits).all())
    before, after = frames
    flange = after.flange(arm.language.pose(new.values))
    rows, arrived = reach(arm.robot, flange, (moved.after / arm.robot.display)[None])
    if not arrived[0]:
        return False
    inverted = before.pose(arm.robot.fk(arm.undo(rows[0] * arm.robot.display), "deg"))
    pose = arm.language.pose(old.values)
    unit = _between(pose, arm.language.pose((np.array(old.values) + digits).tolist()))
    off = _between(pose, inverted)
    return off[0] <= _UNITS * unit[0] + _EXACT_MM and off[1] <= _UNITS * unit[1] + _EXACT_RAD


def _decimals(one: TaughtPosition, language: PositionLanguage) -> tuple[int, ...]:
    return language.pose_decimals if one.kind == "cartesian" else (language.joint_decimals,) * len(one.values)


def _between(one: Matrix, other: Matrix) -> tuple[float, float]:
    """mm and rad between two poses."""
    turn = Rotation.from_matrix(one[:3, :3].T @ other[:3, :3]).magnitude()
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(turn)
