"""The corrected targets of a program in the terminal: what each was taken for, and how far it moves."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...experiments.makers.solving import CorrectedTarget
from ...words.wording import shown


def print_targets(console: Console, targets: Sequence[CorrectedTarget]) -> None:
    """One row a target: its joints are those of the nominal arm, as the pendant counts them."""
    table = Table(box=None, pad_edge=False)
    table.add_column("corrected target")
    table.add_column("moved by\ndeg", justify="right")
    table.add_column("\nmm", justify="right")
    table.add_column("configuration")
    table.add_column("at joints of the nominal arm, deg")
    for target in targets:
        table.add_row(
            Text(shown(target.name)),
            f"{target.moved_joint:.3f}",
            f"{target.moved_mm:.3f}",
            Text(target.configuration if target.configuration else "-" if target.cartesian else "joints"),
            ", ".join(f"{value + 0.0:.2f}" for value in target.joints.tolist()),
        )
    console.print(table)
