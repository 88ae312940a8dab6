"""Stäubli: VAL3 applications."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader

_FILES = (".pgx", ".dtx", ".pjx")


def _parts() -> LineParts:
    from ...positions.position_languages import VAL3
    from .val3_program import named_positions, val3_program

    return LineParts(VAL3, val3_program, named_positions, digits=3)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Stäubli: joint variables (jointRx) of a data file, taught or recorded by a plan's program.",
)
MAKER = Maker(
    "Stäubli",
    "staubli",
    r"staubli|tx2?|tx2? ?\d+\w*",
    program=(
        PlanProgram(
            "val3",
            "VAL3 (Stäubli)",
            ("zb_plan.pjx", "start.pgx", "stop.pgx", "zb_plan.dtx"),
            _FORMAT.program,
            ("speed", "zone"),
        ),
    ),
    read=(
        Reader(
            "val3",
            _READ,
            "Data files (.dtx).",
            marks=(
                _FORMAT.mark(r"type=[\"']jointRx\b", "its joint variables (jointRx), as of a VAL3 data file"),
            ),
        ),
    ),
)
