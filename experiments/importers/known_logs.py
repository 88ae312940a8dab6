"""Logs over time whose layout is known: who writes them, their columns and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from ...model.errors import BadInput
from .csv_file import CsvLayout, import_layout
from .dwells import Stillness
from .imported import Imported, Job

LogKind = Literal["ur", "egm", "robodk"]


def _ur(joints: int) -> CsvLayout:
    """Universal Robots, `record.py` of the RTDE client: blanks between values, q in rad, time in s."""
    columns = tuple(f"actual_q_{i}" for i in range(joints))
    return CsvLayout(
        "rad", header_row=True, columns=columns, delimiter=" ", time_column="timestamp", time_units="s"
    )


def _egm(joints: int) -> CsvLayout:
    """ABB EGM as logged by abb_libegm (EGMLogger): degrees, the controller's time in ms (egm.proto: tm).

    Six significant digits: angles beyond 100 degrees are cut to 0.001.
    """
    columns = tuple(f"R_FB_POS_RJ{i + 1}" for i in range(joints))
    return CsvLayout("deg", header_row=True, columns=columns, time_column="TIMESTAMP", time_units="ms")


def _robodk(joints: int) -> CsvLayout:
    """RoboDK's macro MonitorJoints: joints in degrees, then seconds, no header, a row where they changed."""
    columns = tuple(str(i + 1) for i in range(joints))
    return CsvLayout("deg", columns=columns, time_column=str(joints + 1), time_units="s", changes_only=True)


_LAYOUTS: Mapping[str, Callable[[int], CsvLayout]] = {"ur": _ur, "egm": _egm, "robodk": _robodk}


def import_log(
    kind: LogKind,
    files: Sequence[Path | str],
    target_names: Sequence[str],
    header_path: Path | str,
    out: Path | str,
    *,
    still: Stillness,
    delimiter: str | None = None,
    marker_column: str | None = None,
) -> Imported:
    """Shots from logs of one kind: where the arm stood still, or of these where `marker_column` says so."""
    if kind not in _LAYOUTS:
        raise BadInput("there is no such kind of log", found=kind, allowed=", ".join(_LAYOUTS))
    layout = _LAYOUTS[kind](Job.begin(files, header_path).robot.n)
    layout = replace(layout, marker_column=marker_column, delimiter=delimiter or layout.delimiter)
    return import_layout(files, target_names, layout, header_path, out, still=still)
