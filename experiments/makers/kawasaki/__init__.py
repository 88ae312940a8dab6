"""Kawasaki: AS programs."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.position_languages import AS
    from .as_program import as_program

    return LineParts(AS, as_program)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Kawasaki: joint displacement values (#name) of a saved file, taught or recorded by a plan's program.",
)
MAKER = Maker(
    "Kawasaki",
    "kawasaki",
    r"kawasaki|rs ?\d+\w*|bx ?\d+\w*|duaro\w*",
    program=(
        PlanProgram("as", "AS (Kawasaki)", ("zb_plan.as",), _FORMAT.program, ("speed", "zone", "tool")),
    ),
    read=(
        Reader(
            "as",
            _READ,
            "Saved AS files (.as, .pg).",
            marks=(
                _FORMAT.mark(
                    r"^[ \t]*\.(?:PROGRAM|JOINTS|TRANS)\b", "its lines .PROGRAM or .JOINTS, as of an AS file"
                ),
            ),
        ),
    ),
)
