"""Runs: recorded shots in a file of JSON lines, one line a shot, so that a power cut loses one at most.

The first line is the header. A last line that is torn (no JSON) is left out and reported; a bad
line anywhere else is an error, as is everything that the header does not allow. `journal` writes
such a file shot by shot.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from ..errors import BadInput
from ..robot import Matrix, Robot
from .header import RUN_SCHEMA, Header, TargetName, check_header, header_content
from .limits import check_limits
from .reading import Place, decode, did_you_mean, parse_json, read_bytes, shown
from .robot_file import load_robot
from .validation import FileModel, refusal, require_schema, validate
from .whole_file import refuse_existing, write_whole

ENOUGH_CALIBRATED, ENOUGH_UNCALIBRATED = 4, 6


def _joint_values(value: object) -> object:
    if not isinstance(value, list | tuple) or not value:
        raise refusal(
            "the joints are not a list of numbers", found=shown(value), allowed="[joint 1, joint 2, …]"
        )
    for i, item in enumerate(value):
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise refusal(
                f"joint {i + 1} is not a number",
                key=(i,),
                found=shown(item),
                allowed="a number (degrees; mm for a prismatic joint)",
                remedy="leave out a shot that was not fully recorded",
            )
    return tuple(value)


def _spot_values(value: object) -> object:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2:
        found = f"{len(value)} values" if isinstance(value, list | tuple) else shown(value)
        raise refusal("spot_mm is not a pair", found=found, allowed="[dx, dy], millimetres across the beam")
    return tuple(value)


JointValues = Annotated[tuple[float, ...], BeforeValidator(_joint_values)]


class Shot(FileModel):
    """One recorded shot: the joints when the beam was on the target (or the probe in its socket)."""

    shot: int = Field(ge=0, description="number of the shot, unique in its run")
    target: TargetName = Field(description="name of the target that was hit")
    joints_deg: JointValues = Field(
        description="recorded joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    spot_mm: Annotated[tuple[float, float] | None, BeforeValidator(_spot_values)] = Field(
        default=None,
        description="where the target's centre stands as seen from the beam, along b1 and b2, millimetres; "
        "without it: on the beam",
    )
    time_s: float | None = Field(default=None, description="when, seconds since the start of the run")


@dataclass(frozen=True, eq=False)
class Run:
    """A recorded run. `lines` are those of the shots, `header_line` the header's; `sha256` is the file's.

    `warnings` are sentences that a reader must see: a torn last line, joints beyond their limits.
    """

    header: Header
    robot: Robot
    shots: tuple[Shot, ...]
    lines: tuple[int, ...]
    header_line: int
    path: Path
    sha256: str
    warnings: tuple[str, ...]

    @cached_property
    def joints(self) -> Matrix:
        """(N, n) recorded joint positions, rad or mm."""
        return np.array([shot.joints_deg for shot in self.shots]) / self.robot.display

    @cached_property
    def spots(self) -> Matrix:
        """(N, 2) mm; zeros where a shot states no spot."""
        return np.array([shot.spot_mm or (0.0, 0.0) for shot in self.shots])

    @cached_property
    def has_spot(self) -> NDArray[np.bool_]:
        """(N,) True where a shot states its spot."""
        return np.array([shot.spot_mm is not None for shot in self.shots])

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """The targets in the order in which they first appear."""
        return tuple(dict.fromkeys(shot.target for shot in self.shots))

    @cached_property
    def target_index(self) -> NDArray[np.int64]:
        """(N,) index into `target_names` of each shot."""
        return np.array([self.target_names.index(shot.target) for shot in self.shots], dtype=np.int64)

    def require_analysable(self) -> None:
        """BadInput for a run that no analysis can say anything about."""
        check_header(self.header, self.robot, file=self.path, line=_always(self.header_line))
        enough = ENOUGH_CALIBRATED if self.header.tool.calibrated else ENOUGH_UNCALIBRATED
        if len(self.shots) < 2:
            tool = "a calibrated" if self.header.tool.calibrated else "an uncalibrated"
            raise BadInput(
                "a run of one shot tells nothing about the offsets",
                found="1 shot",
                allowed=f"at least {enough} shots with {tool} tool, in varied postures",
                remedy="record more shots of the same target",
                file=self.path,
                line=self.lines[0],
            )
        if not np.ptp(self.joints, axis=0).any():
            raise BadInput(
                "all shots are one and the same posture: they tell nothing but where the beam is",
                found=f"{len(self.shots)} shots with equal joint positions",
                allowed=f"at least {enough} varied postures",
                remedy="record shots in varied postures, or check which columns were imported",
                file=self.path,
                line=self.lines[0],
            )
        for name in self.target_names:
            rows = [i for i, shot in enumerate(self.shots) if shot.target == name]
            if len(rows) == 1:
                others = [other for other in self.target_names if other != name]
                near = did_you_mean(name, others)
                raise BadInput(
                    f"the target {name!r} is seen once only: one shot says nothing but where it stands",
                    found=f"shot {self.shots[rows[0]].shot}",
                    allowed="at least two shots of each target",
                    remedy=near or "record more shots of it, or take this shot out",
                    file=self.path,
                    line=self.lines[rows[0]],
                )
        check_distances(self.header, self.target_names, file=self.path, line=self.header_line)


def check_distances(header: Header, targets: Sequence[str], *, file: Path | None, line: int | None) -> None:
    """BadInput for a distance to a target that no shot has."""
    for stated in header.distances:
        for name in stated.between:
            if name not in targets:
                raise BadInput(
                    "a distance names a target that no shot has",
                    found=name,
                    allowed=", ".join(targets),
                    remedy=did_you_mean(name, targets) or "correct the name, or take the distance out",
                    file=file,
                    line=line,
                )


def unknown_targets(header: Header, targets: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each name that stands only in the header, or only in the shots."""
    if not header.targets:
        return ()
    stated = tuple(header.targets)
    sentences = [
        f"the header states target {name!r}, but no shot has it" for name in stated if name not in targets
    ]
    for name in targets:
        if name not in stated:
            near = did_you_mean(name, stated)
            sentences.append(
                f"target {name!r} is not among the header's targets ({', '.join(stated)})"
                + (f"; {near}" if near else "")
            )
    return tuple(sentences)


