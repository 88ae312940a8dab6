"""Runs: recorded shots in a file of JSON lines, one line a shot, so that a power cut loses one at most.

The first line is the header. A last line that is torn (no JSON) is left out and reported; a bad
line anywhere else is an error, as is everything that the header does not allow. `journal` writes
such a file shot by shot.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.robot import Robot
from ..parsing.reading import (
    LARGEST_RECORDING,
    did_you_mean,
    json_line,
    json_rows,
    read_bytes,
    require_schema,
)
from ..parsing.validation import validate
from .from_arrays import (
    Laser,
    Noise,
    Probe,
    RobotArgument,
    array,
    joint_positions,
    measured_of_each,
    require_arguments,
    require_count,
    stated_header,
    target_of_each,
)
from .header import RUN_SCHEMA, Header, check_header, header_content
from .measurements import Measurements, always, completed
from .robot_file import load_robot, rebased
from .shot import (
    Shot,
    ShotRules,
    check_shots,
    check_ties,
    copied_rows,
    copies,
    shot_model,
)
from .whole_file import refuse_existing, write_whole

ENOUGH_CALIBRATED, ENOUGH_UNCALIBRATED = 4, 6
UNKNOWNS = 3  # of a target
LEFT_OUT, MADE_OF = "without measurements", "made of"  # in the provenance of such a run
REFIT = " (refit)"  # what the name of a run that was made of another one ends with


@dataclass(frozen=True, eq=False, repr=False)
class Run(Measurements):
    """A recorded run of N measurements: from a file (`read_run`) or from arrays.

    Attributes
    ----------
    header, robot, shots, lines, path, sha256, warnings
        As of all `Measurements`.
    header_line
        Where the header is in the file; None for a run that is in no file.
    """

    header_line: int | None = field(default=None, compare=False)

    @classmethod
    def from_arrays(
        cls,
        *,
        robot: RobotArgument,
        tool: Laser | Probe | None = None,
        instruments: Mapping[str, Mapping[str, Any]] | None = None,
        joints: ArrayLike,
        noise: Noise,
        unit: Literal["deg", "rad"] | None = None,
        targets: str | Sequence[str | None] | None = None,
        spots_mm: ArrayLike | None = None,
        measured: Mapping[str, Sequence[Any] | ArrayLike] | None = None,
        target_priors: Mapping[str, Mapping[str, Any]] | None = None,
        name: str = "arrays",
        **header: Any,
    ) -> Self:
        """A run of N measurements with a robot of n joints.

        Parameters
        ----------
        robot
            A built-in name, the path of a robot file, {"urdf", "base", "tip"} or a `Robot`. Of the last the
            run's text has the name only.
        tool
            The laser or probe that the flange carries, if there is one.
        instruments
            Other instruments by name, {name: {"kind": …, …}}: the key `instruments` of a file.
        joints
            (N, n) recorded joint positions, joint 1 first; those of prismatic joints in mm.
        noise
            Standard deviations of the readings.
        unit
            Of the revolute joints in `joints`: "deg" or "rad". It is required: no unit is assumed.
        targets
            N names, the target of each measurement, or one name for all. By default all are of one target:
            the only one in `target_priors`, or "psd" (of a probe "socket").
        spots_mm
            (N, 2) where the target's centre is as seen from the beam, along b1 and b2, mm. By default each
            beam is on the centre.
        measured
            What else a file has of each measurement, N values by key, None where one has none: "instrument",
            "reflector", "posture", "measured_mm" (N, 3), "measured_quat" (N, 4), "sigma_mm", "time_s".
        target_priors
            What is known of targets beforehand, {name: {"guess_mm": [x, y, z], "sigma_mm": std}}: the key
            `targets` of a file.
        name
            What reports call the run.
        **header
            The other keys of a run file's header, as they are there: prior, distances, held, limits,
            tolerance, geometry, provenance.

        Returns
        -------
        Run

        Raises
        ------
        BadInput
            Names the argument, what was found, what is allowed and what to do.

        Examples
        --------
        >>> import zerobeam as zb
        >>> run = zb.Run.from_arrays(
        ...     robot="irb1600",
        ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        ...     joints=[[10, -20, 30, 5, 40, 0], [-15, -25, 35, 0, 35, 20]],
        ...     unit="deg",
        ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        ... )
        >>> run.joints.shape, run.target_names
        ((2, 6), ('psd',))
        """
        require_arguments(cls.from_arrays, header)
        parsed, arm = stated_header(
            robot, tool, instruments, noise, target_priors, {"schema": RUN_SCHEMA, **header}
        )
        positions = joint_positions(joints, "joints", arm, unit, noun="measurement", limits=parsed.limits)
        count, spots = len(positions), None
        if spots_mm is not None:
            if not parsed.tool_kind.columns:
                raise BadInput(
                    f"a {parsed.instrument.name} has no spots", allowed="None", argument="spots_mm"
                )
            spots = array(spots_mm, "spots_mm", columns=2, meaning="dx, dy of each measurement")
            require_count("spots_mm", len(spots), count, "joints")
        others = measured_of_each(measured, count)
        model, shots = shot_model(parsed), []
        for i, target in enumerate(target_of_each(targets, parsed, count, "joints")):
            content = {"shot": i, "target": target, "joints_deg": positions[i].tolist()}
            if spots is not None:
                content["spot_mm"] = spots[i].tolist()
            try:
                shots.append(validate(model, {**others[i], **content}, file=None, line=always(None)))
            except BadInput as error:  # all else is checked already
                raise error.of_argument("measured" if others[i] else "targets") from None
        try:
            return cls.of_shots(parsed, arm, shots, name)
        except BadInput as error:
            raise error.of_argument("joints") from None

    @classmethod
    def of_shots(cls, header: Header, robot: Robot, shots: Sequence[Shot], name: str) -> Self:
        """A run that is in no file; BadInput where the shots do not suit the header or the robot."""
        warnings = check_shots(header, robot, shots, [None] * len(shots), file=None)
        text = header_text(header) + "".join(shot_text(shot) for shot in shots)
        sha256 = hashlib.sha256(text.encode("utf-8")).hexdigest()
        run = cls(header, robot, tuple(shots), (None,) * len(shots), Path(name), sha256, warnings)
        return run.without_copies()

    def without_copies(self) -> Self:
        """The same with each measurement once; `warnings` say which rows are copies of others."""
        of = copies(self.shots)
        if not of:
            return self

        def called(i: int) -> str:
            line = self.lines[i]
            return f"measurement {self.shots[i].shot}" + ("" if line is None else f" (line {line})")

        kept = [i for i in range(len(self.shots)) if i not in of]
        return replace(
            self,
            shots=tuple(self.shots[i] for i in kept),
            lines=tuple(self.lines[i] for i in kept),
            warnings=(*self.warnings, copied_rows(of, len(self.shots), called)),
        )

    @cached_property
    def sources(self) -> dict[int, str]:
        """Where each measurement is, FILE:LINE, by its number: where it was imported from, else in the run's
        file; without those that are in no file."""
        places = {}
        for shot, line in zip(self.shots, self.lines, strict=True):
            source = shot.source if line is None else shot.source or f"{self.path.name}:{line}"
            if source is not None:
                places[shot.shot] = source
        return places

    def numbers_of(self, texts: Iterable[str]) -> tuple[int, ...]:
        """The numbers of measurements that a person names: by number (4), or by FILE:LINE of the file that
        was imported or of the run; several with commas. BadInput for one that is not there."""
        of_place = {source: number for number, source in self.sources.items()}
        for shot, line in zip(self.shots, self.lines, strict=True):
            of_place.setdefault(f"{self.path.name}:{line}", shot.shot)
        numbers, chosen = {shot.shot for shot in self.shots}, []
        for text in (part.strip() for each in texts for part in each.split(",")):
            folder, _, name = text.rpartition("/")
            number = (
                int(text) if text.isdecimal() and len(text) < 10 else of_place.get(name if folder else text)
            )
            if number not in numbers:
                raise BadInput(
                    "no measurement is called so",
                    found=text,
                    allowed=f"a number ({min(numbers)} to {max(numbers)}), or FILE:LINE such as"
                    f" {next(iter(of_place))}",
                    argument="drop",
                )
            chosen.append(int(number))
        return tuple(dict.fromkeys(chosen))

    def without(self, drop: Iterable[int]) -> Self:
        """The run without the measurements of these numbers, in no file; its provenance says which."""
        gone = set(drop)
        left_out = {LEFT_OUT: ", ".join(map(str, sorted(gone)))}
        about = {**self.header.provenance, **left_out, MADE_OF: f"{self.path.name} (SHA-256 {self.sha256})"}
        header = self.header.model_copy(update={"provenance": about})
        kept = [i for i, shot in enumerate(self.shots) if shot.shot not in gone]
        name = f"{self.path.stem.removesuffix(REFIT)}{REFIT}{self.path.suffix}"
        made = type(self).of_shots(header, self.robot, [self.shots[i] for i in kept], name)
        # What the header names is beside the run's file.
        return replace(made, path=self.path.with_name(name), lines=tuple(self.lines[i] for i in kept))

    def saved(self, file: Path) -> Run:
        """The run written to a new file, and read from it: what its header names is stated relative to that.
        BadInput where there is something of that name."""
        moved = rebased(self.header.robot, self.path.parent, file.parent)
        write_run(file, self.header.model_copy(update={"robot": moved}), self.shots)
        return read_run(file)

    @property
    def _content(self) -> str:
        count = len(self.shots)
        return f"{count} measurement{'' if count == 1 else 's'} of {', '.join(self.target_names)}"

    def _write(self, path: Path, *, force: bool) -> None:
        write_run(path, self.header, self.shots, force=force)

    @cached_property
    def spots(self) -> Matrix:
        """(N, 2) mm, of a laser; zeros where a shot states no spot."""
        return np.array([shot.spot_mm or (0.0, 0.0) for shot in self.shots])

    def require_analysable(self) -> None:
        """BadInput for a run that no analysis can say anything about."""
        check_header(self.header, self.robot, file=self.path, line=always(self.header_line))
        rules = ShotRules(self.header, self.robot)
        calibrated = all(instrument.calibrated for instrument in rules.instruments.values())
        enough = ENOUGH_CALIBRATED if calibrated else ENOUGH_UNCALIBRATED
        if len(self.shots) < 2:
            tool = "a calibrated" if calibrated else "an uncalibrated"
            raise BadInput(
                "one measurement can neither determine nor test an offset",
                found="1 measurement",
                allowed=f"at least {enough} measurements with {tool} tool, in varied postures",
                remedy="record more measurements of the same target",
                file=self.path,
                line=self.lines[0],
            )
        if not np.ptp(self.joints, axis=0).any():
            raise BadInput(
                "all measurements are of one posture: no offset is identifiable",
                found=f"{len(self.shots)} measurements with equal joint positions",
                allowed=f"at least {enough} varied postures",
                remedy="record measurements in varied postures, or check which columns were imported",
                file=self.path,
                line=self.lines[0],
            )
        self._require_enough_of_each_target(rules)
        check_ties(self.header, self.target_names, file=self.path, line=self.header_line)

    def _require_enough_of_each_target(self, rules: ShotRules) -> None:
        """BadInput for a target of which no more numbers are measured than its three unknowns."""
        tied = {name for angle in self.header.angles for name in angle.between}
        of_target: dict[str, list[int]] = {name: [] for name in self.target_names}
        for i, shot in enumerate(self.shots):
            if shot.target is not None:
                of_target[shot.target].append(i)
        for name, rows in of_target.items():
            labels = [rules.label(self.shots[i].instrument) for i in rows[: UNKNOWNS + 1]]
            numbers = sum(rules.instruments[label].residual_size for label in labels)
            once = len(rows) == 1
            if not once and (numbers > UNKNOWNS or name in tied):
                continue
            near = did_you_mean(name, [other for other in self.target_names if other != name])
            how = "only once: that determines" if once else f"with {numbers} numbers: they determine"
            many = "two measurements" if once else f"{UNKNOWNS + 1} numbers"
            raise BadInput(
                f"the target {name!r} is measured {how} its position at most",
                found=", ".join(f"measurement {self.shots[i].shot}" for i in rows),
                allowed=f"at least {many} of each target",
                remedy=near or "record more measurements of it, or remove this one",
                file=self.path,
                line=self.lines[rows[0]],
            )


def read_run(path: Path | str) -> Run:
    """Read a run file (JSON lines, `zerobeam/run/1`) and check every line of it.

    A last line that is torn (a power cut) is left out, and so is a measurement whose joints and readings are
    those of an earlier one to the last digit (a copied row); `warnings` say so.

    Parameters
    ----------
    path
        The file; what it names is relative to its folder.

    Returns
    -------
    Run
        Its joint positions in radians (mm for prismatic joints).

    Raises
    ------
    BadInput
        Names the file, the line, what was found, what is allowed and what to do; there is no shot in it.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> zb.read_run(demo_runs()[0].path)
    <Run good.jsonl: 9 measurements of psd, irb1600>
    """
    path = Path(path)
    run, torn = recorded(read_bytes(path, LARGEST_RECORDING), path)
    if not run.shots:
        actual = "a header only" if torn is None else "a header and a torn line"
        raise BadInput("the run has no measurements", found=actual, file=path, remedy="record some")
    return run.without_copies()


def recorded(content: bytes, path: Path) -> tuple[Run, int | None]:
    """The run in a file's content, every line checked, and the number of its last line if that is torn.

    A run that has no shots yet passes.
    """
    rows, torn = json_rows(content, path)
    header_line, top = rows[0]
    if isinstance(top, dict) and "schema" not in top and ("shot" in top or "joints_deg" in top):
        raise BadInput(
            "the run's header is not on the first line",
            found="a measurement",
            allowed="the header first, then one measurement a line",
            file=path,
            line=header_line,
        )
    require_schema(top, RUN_SCHEMA, file=path, line=header_line)
    header = validate(Header, top, file=path, line=always(header_line))
    header = completed(header, path.parent, file=path, line=always(header_line))
    robot = load_robot(header.robot, path.parent, file=path, line=header_line)
    check_header(header, robot, file=path, line=always(header_line))
    shots, lines = [], []
    model = shot_model(header)
    for line, row in rows[1:]:
        if isinstance(row, dict) and "schema" in row:
            raise BadInput(
                "there is a second header among the measurements",
                allowed="one header, on the first line",
                remedy="keep each run in a file of its own",
                file=path,
                line=line,
            )
        shots.append(validate(model, row, file=path, line=always(line)))
        lines.append(line)
    warnings: tuple[str, ...] = () if torn is None else (_torn(torn),)
    if shots:
        warnings += check_shots(header, robot, shots, lines, file=path)
    sha256 = hashlib.sha256(content).hexdigest()
    return Run(header, robot, tuple(shots), tuple(lines), path, sha256, warnings, header_line), torn


def in_no_file(name: str) -> bool:
    """Whether the name is one of a run in memory, made from arrays or of another run: it is no file's."""
    return not Path(name).suffix or Path(name).stem.endswith(REFIT)


