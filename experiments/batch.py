"""Many runs at once: which files, what they are called, what is kept of each."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from ..analysis.diagnostics.outliers import FEWEST_VALUES, outlying_values
from ..analysis.row import ParameterRow
from ..analysis.status import Verdict, known, versions
from ..model.errors import BadInput, UnsoundResult
from ..model.files.run import Run
from ..model.kinematics.robot import Robot
from ..model.parsing.reading import real_path
from ..model.records import it, key, record
from .command_options import BatchSettings
from .processes import source_hash

Outcome = Verdict | Literal["failed"]
# The gravest first.
OUTCOMES: tuple[Outcome, ...] = ("failed", "misfit", "degenerate", "weak", "pass")
OUTLIER_ALARM = 0.01  # probability of any false alarm over all arms and offsets
BATCH_SCHEMA: Literal["zerobeam/batch/1"] = "zerobeam/batch/1"


@record(repr=False)
class BatchOffset(ParameterRow):
    """An offset of a run; its standard uncertainty has the key `u`."""

    absent: ClassVar[tuple[str, ...]] = ("held",)

    std: Annotated[float | None, it("standard uncertainty", name="u")]


@record
class BatchRow:
    """One run. `outcome` is its verdict (`weak` of a pass by which nothing is to be entered), or `failed`:
    then `message` says why, and there is nothing else.

    `factor` is the root of chi-squared over its degrees of freedom, `p_value` that of the residuals by the
    stated noise (None where it is estimated); `posterior` says what became of it.
    """

    name: Annotated[str, it("of its folder")]
    file: Annotated[str, it("path of the run file, relative to the batch")]
    outcome: Annotated[
        Outcome,
        it(
            "the verdict (`weak` of a pass by which nothing is to be entered), or `failed`: then"
            " `message` says why, and there is nothing else"
        ),
    ]
    message: Annotated[
        str, it("the headline, and why nothing is to be entered by a pass; or why the run failed")
    ]
    sha256: Annotated[str | None, it("of the run")] = None
    robot: Annotated[str | None, it("its name")] = None
    serial: Annotated[str | None, it("its serial number, where the run states it")] = None
    when: Annotated[str | None, it("date of the run, where it states it")] = None
    measurements: Annotated[int | None, it("how many")] = None
    factor: Annotated[float | None, it("root of chi-squared over its degrees of freedom")] = None
    p_value: Annotated[
        float | None, it("of the residuals by the stated noise; null where that is estimated")
    ] = None
    misfit: Annotated[
        tuple[str, ...], it("criteria by which the model does not describe the measurements")
    ] = ()
    posterior: Annotated[
        str | None,
        it("`sampled`, `not converged`, `not needed`, `not sampled` or `nothing identifiable`"),
    ] = None
    offsets: Annotated[tuple[BatchOffset, ...], it("rows of its offsets")] = ()
    simulated: Annotated[bool, it("whether its provenance says that it was simulated")] = False
    contradicted: Annotated[bool, it("whether it is a pass by which nothing is to be entered")] = False
    falls_short: Annotated[
        bool,
        it("whether it is a pass of a robot that does not meet what its header requires, or may not"),
    ] = False

    def __post_init__(self) -> None:
        if self.outcome == "failed" and self.offsets:
            raise UnsoundResult(f"{self.name!r} failed, yet it has offsets")

    @property
    def worst(self) -> BatchOffset | None:
        """The offset with the largest u, of those that are measured in degrees if any is; None where one of
        them is not determined, or all are held or assumed."""
        free = [row for row in self.offsets if row.status not in ("held", "assumed")]
        if not free or not all(known(row.status) for row in free):
            return None
        angles = [row for row in free if row.unit == "deg"]
        return max(angles or free, key=lambda row: row.u or 0.0)


@record
class OutlierArm:
    """An identified offset that is an outlier among those of the other arms of its model."""

    run: Annotated[str, it("its name in the batch")]
    robot: Annotated[str, it("name of the robot")]
    serial: Annotated[str | None, it("serial number of the arm, where the run states it")]
    offset: Annotated[str, it("name of the offset")]
    unit: Annotated[str, it("of the estimate")]
    estimate: Annotated[float, it("of the offset")]
    off: Annotated[
        float,
        it("distance from the mean of the other arms of the model, in their standard deviations"),
    ]


@record(eq=False)
class Batch:
    """All runs of a batch, in the order of their files."""

    schema: Annotated[Literal["zerobeam/batch/1"], it("kind and version of the document")] = field(
        default=BATCH_SCHEMA, kw_only=True
    )
    rows: Annotated[tuple[BatchRow, ...], it("in the order of their files", name="runs")]
    settings: Annotated[BatchSettings, it("how all runs are solved")]
    versions: Annotated[Mapping[str, str], it("of Python and the libraries")]

    @cached_property
    @key("how many runs have each outcome, the gravest first", name="outcomes")
    def counts(self) -> dict[Outcome, int]:
        """How many runs have each outcome, the gravest first."""
        numbers_of = Counter(row.outcome for row in self.rows)
        return {outcome: numbers_of[outcome] for outcome in OUTCOMES}

    @property
    def passed(self) -> bool:
        """Whether every run is a pass, and every robot meets what is required of it."""
        return self.counts["pass"] == len(self.rows) and not any(row.falls_short for row in self.rows)

    @cached_property
    @key("identified offsets that are outliers among those of a model", name="odd")
    def outliers(self) -> tuple[OutlierArm, ...]:
        """Offsets that do not belong to those of the other arms of a model, the furthest first."""
        groups: dict[tuple[str, str, str], list[tuple[BatchRow, float]]] = {}
        for row in self.rows:
            for offset in row.offsets:
                if offset.status == "identified" and offset.estimate is not None and row.robot is not None:
                    key = (row.robot, offset.name, offset.unit)
                    groups.setdefault(key, []).append((row, offset.estimate))
        tested = {key: group for key, group in groups.items() if len(group) >= FEWEST_VALUES}
        rows = []
        for (robot, name, unit), group in tested.items():
            for index, off in outlying_values([value for _, value in group], OUTLIER_ALARM / len(tested)):
                row, value = group[index]
                rows.append(OutlierArm(row.name, robot, row.serial, name, unit, value, off))
        return tuple(sorted(rows, key=lambda arm: -abs(arm.off)))


@dataclass(frozen=True)
class Finished:
    """A run that is done, and by what that is recognised."""

    key: str
    row: BatchRow


def key_of(run: Run, settings: BatchSettings) -> str:
    """What a result depends on: the run's content, the arm, the settings, the program. A report shows the
    same result."""
    content = [
        [run.path.name, run.sha256],
        _arm(run.robot),
        asdict(replace(settings, report=False)),
        versions(),
        source_hash(),
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@lru_cache(maxsize=16)
def _arm(robot: Robot) -> str:
    """All numbers of an arm."""
    joints = [
        [joint.name, joint.kind, joint.fixed.tolist(), joint.axis.tolist(), joint.lower, joint.upper]
        for joint in robot.joints
    ]
    return json.dumps([robot.name, robot.vendor, robot.flange.tolist(), joints, asdict(robot.conventions)])


PATTERN = "**/*.jsonl"


def run_files(paths: Sequence[Path], pattern: str, out: Path) -> list[Path]:
    """The files that are `given`, and those in folders given that match `pattern`; each once, in the order of
    their paths. What lies in `out` is no input."""
    files: dict[Path, Path] = {}
    for path in paths:
        if not path.exists():
            raise BadInput(
                "there is no such file or folder", found=path, allowed="run files, or folders of run files"
            )
        if not path.is_dir():
            files.setdefault(real_path(path), path)
            continue
        try:
            matching = sorted(path.glob(pattern))
        except (ValueError, NotImplementedError) as error:
            raise BadInput(
                f"the pattern cannot be used: {error}",
                found=pattern,
                allowed="a pattern relative to the folders given, such as 2026-*/*.jsonl",
                argument="--glob",
            ) from None
        inside = [path for path in matching if path.is_file() and not _within(path, out)]
        for file in inside:
            files.setdefault(real_path(file), file)
        if not inside:
            raise BadInput(
                "no file in this folder matches the pattern",
                found=path,
                allowed=f"files that match {pattern}",
                remedy="name another folder, or another pattern with --glob",
            )
    return [files[path] for path in sorted(files)]


def names_of(files: Sequence[str], kept: Mapping[str, str], reserved: Collection[str]) -> dict[str, str]:
    """A name for each of `files` (paths with /): the stem; with the folders above it before it as far as
    it takes where several have that stem. No two are the same for a file system that ignores case.

    A file that has one in `kept` keeps it, so that results stay where they are.
    """
    names = {file: kept[file] for file in files if file in kept}
    taken = {name.casefold() for name in (*kept.values(), *reserved)}
    left = [file for file in files if file not in names]
    depth = 1
    while left:
        tried = {file: _name(file, depth) for file in left}
        count = Counter(name.casefold() for name in tried.values())
        again = []
        for file, name in tried.items():
            if count[name.casefold()] == 1 and name.casefold() not in taken:
                names[file] = name
            else:
                again.append(file)
        taken.update(names[file].casefold() for file in left if file in names)
        if len(again) == len(left) and all(depth >= len(file.split("/")) for file in again):
            for file in again:  # the whole paths differ in case, or where a hyphen is, alone
                number = 2
                while f"{_name(file, depth)}-{number}".casefold() in taken:
                    number += 1
                names[file] = f"{_name(file, depth)}-{number}"
                taken.add(names[file].casefold())
            again = []
        left, depth = again, depth + 1
    return names


def _name(file: str, depth: int) -> str:
    """The last `depth` parts of a path, without the ending, joined."""
    parts = [part for part in file.split("/") if part not in ("", ".", "..")]
    last, _, ending = parts[-1].rpartition(".")
    stem = last if last and ending else parts[-1]
    return "-".join((*parts[-depth:-1], stem)) if depth > 1 else stem


def _within(path: Path, folder: Path) -> bool:
    return real_path(path).is_relative_to(real_path(folder))


def shown_path(path: Path, folder: Path) -> str:
    """A path relative to a folder, with /: it moves along with both."""
    try:
        return Path(os.path.relpath(real_path(path), real_path(folder))).as_posix()
    except ValueError:  # another drive of Windows
        return real_path(path).as_posix()
