"""A format of a maker whose programs have named positions: its programs, its reader, its mark."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .maker import FormatMark, PointNames

if TYPE_CHECKING:
    from ...model.files.plan import Plan
    from ..positions.position import JointLanguage
    from .format_options import ProgramMotion
    from .import_jobs import Imported, ImportJob, TaughtPoint

Named = Callable[[str, "list[TaughtPoint]"], "list[TaughtPoint]"]


def _as_written(text: str, points: "list[TaughtPoint]") -> "list[TaughtPoint]":
    return points


class LineParts(NamedTuple):
    """The language, None where no positions are read; `program` writes that of a plan and a motion, by the
    path of its file, as one text or as several by path. `named` gives the positions of a text names, where
    they have numbers only. `digits` are the decimals of joints that the controller saves."""

    language: "JointLanguage | None"
    program: Callable[..., str | Mapping[Path, str]]
    named: Named = _as_written
    digits: int = 4


@dataclass(frozen=True)
class LineFormat:
    """`parts` are loaded once they are used."""

    parts: Callable[[], LineParts]

    def program(self, plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
        """The files of a plan's program."""
        written = self.parts().program(plan, motion, file)
        return {file: written} if isinstance(written, str) else written

    def mark(self, pattern: str, why: str) -> FormatMark:
        """The mark of a text in this language."""

        def points(text: str, path: Path) -> "list[TaughtPoint]":
            from .taught_positions import written_points

            language, _, named, _ = self.parts()
            assert language is not None
            return named(text, written_points(language, text, path))

        return FormatMark(pattern, why, points)

    def reader(self, about: str, *, log: str | None = None) -> Callable[..., Any]:
        """Reads positions that were taught, or recorded by a plan's program; with `log` also what that
        prints. `about` is the help."""

        def read(job: "ImportJob", points: PointNames = None) -> "Imported":
            from .joint_text import import_program_log, is_program_log
            from .taught_positions import import_taught

            if log is not None and points is None and is_program_log(job):
                return import_program_log(job, source=log)
            language, _, named, digits = self.parts()
            assert language is not None
            return import_taught(language, job, points=points, digits=digits, named=named)

        read.__doc__ = about
        return read