def check_shots(
    header: Header, robot: Robot, shots: Sequence[Shot], lines: Sequence[int], *, file: Path | None
) -> tuple[str, ...]:
    """Judge shots against their header and robot: BadInput, or the sentences that a reader must see."""
    if not shots:
        raise BadInput("the run has no shots", file=file, remedy="record some")
    first_line: dict[int, int] = {}
    for shot, line in zip(shots, lines, strict=True):
        check_shot(header, robot, shot, file=file, line=line)
        if shot.shot in first_line:
            raise BadInput(
                f"the shot number {shot.shot} stands twice",
                found=f"first on line {first_line[shot.shot]}",
                allowed="each number once",
                remedy="remove the shot that is not meant, or number it on",
                file=file,
                line=line,
            )
        first_line[shot.shot] = line
    limits = check_limits(
        robot,
        np.array([shot.joints_deg for shot in shots]),
        "shot",
        [shot.shot for shot in shots],
        lines,
        limits=header.limits,
        file=file,
    )
    return limits + unknown_targets(header, tuple(dict.fromkeys(shot.target for shot in shots)))


def check_shot(header: Header, robot: Robot, shot: Shot, *, file: Path | None, line: int | None) -> None:
    """BadInput for a shot with too few or too many joints, or with a spot that its tool cannot have."""
    if len(shot.joints_deg) != robot.n:
        raise BadInput(
            f"shot {shot.shot} has the wrong number of joints",
            found=f"{len(shot.joints_deg)} values",
            allowed=f"{robot.n} ({robot.name} has {robot.n} joints)",
            file=file,
            line=line,
        )
    if shot.spot_mm is not None and header.tool.kind == "probe":
        raise BadInput(
            f"shot {shot.shot} has a spot, but a probe makes none",
            found=f"spot_mm: {shown(shot.spot_mm)}",
            remedy="remove spot_mm, or state tool.kind: laser",
            file=file,
            line=line,
        )


def read_run(path: Path | str) -> Run:
    """A run file, every line of it checked; BadInput if there is no shot in it."""
    path = Path(path)
    run, torn = recorded(read_bytes(path), path)
    if not run.shots:
        found = "a header only" if torn is None else "a header and a torn line"
        raise BadInput("the run has no shots", found=found, file=path, remedy="record some")
    return run


