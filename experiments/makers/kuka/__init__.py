"""KUKA: mastering, KRL."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..maker import (
    FormatMark,
    Maker,
    OffsetFile,
    PlanProgram,
    PointNames,
    Reader,
    require_vendor,
)
from ..program_template import ProgramName, ProgramTemplate, ToolName

if TYPE_CHECKING:
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob, TaughtPoint

_ABOUT = [
    "Mastering sheet for KUKA (KRC). Master in ascending order, A1 before A2 and so on: the motor of A4",
    "moves A5 and A6 too, that of A5 moves A6. Two ways, do ONE of them:",
    "- Re-master: drive the axis to the position in the third column, as the display shows it with",
    "  the present mastering, and master it there (dial): it then shows the mastering position.",
    "- Or add the offset to $MAMES of the axis (its position at the mark) and master at the marks as",
    "  always. The sign is that of the offset: with a larger $MAMES the axis reads more.",
    "TOOL and BASE that were measured with the old mastering hold its error: measure them again.",
]


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """KUKA: a sheet for a person, the mastering offsets of the axes. Nothing is applied."""
    from ....model.kinematics.pendant import Pendant, require_link_encoder
    from ..sheets import sheet_text

    require_vendor(run.robot, "kuka", "this sheet")
    require_link_encoder(run.robot, "this sheet")
    table = [
        "axis   offset deg   master the axis where it reads      $MAMES[] (machine data)",
        *(
            f"A{i}   {offset.applied:+11.6f}   mastering position {-offset.applied:+11.6f} deg   old value"
            f" {offset.applied:+11.6f}"
            if offset.exported
            else f"A{i}   {'-':>11}   leave it as it is"
            for i, offset in enumerate(calibration.offsets, start=1)
        ),
    ]
    return sheet_text(calibration, _ABOUT, table, Pendant(run.robot))


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
    r"[A-Za-z]\w{0,23}",
    "module",
    "KRL",
    "a letter, then letters, digits and _: at most 24 (zb_plan.src)",
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
