"""The corrected targets of a program: what each was taken for, and how far it moves."""

from __future__ import annotations

from collections.abc import Sequence

from ...experiments.makers.solving import CorrectedTarget
from ...words.wording import shown
from ..style.blocks import Table, row_of, table_of


def targets_table(targets: Sequence[CorrectedTarget]) -> Table:
    """One row a target: its joints are those of the nominal arm, as the pendant counts them."""
    rows = [
        row_of(
            shown(target.name),
            f"{target.moved_joint:.3f}",
            f"{target.moved_mm:.3f}",
            shown(target.configuration) if target.configuration else "-" if target.cartesian else "joints",
            ", ".join(f"{value + 0.0:.2f}" for value in target.joints.tolist()),
        )
        for target in targets
    ]
    heads = ["corrected target", "moved by, deg", "moved by, mm", "configuration"]
    return table_of("", [*heads, "at joints of the nominal arm, deg"], rows, "lrrl")
