"""Makers of robots, and what is there for the controllers of each: files, programs, readers.

A folder beside this file that has a `MAKER` is a maker: its formats are in the command line without any other
entry. What a maker lacks is empty. Only what a command needs is loaded.
"""

from __future__ import annotations

import math
import pkgutil
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Protocol, TypeVar

from ...model.errors import BadInput
from ...model.options import Option, names_typed
from ...model.parsing.confinement import require_within
from ...words.controllers import POSITIONS, Takes

if TYPE_CHECKING:
    from ...model.files.robot_file import Vendor
    from ...model.files.run import Run
    from ...model.kinematics.robot import Robot
    from .import_jobs import Imported

# What a kind of file has room for: values for nominal geometry, the offsets and links of the arm, these and
# what depends on the posture, or every parameter as data.
Holds = Literal["offsets", "links", "postures", "all"]
# Of makers without a folder here: the name in small letters, words apart by one blank.
_OTHER_MODELS = r"kinova|gen ?[23]|jaco|x ?arm ?\d*|ufactory|comau|meca ?500"


PointNames = Annotated[
    Sequence[str] | None,
    Option("Points to use, by name: a,b,c (default: all).", text=names_typed, among="points"),
]
_TIMES = ("--time-column",)  # where times are a column that is stated
StillDeg = Annotated[
    float | None,
    Option(
        "Dwell: each joint within so many degrees.",
        label="Dwell: each joint within",
        needs=_TIMES,
        unit="deg",
    ),
]
StillSeconds = Annotated[
    float | None,
    Option("Dwell: for at least so many seconds.", label="Dwell: for at least", needs=_TIMES, unit="s"),
]
StillMm = Annotated[
    float | None,
    Option(
        "Dwell: each prismatic joint within so many mm.",
        label="Dwell: prismatic joints within",
        needs=_TIMES,
        unit="mm",
    ),
]
Decimal = Annotated[str, Option("Decimal sign: . or ,", label="Decimal sign")]
MarkerColumn = Annotated[
    str | None,
    Option(
        "Only dwells in which this column becomes other than 0.",
        label="Marker (trigger)",
        among="columns",
        needs=_TIMES,
    ),
]


class NamedFormat(Protocol):
    """A kind of format, as below."""

    @property
    def name(self) -> str: ...


def all_have_a_place(run: Run) -> Collection[str]:
    """The geometry parameters, by name, for which a file of links has no place: none."""
    return ()


def nothing_lacks(options: Mapping[str, Any]) -> str | None:
    """What a file lacks where an option was not stated: nothing."""
    return None


@dataclass(frozen=True)
class OffsetFile:
    """`zerobeam export NAME`: `text` makes the file of a run and its calibration; its docstring is the help,
    its other parameters are options. `as_data`: the file states every status. `schema`: the name of its
    published schema, if an editor is to complete its keys; `ending` that of its file. `no_place`: the
    geometry parameters of a run, by name, that a file of links cannot hold. `lacks` says what a file
    lacks, and what to state for it, of the options that were stated by name."""

    name: str
    text: Callable[..., str]
    holds: Holds = "offsets"
    as_data: bool = False
    schema: str | None = None
    ending: str = "txt"
    no_place: Callable[[Run], Collection[str]] = all_have_a_place
    lacks: Callable[[Mapping[str, Any]], str | None] = nothing_lacks


@dataclass(frozen=True)
class PlanProgram:
    """`zerobeam export plan NAME`: `texts` makes the files of a plan, a motion and the path that was stated.

    `label` is what people call the language; `files` are usual names of the files, the first that of `--out`:
    others of the same stem follow its name. `options` are those of the motion that the format has room for;
    `notes` are sentences on how it counts joints, by default where the pendant does not count them as the
    robot file; `overwrites` says what is lost in the controller when the program runs.
    """

    name: str
    label: str
    files: tuple[str, ...]
    texts: Callable[..., Mapping[Any, str]]
    options: tuple[str, ...]
    notes: Callable[..., str | None] | None = None
    overwrites: Callable[..., str] | None = None


