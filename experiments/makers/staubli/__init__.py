"""Stäubli: VAL3 applications."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.position_languages import VAL3
    from .val3_program import named_positions, val3_program

    return LineParts(VAL3, val3_program, named_positions, digits=3)


_FORMAT = LineFormat(
    _parts,
    ("val3", "VAL3 (Stäubli)", ("zb_plan.pjx", "start.pgx", "stop.pgx", "zb_plan.dtx"), ("speed", "zone")),
    "Data files (.dtx).",
    "Stäubli: joint variables (jointRx) of a data file, taught or recorded by a plan's program.",
    (r"type=[\"']jointRx\b", "its joint variables (jointRx), as of a VAL3 data file"),
)
MAKER = _FORMAT.maker("Stäubli", "staubli", r"staubli|tx2?|tx2? ?\d+\w*")
