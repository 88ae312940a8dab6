"""KUKA: mastering, KRL."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..maker import FormatMark, Maker, OffsetFile, PlanProgram, PointNames, Reader
from ..program_template import ProgramName, ProgramTemplate, ToolName

if TYPE_CHECKING:
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob, TaughtPoint


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """KUKA: a sheet for a person, the mastering offsets of the axes. Nothing is applied."""
    from ..sheets import sheet_text

    return sheet_text(run.robot, calibration, "kuka")


def _read_krl(job: "ImportJob", points: PointNames = None) -> "Imported":
    """KUKA: axis positions (AXIS, E6AXIS) of a data list, taught or recorded by a plan's program."""
    from .krl_points import import_kuka

    return import_kuka(job, points=points)


def _points(text: str, path: Path) -> "Sequence[TaughtPoint]":
    from .krl_points import kuka_positions

    return kuka_positions(text, path)


_MARK = FormatMark(
    r"^[ \t]*DEFDAT\b|\b\w+(?:\[\d+\])?\s*=\s*\{\s*(?:\w+\s*:)?\s*(?:A\d|X)\s",
    "its positions in KRL",
    _points,
)
_NAME = ProgramName(
    r"[A-Za-z]\w{0,23}", "module", "KRL", "a letter, then letters, digits and _: at most 24 (zb_plan.src)"
)
_PROGRAM = ProgramTemplate(
    "kuka",
    "a KRL program",
    "a KRL AXIS",
    files=(".src", ".dat"),
    name=_NAME,
    tool=ToolName(r"0*([1-9]|[1-5]\d|6[0-4])", "a tool number of KRL", "1 to 64"),
)
MAKER = Maker(
    "KUKA",
    "kuka",
    r"kuka|kr ?\d+\w*|lbr|iiwa ?\d*",
    offsets=(OffsetFile("kuka", _sheet),),
    program=(
        PlanProgram("krl", "KRL (KUKA)", ("zb_plan.src", "zb_plan.dat"), _PROGRAM, ("speed", "zone", "tool")),
    ),
    read=(
        Reader("krl", _read_krl, "Data lists (.dat).", marks=(_MARK,)),
        Reader("kuka", _read_krl, "Data lists (.dat).", hidden=True),
    ),
    live="kuka://HOST",
)