@dataclass(frozen=True)
class FormatMark:
    """What tells that a text is of a format: `pattern` is in it (searched line by line), `why` says so in
    words. `points` (text, path) are the positions of the text, as an import without a robot can list them."""

    pattern: str
    why: str
    points: Callable[[str, Path], Sequence[TaughtPoint]]


@dataclass(frozen=True)
class Reader:
    """`zerobeam import NAME`: `read` makes a run of a job; its docstring is the help, its other parameters
    are options. `files` is the help of the argument, `first` are the parameters that help lists first.
    `marks` tell that a text is of this format; `program_log`: it reads lines of a plan's program."""

    name: str
    read: Callable[..., Imported]
    files: str
    first: tuple[str, ...] = ()
    hidden: bool = False
    marks: tuple[FormatMark, ...] = ()
    program_log: bool = False


@dataclass(frozen=True)
class KnownLog:
    """`zerobeam import log NAME`: `layout` is the CsvLayout of a log of so many joints. A table with these
    `columns` is such a log; without them its form does not tell that."""

    name: str
    about: str
    layout: Callable[[int], Any]
    columns: tuple[str, ...] = ()


@dataclass(frozen=True)
class Maker:
    """`name` as people write it, `vendor` as robot files do (None: for robots of any), `models` a pattern of
    the names of its robots; `live` is the rig that talks to its controllers."""

    name: str
    vendor: Vendor | None = None
    models: str = ""
    offsets: tuple[OffsetFile, ...] = ()
    program: tuple[PlanProgram, ...] = ()
    read: tuple[Reader, ...] = ()
    logs: tuple[KnownLog, ...] = ()
    live: str | None = None
    tried: str = field(default="on no controller")

    @property
    def takes(self) -> Takes:
        """What there is for its controllers, as reports say it: offsets, else programs, else a model."""
        if self.offsets:
            return "offsets"
        return "programs" if self.vendor in POSITIONS else "model"


def folder_of(vendor: Vendor | None) -> Path:
    """The folder of a maker, with its templates; None: that of formats for robots of any."""
    return Path(__file__).parent / (vendor or "generic").replace("-", "_")


@cache
def makers() -> tuple[Maker, ...]:
    """All that have a folder here."""
    package = import_module(__package__)
    folders = sorted(module.name for module in pkgutil.iter_modules(package.__path__) if module.ispkg)
    return tuple(import_module(f"{__package__}.{folder}").MAKER for folder in folders)


_Kind = TypeVar("_Kind", bound=NamedFormat)


def in_order(kinds: Sequence[_Kind], names: Sequence[str]) -> list[_Kind]:
    """Kinds as they are listed in help: those in `names` first."""
    return sorted(kinds, key=lambda kind: names.index(kind.name) if kind.name in names else len(names))


def plan_programs() -> list[tuple[PlanProgram, Vendor | None]]:
    """The programs that a plan is exported as, each with the vendor of the robots that it is for."""
    programs = {program: maker.vendor for maker in makers() for program in maker.program}
    order = in_order(list(programs), ("rapid", "urscript", "krl", "fanuc", "robodk", "ros", "csv"))
    return [(program, programs[program]) for program in order]


def vendor_of(robot: Robot) -> str | None:
    """The vendor that the robot's file states, else by its name; None where neither says one."""
    if robot.vendor is not None:
        return robot.vendor
    name = " ".join(re.findall(r"[a-z0-9]+", robot.name.lower()))
    models = {**{maker.vendor: maker.models for maker in makers() if maker.vendor}, "other": _OTHER_MODELS}
    vendors = [vendor for vendor, words in models.items() if re.search(rf"(?:^| )(?:{words})(?: |$)", name)]
    return vendors[0] if len(vendors) == 1 else None