def recorded(content: bytes, path: Path) -> tuple[Run, int | None]:
    """The run in a file's content, every line checked, and the number of its last line if that is torn.

    A run that has no shots yet passes.
    """
    rows, torn = _rows(content, path)
    header_line, top = rows[0]
    if isinstance(top, dict) and "schema" not in top and ("shot" in top or "joints_deg" in top):
        raise BadInput(
            "the run's header is not on the first line",
            found="a shot",
            allowed="the header first, then one shot a line",
            file=path,
            line=header_line,
        )
    require_schema(top, RUN_SCHEMA, file=path, line=header_line)
    header = validate(Header, top, file=path, line=_always(header_line))
    robot = load_robot(header.robot, path.parent, file=path, line=header_line)
    check_header(header, robot, file=path, line=_always(header_line))
    shots, lines = [], []
    for line, row in rows[1:]:
        if isinstance(row, dict) and "schema" in row:
            raise BadInput(
                "a second header stands among the shots",
                allowed="one header, on the first line",
                remedy="keep each run in a file of its own",
                file=path,
                line=line,
            )
        shots.append(validate(Shot, row, file=path, line=_always(line)))
        lines.append(line)
    warnings: tuple[str, ...] = () if torn is None else (_torn(torn),)
    if shots:
        warnings += check_shots(header, robot, shots, lines, file=path)
    sha256 = hashlib.sha256(content).hexdigest()
    return Run(header, robot, tuple(shots), tuple(lines), header_line, path, sha256, warnings), torn


def _rows(content: bytes, path: Path) -> tuple[list[tuple[int, Any]], int | None]:
    """(line, value) of every line that is not blank, and the number of the last one if that is torn."""
    raw = [(i, line) for i, line in enumerate(content.split(b"\n"), start=1) if line.strip()]
    rows: list[tuple[int, Any]] = []
    for number, line in raw:
        # A line that breaks off is never JSON, as its last brace is missing. After a power cut it may
        # also end in bytes of no meaning.
        last = number == raw[-1][0] and rows
        try:
            text = decode(line, file=path, line=number)
        except BadInput:
            if last:
                return rows, number
            if not rows and b"\0" in content:
                raise BadInput(
                    "this is a binary file, not text",
                    allowed="text in UTF-8",
                    remedy="give a run file (.jsonl)",
                    file=path,
                ) from None
            raise
        try:
            rows.append((number, parse_json(text, file=path, line=number)))
        except json.JSONDecodeError as error:
            if last:
                return rows, number
            raise BadInput(
                f"the line is not JSON: {error.msg} at character {error.pos + 1}",
                found=shown(text[:70]),
                allowed="one JSON object a line: the header, then the shots",
                remedy="remove the line if the recording broke off here"
                if rows
                else "give a run file (.jsonl)",
                file=path,
                line=number,
            ) from None
    return rows, None


def _always(line: int | None) -> Callable[[Place], int | None]:
    """All places of one line of JSON are on that line."""
    return lambda _: line


def _torn(line: int) -> str:
    return f"line {line}, the last, is torn: the recording broke off there; the shots before it are used"


# --- writing ----------------------------------------------------------------------------------------


def header_text(header: Header) -> str:
    """The first line of a run file: the stated keys, `schema` first."""
    return _json_line(header_content(header, RUN_SCHEMA))


def shot_text(shot: Shot) -> str:
    """The line of a shot in a run file."""
    return _json_line(shot.model_dump(mode="json", exclude_none=True))


def _json_line(content: dict[str, Any]) -> str:
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def write_run(path: Path | str, header: Header, shots: Iterable[Shot]) -> None:
    """A whole run at once: written aside, then renamed; BadInput if the path exists or the run is unsound.

    What could not be read again is not written. Paths in the header are taken relative to `path`.
    """
    path, shots = Path(path), list(shots)
    refuse_existing(path)
    robot = load_robot(header.robot, path.parent)
    check_header(header, robot, file=None, line=_always(None))
    check_shots(header, robot, shots, [i + 2 for i in range(len(shots))], file=path)
    write_whole(path, header_text(header) + "".join(shot_text(shot) for shot in shots))
