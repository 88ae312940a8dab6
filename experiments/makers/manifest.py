"""What makers' manifests are made of: the plan's program and a sheet by templates, a reader of positions."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...model.errors import BadInput
from .maker import (
    FormatMark,
    OffsetFile,
    PointNames,
    Reader,
    TaughtFormat,
    TaughtPoint,
    folder_of,
    require_vendor,
)

if TYPE_CHECKING:
    from ...model.files.plan import Plan
    from ...model.files.robot_file import Vendor
    from ...model.files.run import Run
    from ..command_options import ProgramMotion
    from .calibration import RobotCalibration
    from .import_jobs import Imported, ImportJob


@dataclass(frozen=True)
class ProgramName:
    """The stem of a file is the name of `what` in a language: a `pattern`, and what that allows, in words."""

    pattern: str
    what: str
    language: str
    allowed: str
    remedy: str = "choose another name for the file"

    @classmethod
    def word(cls, what: str, language: str, most: int, usual: str) -> ProgramName:
        """A word of letters, digits and _, of at most so many; `usual` is the file that has such a name."""
        allowed = f"a letter, then letters, digits and _: at most {most} ({usual})"
        return cls(rf"[A-Za-z]\w{{0,{most - 1}}}", what, language, allowed)

    def require(self, file: Path) -> None:
        """BadInput where the stem is no such name."""
        if not re.fullmatch(self.pattern, file.stem, re.ASCII):
            raise BadInput(
                f"the file's name is that of the {self.what}, and {self.language} does not allow this one",
                found=file.stem,
                allowed=self.allowed,
                remedy=self.remedy,
            )


@dataclass(frozen=True)
class ToolName:
    """`--tool` of a language: a `pattern`, what it is and allows in words, and the tool if none is stated."""

    pattern: str
    what: str
    allowed: str
    usual: str | None = None

    def of(self, stated_tool: str | None) -> str | None:
        """The tool; BadInput where it is none of the language."""
        tool = self.usual if stated_tool is None else stated_tool.strip()
        if tool is not None and not re.fullmatch(self.pattern, tool, re.ASCII):
            raise BadInput(f"--tool is not {self.what}", found=stated_tool, allowed=self.allowed)
        return tool


def _no_more(plan: Plan, motion: ProgramMotion) -> Mapping[str, object]:
    return {}


@dataclass(frozen=True)
class ProgramTemplate:
    """Writes the program of a plan by `template`, a file in the folder of the maker, whose `vendor` is None
    where it is for robots of any: `what` it is, and the `holder` of its joints, which has room for `most`.

    `files` are the endings (or names) of several, each a block of the template. What is filled in is ASCII on
    one line, and besides as `escape` makes it; `quote` is the filter for what stands in a string or a remark.
    `more` of a plan and its motion is what the template takes beside `context_of`.
    """

    vendor: Vendor | None
    what: str
    holder: str
    most: int = 6
    _: KW_ONLY
    template: str = "program.j2"
    files: tuple[str, ...] = ()
    name: ProgramName | None = None
    tool: ToolName | None = None
    quote: Callable[[str], str] = str
    escape: Callable[[str], str] = str
    newline: str = "\n"
    more: Callable[[Plan, ProgramMotion], Mapping[str, object]] = _no_more

    def __call__(self, plan: Plan, motion: ProgramMotion, file: Path) -> Mapping[Path, str]:
        """The texts of a program by their files. BadInput for a robot of another vendor, joints that the
        language cannot hold, a name or a tool that it does not allow."""
        from .plan_programs import context_of, filled, require_axes

        if self.files and file.suffix.lower() != self.files[0]:
            files = " and ".join(f"a {each}" for each in self.files)
            raise BadInput(f"{self.what} is {files}", found=file.name, allowed=f"-o NAME{self.files[0]}")
        note = None
        if self.vendor is not None:
            note = require_vendor(plan.robot, self.vendor, self.what)
            require_axes(plan.robot, self.most, self.holder)
        if self.name is not None:
            self.name.require(file)
        tool = motion.tool if self.tool is None else self.tool.of(motion.tool)
        values = {**context_of(plan, motion, file.stem, tool, note), **self.more(plan, motion)}
        texts = filled(folder_of(self.vendor) / self.template, values, self.quote, self.escape)
        paths = [file.with_suffix(each) if each[0] == "." else file.with_name(each) for each in self.files]
        return {
            path: text.replace("\n", self.newline)
            for path, text in zip([file, *paths[1:]], texts, strict=True)
        }


def sheet_file(vendor: Vendor, about: str) -> OffsetFile:
    """The sheet of a maker by which a person changes zeros, by the template in its folder."""

    def text(run: Run, calibration: RobotCalibration) -> str:
        from .plan_programs import sheet_text

        return sheet_text(run.robot, calibration, vendor)

    text.__doc__ = about
    return OffsetFile(vendor, text)


def read_taught(
    taught: TaughtFormat, job: ImportJob, points: Sequence[str] | None = None, **how: Any
) -> Imported:
    """What a plan's program printed, else the positions of its files; `how` as of `import_taught`."""
    from .joint_text import import_program_log, is_program_log
    from .taught_positions import import_taught

    if taught.log is not None and points is None and is_program_log(job):
        return import_program_log(job, source=taught.log)
    return import_taught(taught, job, points=points, **how)


def taught_reader(
    name: str, taught: TaughtFormat, read: Callable[..., Imported] | None = None, **more: Any
) -> Reader:
    """The import of a format, by a function `read` of the maker where it has options of its own."""

    def positions(text: str, path: Path) -> list[TaughtPoint]:
        from .taught_positions import written_points

        return written_points(taught, text, path)

    def plain(job: ImportJob, points: PointNames = None) -> Imported:
        return read_taught(taught, job, points)

    read = read or plain
    read.__doc__ = taught.about
    marks = tuple(FormatMark(*mark, positions) for mark in taught.marks)
    return Reader(name, read, taught.files, marks=marks, program_log=taught.log is not None, **more)
