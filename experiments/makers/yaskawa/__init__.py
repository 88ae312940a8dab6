"""Yaskawa: INFORM jobs, a sheet for the home position."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..line_format import LineFormat, LineParts
from ..maker import OffsetFile, require_vendor
from ..program_template import ProgramName, ProgramTemplate, ToolName

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..format_options import ProgramMotion
    from ..import_jobs import TaughtPoint

_ABOUT = [
    "Home position sheet for Yaskawa. At the home position an axis reads 0 pulses.",
    "Move the axis (joint coordinates) until the pendant shows the reading in the third column: there the",
    "axis is truly at zero. Register this as its home position, of this axis alone. It then reads 0.",
    "confirm: main menu ROBOT, HOME POSITION, select the axis, YES to the question; it needs the security",
    "mode MANAGEMENT. Check names and steps against the maintenance manual of your controller.",
    "confirm: the controller then wants its second home position (specified point) checked and set again.",
    "confirm: the absolute data that are shown there are those to write down. This sheet does not say what",
    "to type in their place: how they count is not published.",
    "Tools and user frames that were measured with the old home position hold its error: measure them again.",
]


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """Yaskawa: a sheet for a person, where each axis has its home position. Nothing is applied."""
    from ....model.kinematics.pendant import Pendant, require_link_encoder
    from ..sheets import sheet_text

    require_vendor(run.robot, "yaskawa", "this sheet")
    require_link_encoder(run.robot, "this sheet")
    pendant, pulses = Pendant(run.robot), run.robot.conventions.pulses_per_deg
    table = ["axis   offset deg   register the home position where it reads"]
    for i, offset in enumerate(calibration.offsets):
        reading = f"{-offset.applied:+11.6f} deg"
        if pulses is not None:
            reading += f" = {round(-offset.applied * pulses[i]):+d} pulses"
        row = f"{offset.applied:+11.6f}   {reading}" if offset.exported else f"{'-':>11}   leave it as it is"
        table.append(f"{pendant.names[i]:4}   {row}")
    return sheet_text(calibration, _ABOUT, table, pendant)


def _parts() -> LineParts:
    from ...positions.position_languages import INFORM

    return LineParts(INFORM, _PROGRAM, _named, digits=0)


_LABELLED = re.compile(
    r"^[ \t]*'(zb_(?:p\d+|v\d+_\d+))\b[^\n]*\n[ \t]*MOVJ (C\d+)", re.MULTILINE | re.IGNORECASE
)


def _named(text: str, points: "list[TaughtPoint]") -> "list[TaughtPoint]":
    """The positions of a job, those of a plan's program by the names in its remarks."""
    from ..taught_positions import named_by_remarks

    labels = [(match[1].lower(), match[2].upper()) for match in _LABELLED.finditer(text)]
    if not labels and "zerobeam plan" not in text:
        return points
    points = [point._replace(name=point.name.upper()) for point in points]
    return named_by_remarks(points, labels, sorted({point.name for point in points}), "inform")


def _pulses(plan: "Plan", motion: "ProgramMotion") -> Mapping[str, object]:
    from ....model.kinematics.pendant import Pendant

    return {"per_degree": Pendant(plan.robot).per_degree("pulse").tolist()}


_NAME = ProgramName(
    r"[A-Za-z][\w-]{0,7}",
    "job",
    "INFORM",
    "a letter, then letters, digits, _ and -: at most 8 (ZB_PLAN.JBI)",
)
_PROGRAM = ProgramTemplate(
    "yaskawa",
    "an INFORM job",
    "a job's position",
    name=_NAME,
    tool=ToolName(r"\d{1,2}", "the number of a tool file", "0 to 63", "0"),
    newline="\r\n",
    more=_pulses,
)
_FORMAT = LineFormat(
    _parts,
    ("inform", "INFORM (Yaskawa)", ("ZB_PLAN.JBI",), ("speed", "tool")),
    "Saved jobs (.JBI).",
    "Yaskawa: positions in pulses of a saved job, taught, or modified in a plan's program.",
    (r"^/JOB\b", "its line /JOB, as of an INFORM job"),
)
MAKER = _FORMAT.maker(
    "Yaskawa",
    "yaskawa",
    r"motoman|yaskawa|gp ?\d+\w*",
    offsets=(OffsetFile("yaskawa", _sheet),),
    live="yaskawa://HOST",
)
