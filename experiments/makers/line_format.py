"""A format of a maker whose programs have named positions: its programs, its reader, its mark."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .maker import FormatMark, Maker, PlanProgram, PointNames, Reader

if TYPE_CHECKING:
    from ...model.files.plan import Plan
    from ...model.files.robot_file import Vendor
    from ..positions.position import JointLanguage
    from .format_options import ProgramMotion
    from .import_jobs import Imported, ImportJob, TaughtPoint

Named = Callable[[str, "list[TaughtPoint]"], "list[TaughtPoint]"]


def _as_written(text: str, points: "list[TaughtPoint]") -> "list[TaughtPoint]":
    return points


class LineParts(NamedTuple):
    """The language; `program` writes that of a plan and a motion, by the
    path of its file, as one text or as several by path. `named` gives the positions of a text names, where
    they have numbers only. `digits` are the decimals of joints that the controller saves."""

    language: "JointLanguage"
    program: Callable[..., str | Mapping[Path, str]]
    named: Named = _as_written
    digits: int = 4


@dataclass(frozen=True)
class LineFormat:
    """`program` is that of a plan: name, label, usual files, options; `reads` are the files that are read,
    `about` the help of that, `mark` a pattern of such a text with what it is. With `log` the reader also
    takes what a plan's program prints. `parts` are loaded once they are used."""

    parts: Callable[[], LineParts]
    program: tuple[str, str, tuple[str, ...], tuple[str, ...]]
    reads: str
    about: str
    mark: tuple[str, str]
    log: str | None = None

    def texts(self, plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
        """The files of a plan's program."""
        written = self.parts().program(plan, motion, file)
        return {file: written} if isinstance(written, str) else written

    def points(self, text: str, path: Path) -> "list[TaughtPoint]":
        """The positions of a text."""
        from .taught_positions import written_points

        language, _, named, _ = self.parts()
        return named(text, written_points(language, text, path))

    def reader(self) -> Callable[..., Any]:
        """Reads positions that were taught, or recorded by a plan's program."""

        def read(job: "ImportJob", points: PointNames = None) -> "Imported":
            from .joint_text import import_program_log, is_program_log
            from .taught_positions import import_taught

            if self.log is not None and points is None and is_program_log(job):
                return import_program_log(job, source=self.log)
            language, _, named, digits = self.parts()
            return import_taught(language, job, points=points, digits=digits, named=named)

        read.__doc__ = self.about
        return read

    def maker(self, name: str, vendor: "Vendor", models: str, **more: Any) -> Maker:
        """The maker that has this format, and `more`."""
        kind, label, files, options = self.program
        marks = (FormatMark(*self.mark, self.points),)
        reader = Reader(kind, self.reader(), self.reads, marks=marks, program_log=self.log is not None)
        program = PlanProgram(kind, label, files, self.texts, options)
        return Maker(name, vendor, models, program=(program,), read=(reader,), **more)
