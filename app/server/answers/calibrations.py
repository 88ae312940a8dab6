"""New calibrations: a folder with a header, and the command that makes the plan."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ....experiments.demos import example_files
from ....experiments.plans.new_calibration import (
    PLACES,
    PlaceChoice,
    PlaceKind,
    mounted_of,
    new_calibration,
    place_of,
    titles,
)
from ....model.errors import BadInput, NotWritten
from ....model.files.header import Header, RobotRef, write_header
from ....model.files.robot_file import load_robot, rebased
from ....model.files.whole_file import sync_folder, write_whole, writer
from ....model.instruments.registry import KINDS
from ....model.parsing.validation import FileModel, Name, Vector, validate
from ....model.records import it, record
from ....words.wording import capital
from ..index import Folder
from ..job_commands import job_command
from ..requests import Content, at_key, end_point, wrong
from ..versions import version_of
from .robot_library import whole_ref


@record(kw_only=True)
class CalibrationFolder:
    """The folder of a calibration, as it was made or taken back."""

    name: str


def new_path(folder: Folder, name: str) -> Path:
    """Where a folder of this name is to be made; Refused, with the key, where it is taken or cannot be."""
    with at_key("name"):
        if "/" in name or "\\" in name or name != name.strip():
            raise BadInput(
                "this is no name of one folder",
                found=name[:100],
                allowed="a name without / and \\, and without spaces at its ends",
            )
        path = folder.new(name)
        if os.path.lexists(folder.root / name):  # a link to nowhere
            raise BadInput("there is something of this name already", found=name, allowed="a free name")
        return path


@end_point("POST /api/folders", "Makes an empty folder for a calibration.")
def new_folder(
    folder: Folder,
    name: Annotated[str, it("a name without /, below the app's folder"), Field(max_length=100)],
) -> CalibrationFolder:
    """Make an empty folder."""
    path = new_path(folder, name.strip())
    try:
        path.mkdir()
    except OSError as error:
        raise NotWritten(f"the folder cannot be made: {error.strerror}", file=path) from None
    return CalibrationFolder(name=folder.called(path))


_EXAMPLE = "example"
_SEED = "--seed=0"
_AS_ASSUMED: dict[str, Vector] = {}


class PlaceOfTarget(FileModel):
    """Where the target is."""

    kind: PlaceKind = Field(description="in words, or `point`: as stated")
    point_mm: Vector | None = Field(default=None, description="with `point`: base frame, millimetres")
    facing: Vector | None = Field(
        default=None, description="outward normal of the target's face (default: as the place has it)"
    )


StatedRobot = Annotated[RobotRef, it("a built-in name, a robot file below the folder, or {urdf, base, tip}")]
StatedInstrument = Annotated[str, it("kind of the instrument")]


@record(kw_only=True)
class MadeCalibration:
    """A new calibration: its folder and header, and the words of the job that makes its plan."""

    name: str
    header: str
    version: Annotated[str, it("of the header")]
    command: list[str]


@record(kw_only=True)
class MadeExample:
    """A new calibration that has a plan, and the words of the job that simulates its run."""

    name: str
    header: str
    plan: str
    command: list[str]


@record(kw_only=True)
class InstrumentChoice:
    """A kind of instrument."""

    name: str
    words: str
    about: str
    plans: Annotated[bool, it("whether a plan can be made with the defaults")]


@record(kw_only=True)
class PlaceAt:
    """Where a place of the target is at an arm."""

    kind: PlaceKind
    at_mm: Annotated[list[float], it("base frame")]


@record(kw_only=True)
class CalibrationProposal:
    """What a new calibration assumes of an arm and an instrument."""

    places: Annotated[list[PlaceAt], it("without the one that is stated")]
    mounted: Annotated[
        dict[str, list[float]],
        it("how the instrument is on the flange, by the key of the header; empty: not asked"),
    ]


@record(kw_only=True)
class CalibrationChoices:
    """What a new calibration can be made of."""

    instruments: list[InstrumentChoice]
    places: Sequence[PlaceChoice]


@end_point("GET /api/calibrations/choices", "What a new calibration can be made of.")
@cache
def choices(_: Folder) -> CalibrationChoices:
    """Instruments and places of the target."""
    return CalibrationChoices(
        instruments=[
            InstrumentChoice(
                name=name, words=words, about=f"{capital(KINDS[name].words.method)}.", plans=True
            )
            for name, words in titles().items()
        ],
        places=PLACES,
    )


@end_point(
    "POST /api/calibrations/proposal",
    "What a new calibration assumes: where the targets are, how the instrument is mounted.",
)
def proposal(folder: Folder, robot: StatedRobot, instrument: StatedInstrument) -> CalibrationProposal:
    """Where the places are, and how the instrument is assumed to be mounted."""
    with at_key("robot"):
        arm = load_robot(whole_ref(folder, robot, folder.root), folder.root)
    with at_key("instrument"):
        mounted = mounted_of(instrument, arm)
    return CalibrationProposal(
        places=[
            PlaceAt(kind=row.kind, at_mm=list(place_of(row.kind, arm, None)))
            for row in PLACES
            if row.kind != "point"
        ],
        mounted={key: list(value) for key, value in mounted.items()},
    )


@end_point(
    "POST /api/calibrations/withdraw",
    "Takes a calibration back that has a header, as it was made, and nothing else.",
)
def withdraw(
    folder: Folder,
    name: Annotated[str, it("its folder")],
    version: Annotated[str, it("of its header, as it was made")],
) -> CalibrationFolder:
    """Take a calibration back that has a header, as it was made, and nothing else."""
    header = folder.file(f"{name}/header.yaml")
    path = header.parent
    if (
        path == folder.root
        or [entry.name for entry in path.iterdir()] != [header.name]
        or version_of(header) != version
    ):
        raise BadInput(
            "this calibration is not taken back",
            found="it has more than a header as it was made",
            remedy="delete its folder where it is not needed",
        )
    header.unlink()
    path.rmdir()
    return CalibrationFolder(name=name)


@end_point(
    "POST /api/calibrations",
    "Makes a calibration: its folder and header, and the command for its plan.",
    status=201,
)
def make(
    folder: Folder,
    name: Annotated[str, it("of the new folder")],
    robot: StatedRobot,
    instrument: StatedInstrument,
    at: Annotated[PlaceOfTarget, it("where the target is", name="place")],
    mounted: Annotated[
        dict[str, Vector],
        it(
            "how the instrument is on the flange, by the keys of /api/calibrations/proposal"
            " (default: as that assumes)"
        ),
    ] = _AS_ASSUMED,
    serial: Annotated[Name | None, it("serial number of the arm")] = None,
    measurements: Annotated[
        int | None, it("of the plan (default: as few as are enough)"), Field(ge=2, le=200)
    ] = None,
) -> MadeCalibration:
    """Make the folder of a calibration with its header, whole or not at all."""
    path = new_path(folder, name)
    with at_key("robot"):
        arm = load_robot(whole_ref(folder, robot, folder.root), folder.root)
    with at_key("place", "point_mm"):
        target = place_of(at.kind, arm, at.point_mm)
    facing = at.facing or next(row.facing for row in PLACES if row.kind == at.kind)
    if not any(facing):
        raise wrong(("place", "facing"), "this direction has no length", facing, "a direction")
    with at_key("instrument"):
        new = new_calibration(instrument, arm, target, facing, measurements, mounted)
    provenance = {} if serial is None else {"provenance": {"serial": serial}}
    ref = rebased(robot, folder.root, path)
    content: Content = {"robot": ref if isinstance(ref, str) else ref.model_dump(exclude_unset=True)}
    header = validate(Header, content | new.header | provenance, file=None, line=lambda _: None)
    with _whole(path) as part:
        write_header(part / "header.yaml", header)
    name = folder.called(path)
    words = ["plan", "optimal", f"--header={name}/header.yaml", f"--out={name}/plan.yaml", *new.options]
    return MadeCalibration(
        name=name,
        header=f"{name}/header.yaml",
        version=version_of(path / "header.yaml"),
        command=_command(folder, words),
    )


@end_point(
    "POST /api/example",
    "Makes a folder with the example's header and plan, and the command that rehearses it.",
    status=201,
)
def example(folder: Folder) -> MadeExample:
    """Make a folder with the header and the plan of the example."""
    names = (_EXAMPLE if number == 1 else f"{_EXAMPLE}-{number}" for number in count(1))
    path = next(folder.root / name for name in names if not os.path.lexists(folder.root / name))
    with _whole(path) as part:
        for file, shipped in example_files().items():
            write_whole(part / file, shipped.read_bytes())
    name = folder.called(path)
    words = ["run", "--rig=simulated", _SEED, f"--out={name}/run.jsonl", f"{name}/plan.yaml"]
    return MadeExample(
        name=name, header=f"{name}/header.yaml", plan=f"{name}/plan.yaml", command=_command(folder, words)
    )


def _command(folder: Folder, words: list[str]) -> list[str]:
    """The words, which `POST /api/jobs` takes."""
    job_command(folder, words)
    return words


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A hidden folder to write into, which gets its name at the end, if nothing went wrong."""
    part = path.with_name(f".{path.name[:100]}.{writer()}-folder.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        part.mkdir()
        yield part
        os.rename(part, path)  # refuses a folder that has something in it
        sync_folder(path.parent)
    except OSError as error:
        what = "the folder cannot be made"
        raise wrong(("name",), what, error.strerror or str(error), "a folder that can be written") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
