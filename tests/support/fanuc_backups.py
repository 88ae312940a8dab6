"""Backups of FANUC controllers, as far as encoders are concerned: SYSMAST.VA and SYMOTN.VA.

The shape is that of public backups, the counts are made up. Scales, signs and coupling are those of two
models.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zerobeam.model.arrays import Matrix


@dataclass(frozen=True)
class FanucEncoders:
    """What the encoders of a controller do; `driven` are the ratios (row, column, value), joints from 0."""

    model: str
    scales: tuple[float, ...]
    mosign: tuple[bool, ...]
    couple3: int
    master: tuple[int, ...] = (-101756, 17967951, 31987538, -103955411, 107553, 14659013)
    driven: tuple[tuple[int, int, float], ...] = ()

    @property
    def per_degree(self) -> Matrix:
        """(6,) pulses for a degree, negative where they fall."""
        return np.where(self.mosign, 1.0, -1.0) * np.array(self.scales)

    @property
    def coupling(self) -> Matrix:
        """(6, 6) joints by their encoders alone."""
        coupling = np.eye(6)
        for row, column, value in self.driven:
            coupling[row, column] = value
        return coupling

    def pulses(self, angles: Matrix, zeros: Sequence[int]) -> Matrix:
        """(6,) whole pulses at angles between links, deg, of encoders that have `zeros` where these are 0."""
        own = np.array(angles)
        own[2] -= own[1] if self.couple3 == 0 else 0.0
        return np.round(np.linalg.solve(self.coupling, own) * self.per_degree + zeros)

    def angles(self, pulses: Matrix, master: Sequence[int]) -> Matrix:
        """(6,) the angles between links that a controller with these master counts believes in, deg."""
        own = self.coupling @ ((pulses - np.array(master)) / self.per_degree)
        own[2] += own[1] if self.couple3 == 0 else 0.0
        return np.asarray(own)


R2000IB = FanucEncoders(
    "R-2000iB/210F",
    (3.336378e05, 4.227072e05, 3.934730e05, 2.910284e05, 2.874161e05, 1.778786e05),
    (False, True, True, True, True, True),
    -2,
    driven=((4, 3, -0.00909091), (5, 3, -0.00981098), (5, 4, -0.00990099)),
)
M900IA = FanucEncoders(
    "M-900iA/260L_iC",
    (3.121543e05, 3.313209e05, 3.894711e05, 2.925194e05, 2.815621e05, 1.704929e05),
    (True, False, False, True, True, True),
    0,
    driven=((4, 3, -0.0112069), (5, 3, -0.00979003), (5, 4, -0.00990099)),
)

LR_MATE = FanucEncoders(  # made up
    "LR Mate 200iD",
    (1.8e05, 2.1e05, 1.9e05, 1.2e05, 1.3e05, 0.9e05),
    (True, False, True, True, True, True),
    -2,
    driven=((4, 3, -0.0091), (5, 3, -0.0098), (5, 4, -0.0099)),
)


def write_backup(folder: Path, encoders: FanucEncoders, changed: Mapping[str, str] | None = None) -> Path:
    """The two files in `folder`; each text in `changed` in place of its key, which must be there."""
    texts = {"SYSMAST.VA": _mast(encoders), "SYMOTN.VA": _motn(encoders)}
    folder.mkdir(exist_ok=True)
    for old, new in (changed or {}).items():
        assert sum(text.count(old) for text in texts.values()) == 1, old
        texts = {name: text.replace(old, new) for name, text in texts.items()}
    for name, text in texts.items():
        (folder / name).write_bytes(text.replace("\n", "\r\n").encode("latin-1"))
    return folder


def _mast(encoders: FanucEncoders) -> str:
    return "\n".join(
        [
            "[*SYSTEM*]$DMR_GRP  Storage: SHADOW  Access: RW  : ARRAY[4] OF DMR_GRP_T",
            "     Field: $DMR_GRP[1].$MASTER_DONE Access: RW: BOOLEAN = TRUE",
            *_array("$DMR_GRP[1].$MASTER_COUN", "INTEGER", map(str, encoders.master), "0"),
            *_array("$DMR_GRP[2].$MASTER_COUN", "INTEGER", ["7"], "0"),
            "",
        ]
    )


def _motn(encoders: FanucEncoders) -> str:
    scales = np.array(encoders.scales)
    per_rad = np.degrees(scales)
    signs = ["TRUE" if up else "FALSE" for up in encoders.mosign]
    lines = [
        "[*SYSTEM*]$MRR_GRP  Storage: DRAM  Access: RO  : ARRAY[4] OF MRR_GRP_T",
        *_array("$MRR_GRP[1].$ENCSCALES", "REAL", (f"{v:e}" for v in per_rad), "0.000000e+00"),
        *_array("$MRR_GRP[1].$MOSIGN", "BOOLEAN", signs, "FALSE"),
        *_array("$MRR_GRP[1].$AXS_COUPLE", "SHORT", ["0", "0", str(encoders.couple3)], "0"),
        "     Field: $MRR_GRP[1].$INTERACTION  ARRAY[9] OF INTERACT_T",
    ]
    ratios = np.zeros((6, 6))
    for row, column, value in encoders.driven:
        ratios[row, column] = value
    for i in range(6):
        row = (ratios[i] + np.where(np.arange(6) == i, -1.0 if i == 1 else 1.0, 0.0)) / per_rad
        name = f"$MRR_GRP[1].$INTERACTION[{i + 1}].$INTERACTION"
        lines += ["    " + line for line in _array(name, "REAL", (f"{v:e}" for v in row), "Uninitialized")]
    lines += [
        "[*SYSTEM*]$PARAM_GROUP  Storage: SHADOW  Access: RW  : ARRAY[4] OF MRR_GRP_T",
        *_array("$PARAM_GROUP[1].$ENCSCALES", "REAL", (f"{v:e}" for v in scales), "0.000000e+00"),
        *_array("$PARAM_GROUP[1].$MOSIGN", "BOOLEAN", signs, "FALSE"),
        "     Field: $PARAM_GROUP[1].$COMMENT Access: RW: STRING[9] = 'Gr\xfc\xdfe'",
        f"     Field: $SCR_GRP[1].$ROBOT_ID Access: RO: STRING[21] = '{encoders.model}'",
        "",
    ]
    return "\n".join(lines)


def _array(name: str, kind: str, values: Iterable[str], rest: str) -> list[str]:
    stated = [*values]
    filled = [*stated, *[rest] * (9 - len(stated))]
    return [
        f"     Field: {name}  ARRAY[9] OF {kind}",
        *(f"      [{i}] = {value}" for i, value in enumerate(filled, start=1)),
    ]