def made_without(name: str) -> str:
    """The name of the run that one in memory was made of."""
    path = Path(name)
    return path.with_name(f"{path.stem.removesuffix(REFIT)}{path.suffix}").as_posix()


def is_run_name(name: str) -> bool:
    """Whether the name is one of a run file, and not of a target."""
    return Path(name).suffix.casefold() == ".jsonl"


def header_of_run(path: Path) -> Header:
    """The header of a run file, without its provenance: for a plan of the same cell."""
    header = read_run(path).header.model_copy(update={"provenance": {}})
    header.model_fields_set.discard("provenance")
    return header


def _torn(line: int) -> str:
    return (
        f"line {line}, the last, is torn: the recording broke off there; the measurements before it are used"
    )


# --- writing ----------------------------------------------------------------------------------------


def header_text(header: Header) -> str:
    """The first line of a run file: the stated keys, `schema` first."""
    return json_line(header_content(header, RUN_SCHEMA))


def shot_text(shot: Shot) -> str:
    """The line of a shot in a run file, which may have a million of them: what `json_line` would write."""
    posture = "" if shot.posture is None else f',"posture":{shot.posture}'
    posture += "" if shot.again is None else f',"again":{shot.again}'
    instrument = "" if shot.instrument is None else f',"instrument":{_json_text(shot.instrument)}'
    reflector = "" if shot.reflector is None else f',"reflector":{_json_text(shot.reflector)}'
    target = "" if shot.target is None else f',"target":{_json_text(shot.target)}'
    joints = _numbers(shot.joints_deg)
    readings = "".join(f',"{column}":{_numbers(value)}' for column, value in shot.readings.items())
    sigma = "" if shot.sigma_mm is None else f',"sigma_mm":{float.__repr__(shot.sigma_mm)}'
    time = "" if shot.time_s is None else f',"time_s":{float.__repr__(shot.time_s)}'
    comment = "" if shot.comment is None else f',"comment":{_json_text(shot.comment)}'
    source = "" if shot.source is None else f',"source":{_json_text(shot.source)}'
    which = f"{posture}{instrument}{reflector}{target}"
    rest = f"{readings}{sigma}{time}{comment}{source}"
    return f'{{"shot":{shot.shot}{which},"joints_deg":{joints}{rest}}}\n'


def _numbers(values: float | Sequence[float]) -> str:
    if isinstance(values, float):
        return float.__repr__(values)
    return f"[{','.join(map(float.__repr__, values))}]"


@lru_cache(maxsize=64)
def _json_text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def write_run(path: Path | str, header: Header, shots: Iterable[Shot], *, force: bool = False) -> None:
    """A whole run at once: written to another name, then renamed; BadInput if the path exists (unless
    `force`) or the run is unsound.

    What could not be read again is not written. Paths in the header are taken relative to `path`.
    """
    path, shots = Path(path), list(shots)
    refuse_existing(path, force=force)
    robot = load_robot(header.robot, path.parent)
    check_header(header, robot, file=None, line=always(None))
    check_shots(header, robot, shots, [i + 2 for i in range(len(shots))], file=path)
    text = header_text(header) + "".join(shot_text(shot) for shot in shots)
    write_whole(path, text, force=force)
