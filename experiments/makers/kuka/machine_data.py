"""KUKA: $MAMES of $machine.dat, the readings of the axes at their mastering marks.

At the mechanical zero position (the mark) the value of $MAMES is assigned to the axis counter (KR C2
operating handbook, machine data). So an axis that is mastered at its mark with a value that is larger by d
reads more by d. How an axis was mastered elsewhere is in no file whose form is published.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.parsing.reading import read_other_text
from ..maker import file_of_backup

_MAMES = re.compile(
    r"^[ \t]*\$MAMES\[(\d+)\][ \t]*=[ \t]*([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)[ \t]*(?:;[^\n]*)?\r?$",
    re.MULTILINE | re.IGNORECASE,
)
_MODEL = re.compile(r'^[ \t]*\$TRAFONAME\[\][ \t]*=[ \t]*"([^"\n]*)"', re.MULTILINE | re.IGNORECASE)


def mames_change(old: Path, new: Path, joints: int) -> Matrix:
    """(n,) degrees by which axes read more at their marks with the new $machine.dat than with the old one,
    each a file or the folder of a backup. BadInput where a file is not whole, or they are of two arms."""
    models, values = [], []
    for path in (
        file_of_backup(old, "$machine.dat", "$MAMES["),
        file_of_backup(new, "$machine.dat", "$MAMES["),
    ):
        text = read_other_text(path)
        models.append(_MODEL.findall(text))
        entries = [(int(number), float(value)) for number, value in _MAMES.findall(text)]
        of_axes = [value for number, value in entries if number <= joints]
        if [number for number, _ in entries[:joints]] != [*range(1, joints + 1)] or len(of_axes) != joints:
            raise BadInput(
                "$MAMES of the axes is not understood",
                found=", ".join(f"[{number}]" for number, _ in entries) or "none",
                allowed=f"$MAMES[1] to $MAMES[{joints}], each once, in numbers",
                file=path,
            )
        values.append(np.array(of_axes))
    if models[0] != models[1]:
        raise BadInput("the two backups are not of one arm", found=f"{models[0]}, {models[1]}")
    if np.array_equal(values[0], values[1]):
        raise BadInput(
            "$MAMES is the same before and after: how the axes were mastered is not in these files",
            found=", ".join(f"{value:g}" for value in values[0]),
            remedy="state --entered: by how much more each axis reads at the same place (for an axis that was"
            " mastered where it read r, the mastering position less r)",
        )
    return np.asarray(values[1] - values[0])
