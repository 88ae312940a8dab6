"""Kawasaki: AS programs."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.position_languages import AS
    from .as_program import as_program

    return LineParts(AS, as_program)


_FORMAT = LineFormat(
    _parts,
    ("as", "AS (Kawasaki)", ("zb_plan.as",), ("speed", "zone", "tool")),
    "Saved AS files (.as, .pg).",
    "Kawasaki: joint displacement values (#name) of a saved file, taught or recorded by a plan's program.",
    (r"^[ \t]*\.(?:PROGRAM|JOINTS|TRANS)\b", "its lines .PROGRAM or .JOINTS, as of an AS file"),
)
MAKER = _FORMAT.maker("Kawasaki", "kawasaki", r"kawasaki|rs ?\d+\w*|bx ?\d+\w*|duaro\w*")
