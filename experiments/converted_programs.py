"""Taught programs of an arm: what is in a backup, its positions converted by the zeros that were entered, and
put back by the audit."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.robot_file import load_robot
from ..model.files.run import Run, read_run
from ..model.kinematics.orientation import stated_numbers
from ..model.kinematics.pendant import Pendant, pendant_of, require_link_encoder
from ..model.kinematics.robot import Robot
from ..model.parsing.confinement import require_within
from ..model.parsing.reading import read_bytes
from ..model.records import read
from ..words.provenance import is_simulated
from ..words.wording import listed
from .command_options import BackupOptions, ReachOptions, ZeroOptions
from .makers.abb.moc_offsets import Gears, reading_change
from .makers.calibration import RobotCalibration, calibration, require_nominal_arm
from .makers.fanuc.backup import count_change
from .makers.kuka.machine_data import mames_change
from .makers.maker import require_vendor, vendor_of
from .makers.universal_robots.kinematics import require_factory_arm
from .positions.arm_change import ArmChange, kept, reached, up_to_flange
from .positions.conversion import (
    POSITIONS_SCHEMA,
    Conversion,
    EnteredJoint,
    StatedFrames,
    TextEdit,
    converted_backup,
    positions_sha256,
    shown_backup,
)
from .positions.position import PositionLanguage, What
from .positions.program_backup import AUDIT, Backup, read_backup
from .validated_solution import NotValidated


def read_audit(path: Path) -> Conversion:
    """The audit.json of a conversion. BadInput where it is damaged: what was converted is not known then."""
    try:
        return read(Conversion, read_bytes(path))
    except ValueError as error:
        raise BadInput(
            "this is no audit of a conversion, or not all of it",
            found=str(error),
            allowed=f"{AUDIT} as positions keep or reach wrote it",
            remedy="copy it again from where it is whole; without it take the old files from the backup that"
            " was converted. Move it elsewhere only if no file here was converted",
            file=path,
        ) from None


def require_not_converted(backup: Backup, *folders: Path) -> None:
    """BadInput where a file of the backup, or all of its positions, are those that a conversion has written
    whose audit is in one of the folders, or in a folder beside."""
    by_file = {
        name: positions_sha256([one for one in backup.reading.positions if one.file.name == name])
        for name in {one.file.name for one in backup.reading.positions}
    }
    hashes = {hashlib.sha256(each).hexdigest(): name for name, each in backup.content.items()}
    for path in _audits(*folders):
        audit = read_audit(path)
        for one in audit.files:
            name = hashes.get(one.new_sha256) or next(
                (name for name, each in by_file.items() if each == one.positions_sha256), None
            )
            if name is not None:
                raise BadInput(
                    "this backup was converted before: its positions would move a second time",
                    found=f"{name}, as {path} says ({audit.command}, {audit.source})",
                    allowed="the backup as it was before",
                    remedy=f"zerobeam positions restore {path.parent} -o FOLDER puts it back",
                    file=backup.path,
                )


def _audits(*folders: Path) -> Iterator[Path]:
    looked = {folder.resolve() for folder in folders if folder.is_dir()}
    for folder in sorted(looked):
        beside = [each for each in folder.iterdir() if each.is_dir() and each.name[0] != "."]
        for each_folder in [folder, *sorted(beside)]:  # hidden: one that is just being written
            path = each_folder / AUDIT
            if path.is_file() and POSITIONS_SCHEMA.encode() in path.read_bytes()[:200]:
                yield path


def restored(folder: Path) -> dict[str, bytes]:
    """The old bytes of all files that a conversion wrote to a folder (or that of its audit.json), by their
    paths.

    BadInput where one of them is no longer as it was written.
    """
    require_within(folder)
    folder = folder.parent if folder.name == AUDIT and not folder.is_dir() else folder
    if not (folder / AUDIT).is_file():
        raise BadInput(
            "there is no conversion here",
            found=f"no {AUDIT} in it" if folder.is_dir() else "no such folder",
            allowed=f"the folder that positions keep or reach wrote, with its {AUDIT}",
            remedy="name that folder, not the backup; or take the old files from the backup",
            file=folder,
        )
    audit, content = read_audit(folder / AUDIT), {}
    for one in audit.files:
        new = read_bytes(folder / one.file) if (folder / one.file).is_file() else b""
        if hashlib.sha256(new).hexdigest() != one.new_sha256:
            raise BadInput(
                "the file was changed after the conversion, or is missing: the old one does not follow",
                remedy="take it from the backup that was converted",
                file=folder / one.file,
            )
        old = _undone(new, one.edits)
        if hashlib.sha256(old).hexdigest() != one.sha256:
            raise BadInput(
                "the audit does not give the old file",
                found=one.file,
                remedy="take it from the backup that was converted",
                file=folder / AUDIT,
            )
        content[one.file] = old
    return content


def _undone(content: bytes, edits: tuple[TextEdit, ...]) -> bytes:
    text = content.decode("latin-1")
    for edit in edits:
        start = edit.start
        text = text[:start] + edit.old + text[start + len(edit.new) :]
    return text.encode("latin-1")


MOST_DEG = 5.0  # more is another posture, or another unit


def typed_zeros(text: str, robot: Robot) -> Matrix:
    """(n,) degrees (mm) of `J2=-0.265,J3=…`; joints that are not named are 0.

    BadInput for a joint that is not there, or named twice, and for no zero at all.
    """
    values: dict[int, float] = {}
    for part in re.split(r"[,;\s]+", text.strip()):
        match = re.fullmatch(r"[JA]?(\d+)=([-+]?(?:\d+\.?\d*|\.\d+))", part, re.IGNORECASE)
        number = int(match[1]) if match else 0
        if match is None or not 1 <= number <= robot.n or number in values:
            raise BadInput(
                "--entered is not understood",
                found=part,
                allowed=f"J1=… to J{robot.n}=…, each once, in degrees (mm), as J2=-0.265,J3=0.112",
            )
        values[number] = float(match[2])
    entered = np.array([values.get(i, 0.0) for i in range(1, robot.n + 1)])
    return require_zeros(entered)


def require_zeros(entered: Matrix) -> Matrix:
    """BadInput where the change is none, or no change of zeros."""
    if not entered.any():
        raise BadInput("no zero was changed, so that no position has to be", found="0 for all joints")
    if np.abs(entered).max() > MOST_DEG:
        raise BadInput(
            "these are no changes of zeros",
            found=f"{np.abs(entered).max():g} deg (mm)",
            allowed=f"up to {MOST_DEG:g} deg (mm): after more, the arm has to be taught again",
            remedy="state by how much more each joint reads at the same place, in degrees (mm)",
        )
    return entered


_MOST_NAMED = 6  # lines in an error
_LINES = re.compile(r"(?P<file>.+):(?P<first>\d+)(?:-(?P<last>\d+))?")
_ROBROOT = (
    "The arm's base is taken to be at 0 of the world: the backup does not say where it is (--base, if it is"
    " elsewhere)."
)


def shown_programs(path: Path, vendor: str | None = None) -> Conversion:
    """What is in the backup at `path`; nothing is converted."""
    return shown_backup(read_backup(path, vendor))


def kept_programs(
    path: Path, zeros: ZeroOptions, choices: BackupOptions, out: Path | None = None
) -> Conversion:
    """The backup for an arm whose zeros were entered: its positions keep their places. BadInput where they
    are those of a simulated run."""
    stated_ways = [
        bool(zeros.entered),
        zeros.run is not None,
        zeros.old_mastering is not None or zeros.new_mastering is not None,
    ]
    if sum(stated_ways) != 1:
        raise BadInput(
            "which zeros were entered?" if not any(stated_ways) else "the zeros are stated more than once",
            allowed="one of --entered J2=…,J3=…, --run RUN, --old-mastering and --new-mastering",
        )
    run, judged = None if zeros.run is None else read_run(zeros.run), None
    notes: tuple[str, ...] = ()
    robot = _robot(zeros.robot, run)
    if run is not None:
        _require_measured(run)
        judged = calibration(run)
        entered = np.array([one.applied if one.exported else 0.0 for one in judged.offsets])
        source = f"the values to enter of {run.path.name}"
    elif zeros.entered:
        entered, source = typed_zeros(",".join(zeros.entered), robot), "--entered"
    else:
        entered, notes = _mastered(zeros, robot)
        source = "mastering before and after"
    require_zeros(entered)
    change, undo = kept(entered)
    about = _about("keep", robot, run, source)
    joints = tuple(EnteredJoint(f"J{i}", float(value)) for i, value in enumerate(entered, start=1) if value)
    about = replace(about, entered=joints, notes=notes)
    return _converted(path, robot, run, choices, lambda arm: (change, undo), about, out, judged)


def reached_programs(
    path: Path, run: Path, choices: BackupOptions, options: ReachOptions, out: Path | None = None
) -> Conversion:
    """The backup with calculated poses for the true arm of a run: nothing was entered.

    The run is judged as by `export`. Besides, NotValidated where it has a misfit, whatever is allowed;
    BadInput where it is simulated, as no program can say so, and where an offset is as good as what is
    assumed, unless `options` allow or exclude it.
    """
    recorded = read_run(run)
    _require_measured(recorded)
    if vendor_of(recorded.robot) == "universal-robots":
        require_factory_arm(recorded.header.robot, recorded.path.parent)
    how = {**vars(options)}
    held_out = how.pop("hold_out")
    held_out_run = None if held_out is None else read_run(held_out)
    try:
        judged = calibration(recorded, **how, held_out=held_out_run, holds="postures")
    except NotValidated as error:
        raise NotValidated(
            error.what,
            found=error.found,
            allowed="a run that the model describes: the poses move a robot",
            remedy="look for the cause with zerobeam report, or record again",
            file=run,
        ) from None
    assumed = [
        one for one in judged.offsets if one.status == "assumed" and not (one.exported or one.left_out)
    ]
    if assumed:
        raise BadInput(
            f"{listed([one.name for one in assumed])} is not known, and turns the true arm's flange",
            found="; ".join(one.sentence for one in assumed),
            remedy="state how well tool and instruments are known; or --allow-assumed; or exclude by name: "
            + " ".join(f"--without {one.name}" for one in assumed),
            file=run,
        )

    def changes(nominal: Robot) -> tuple[Callable[[Matrix], Matrix], Callable[[Matrix], Matrix]]:
        offsets = np.array([one.applied_rad for one in judged.offsets])
        true = up_to_flange(judged.corrected, recorded.robot)
        return reached(nominal, true, offsets, judged.posture_offsets)

    about = _about("reach", recorded.robot, recorded, f"the calibration of {recorded.path.name}")
    about = replace(about, notes=(*_uncorrected(judged), *(one.sentence for one in judged.offsets)))
    return _converted(path, recorded.robot, recorded, choices, changes, about, out, judged)


def _require_measured(run: Run) -> None:
    """BadInput where a run is simulated: no program can say so."""
    if is_simulated(run.header.provenance):
        raise BadInput(
            "the run is simulated: no robot was measured, and the positions of none are corrected by it",
            remedy="name the run of the robot that this backup is of",
            file=run.path,
        )


def _uncorrected(judged: RobotCalibration) -> list[str]:
    """What a joint that stays as it is leaves of each pose."""
    stay = [number for number, one in enumerate(judged.offsets, start=1) if not one.exported]
    holds = {
        1: ", unless their frames were measured by it",
        6: ", unless their tools were measured on it",
    }
    return [
        f"Joint {number} is not corrected: the arm's poses stay off by its error{holds.get(number, '')}."
        for number in stay
    ]


def _robot(name: str | None, run: Run | None) -> Robot:
    if (name is None) == (run is None):
        raise BadInput(
            "which arm is it?" if name is None else "--run names the arm already",
            allowed="--robot NAME or FILE with --entered or mastering; --run RUN alone",
        )
    if run is not None:
        robot, ref, folder = run.robot, run.header.robot, run.path.parent
    else:
        assert name is not None
        robot, ref, folder = load_robot(name), name, Path()
    require_nominal_arm(ref, folder)
    if vendor_of(robot) == "universal-robots":
        require_factory_arm(ref, folder)
    return robot


def _about(command: Literal["keep", "reach"], robot: Robot, run: Run | None, source: str) -> Conversion:
    return Conversion(
        command=command,
        backup="",
        language="",
        robot=robot.name,
        source=source,
        run_sha256=None if run is None else run.sha256,
    )


_MASTERED = (
    "By $MAMES, which an axis takes when it is mastered at its mark: this is right where all axes whose value"
    " changed, and those of the wrist behind them, were mastered so since, and no other axis was."
)
_CALIBRATED = (
    "By cal_offset, sign and ratio, for gears that are not coupled. Compare with the pendant before anything"
    " moves: at the same place each joint must read more by what was entered, and all others as before."
)


def _mastered(zeros: ZeroOptions, robot: Robot) -> tuple[Matrix, tuple[str, ...]]:
    """(n,) degrees by which joints read more with the new mastering than with the old one, and what that
    takes for granted."""
    old, new, vendor = zeros.old_mastering, zeros.new_mastering, vendor_of(robot)
    if old is None or new is None:
        raise BadInput("one of two masterings is missing", allowed="--old-mastering and --new-mastering")
    if vendor in ("kuka", "abb"):
        require_link_encoder(robot, "a mastering before and after")
    if vendor == "kuka":
        return mames_change(old, new, robot.n), (_MASTERED,)
    if vendor == "abb":
        gears = Gears.of_options(zeros.ratio, zeros.motor_sign, robot.n)
        return reading_change(old, new, gears, robot.n), (_CALIBRATED,)
    if vendor in (None, "fanuc"):
        return count_change(old, new, robot.n), ()
    raise BadInput(
        "no published file of this maker says how the robot is mastered",
        found=robot.name,
        allowed="masterings of FANUC, KUKA, ABB",
        remedy="state --entered: by how much more each joint reads at the same place",
    )


def _converted(
    path: Path,
    robot: Robot,
    run: Run | None,
    choices: BackupOptions,
    changes: Callable[[Robot], tuple[Callable[[Matrix], Matrix], Callable[[Matrix], Matrix]]],
    about: Conversion,
    out: Path | None,
    judged: RobotCalibration | None = None,
) -> Conversion:
    uncertainty = None
    if judged is not None and about.command == "reach":
        behind = np.linalg.solve(robot.flange, up_to_flange(robot, robot).flange)[:3, 3]
        of_flange = judged.place_uncertainty

        def uncertainty(joints: Matrix, points: Matrix) -> Matrix:
            return of_flange(joints, points + behind)

    backup = read_backup(path, vendor_of(robot))
    language = backup.language
    vendor = require_vendor(
        robot, language.vendor, f"a backup in {language.name}", "name the arm of this backup"
    )
    folder = path if path.is_dir() else path.parent
    beside = [] if out is None else [out.parent, out]
    require_not_converted(backup, folder, folder.parent, *beside)
    _require_this_model(backup, robot)
    nominal = up_to_flange(robot, robot)
    pendant = pendant_of(robot, choices.j3, "fanuc") if language.vendor == "fanuc" else Pendant(robot)
    near = None
    if choices.near is not None:
        near = pendant.between_links(np.array(stated_numbers(choices.near, robot.n, "--near", "J1,J2,…")))
    change, undo = changes(nominal)
    arm = ArmChange(nominal, language, pendant, change, undo, near, about.command == "reach", uncertainty)
    frames = StatedFrames(
        _poses(choices.tools, choices.frames, "", language),
        _poses(choices.new_tools, choices.new_frames, "new-", language),
        None if choices.base is None else _pose(choices.base, "--base", language)[1],
    )
    notes = [*about.notes, *(note for note in (vendor, pendant.counting) if note)]
    if pendant.ground and about.command == "keep":
        more = float(pendant.counted(change(np.zeros(robot.n)))[2])
        notes.append(
            f"The pendant counts joint 3 from the ground: at the same place it shows J3 {more:+.4f}."
        )
    poses = any(one.kind == "cartesian" for one in backup.reading.positions)
    if poses and frames.base is None and backup.reading.base is None:
        notes.append(_ROBROOT)
    if judged is not None:
        notes += judged.warnings
    about = replace(about, backup=path.name, language=language.name, notes=tuple(notes))
    accepted = _accepted(choices.accept)
    lines_of_all = set[tuple[str, int]]().union(*accepted.values())
    answer = converted_backup(backup, arm, frames, lines_of_all, about)
    listed = {(one.file, one.line) for one in answer.listed}
    for text, lines in accepted.items():
        if listed.isdisjoint(lines) and not answer.refused:  # else the table is not whole
            raise BadInput(
                "--accept names no line that is to be looked at",
                found=text,
                allowed=", ".join(f"{file}:{line}" for file, line in sorted(listed)[:_MOST_NAMED])
                or "nothing: there is no such line",
                remedy="leave it out, or name the line that the table lists (the same command without it)",
            )
    return answer


def _require_this_model(backup: Backup, robot: Robot) -> None:
    """BadInput where the backup is of another model: where neither name has the other in it."""
    if backup.reading.model is None:
        return
    file, line, model = backup.reading.model
    one, other = (re.sub(r"[^a-z0-9]", "", name.lower()) for name in (model, robot.name))
    if one not in other and other not in one:
        raise BadInput(
            "the backup is of another model",
            found=f"{model}; the arm is {robot.name}",
            remedy="name the arm of this backup; if it is this one, give its robot file that name (name: …)",
            file=file.name,
            line=line,
        )


def _poses(
    tools: Sequence[str], frames: Sequence[str], word: str, language: PositionLanguage
) -> dict[tuple[What, str], Matrix]:
    poses: dict[tuple[What, str], Matrix] = {}
    kinds: tuple[tuple[What, Sequence[str]], ...] = (("tool", tools), ("frame", frames))
    for what, texts in kinds:
        for text in texts:
            name, pose = _pose(text, f"--{word}{what}", language)
            poses[what, name] = pose
    return poses


def _pose(text: str, option: str, language: PositionLanguage) -> tuple[str, Matrix]:
    name, _, values = text.rpartition("=")
    count = language.form.split(" ")[0].count(",") + 1
    name = name.strip() if language.case_sensitive else name.strip().lower()
    return name, language.pose(stated_numbers(values, count, option, f"[NAME=]{language.form}"))


def _accepted(texts: Sequence[str]) -> dict[str, set[tuple[str, int]]]:
    """The files and lines of each text of --accept."""
    lines: dict[str, set[tuple[str, int]]] = {}
    for text in (part.strip() for each in texts for part in each.split(",")):
        match = _LINES.fullmatch(text)
        if match is None:
            raise BadInput("--accept is not understood", found=text, allowed="FILE:LINE or FILE:FIRST-LAST")
        first, last = int(match["first"]), int(match["last"] or match["first"])
        lines[text] = {(match["file"], line) for line in range(first, min(last, first + 100_000) + 1)}
    return lines