def require_vendor(robot: Robot, vendor: Vendor, what: str, remedy: str | None = None) -> str | None:
    """BadInput where `robot` is known to be of another vendor than `what` is for, with what to do then; where
    its vendor is not known, a sentence that says what to check."""
    stated_vendor = vendor_of(robot)
    name = next(maker.name for maker in makers() if maker.vendor == vendor)
    if stated_vendor == vendor:
        return None
    if stated_vendor is None:
        return f"{what} is for robots of {name}; nothing says who made {robot.name!r}: check that"
    raise BadInput(
        f"{what} is for robots of {name}",
        found=f"{robot.name}, of {'another vendor' if stated_vendor == 'other' else stated_vendor}",
        allowed=f"a robot of {name}",
        remedy=remedy or "choose the format of this robot's controller; csv is for every robot",
    )


def file_of_backup(path: Path, name: str, holds: str = "") -> Path:
    """The file itself, or the one of this name in the folder of a backup whose text `holds` something."""
    require_within(path)
    if path.is_file():
        return path
    of_name = sorted(each for each in path.rglob("*") if each.name.lower() == name.lower() and each.is_file())
    files = [each for each in of_name if holds.encode() in each.read_bytes()]
    if len(files) != 1:
        raise BadInput(
            f"the backup has {'several' if files else 'no'} {name}",
            found=", ".join(each.relative_to(path).as_posix() for each in files) or None,
            allowed=f"{name}, or a folder with one",
            file=path,
        )
    return files[0]


def numbers_of(text: str, option: str, allowed: str, counts: Collection[int] = ()) -> list[float]:
    """Finite numbers of an option that are separated by commas, as many as one of `counts` if there are any;
    BadInput that says what is `allowed`."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values or not all(map(math.isfinite, values)) or (counts and len(values) not in counts):
        raise BadInput(f"{option} is not understood", found=text, allowed=allowed)
    return values


# Of the program's sentences; letters of names stay apart from each other as escapes.
_IN_ASCII = str.maketrans("−–×²′’‘“”\u00a0\u202f", "--x2'''\"\"  ") | str.maketrans(
    dict(zip("±°→≤≥χδ…", ("+-", " deg", "->", "<=", ">=", "chi", "delta", "..."), strict=True))
)


def one_line(text: str) -> str:
    """Text that may hold any character, as ASCII on one line; control and other characters as escapes."""
    ascii_text = text.translate(_IN_ASCII)
    return re.sub(r"[^ -~]", lambda letter: letter.group().encode("unicode_escape").decode(), ascii_text)


class TaughtPoint(NamedTuple):
    """A point of the file: degrees (mm if prismatic), or None where it is Cartesian or was not taught.

    `number` is that of the posture of a plan, where a program of zerobeam recorded the point. `unread` says
    why it is not understood, `left_out` why it is none to measure at unless it is named; `external`: it has
    other axes besides that are not at 0. `changed` is where a program overwrites it.
    """

    name: str
    joints: tuple[float, ...] | None
    line: int
    number: int | None = None
    unread: str = ""
    left_out: str = ""
    external: bool = False
    changed: str = ""


Points = Callable[[str, list[TaughtPoint]], list[TaughtPoint]]


def as_written(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a text as they are."""
    return points


@dataclass(frozen=True)
class TaughtFormat:
    """Positions in a `language` of `experiments/positions`, taught, or recorded by a plan's program.

    `files` are those that are read, `about` the help of that, `marks` patterns of such texts, each with what
    it is. With `log` the reader also takes what a plan's program prints. `named` gives the positions of a
    text the names that people call them by; `recorded` those that a plan's program has recorded the numbers
    of their postures, and leaves out the others. `declared`: those in motions are none that was recorded.
    `digits` are the decimals of joints that the controller saves, `note` says what the positions are.
    """

    language: str
    files: str
    about: str
    marks: Sequence[tuple[str, str]]
    log: str | None = None
    named: Points = as_written
    recorded: Points = as_written
    declared: bool = False
    digits: int = 4
    note: str = ""
