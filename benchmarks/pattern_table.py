"""The paper's section 3.2 in numbers: what its two patterns determine, by the PSD's lateral position.

    .venv/bin/python benchmarks/pattern_table.py

Prints the table of docs/paper.md: data_std of delta2 ... delta6 in degrees for the built-in arm, a calibrated
laser along the flange's x axis, seven shots and the PSD at x = 900 mm, z = 0. Nothing is random.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zerobeam.analysis.observability.check import check
from zerobeam.experiments.plans.patterns import Pattern, pattern
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot

PATTERNS: tuple[Pattern, ...] = ("x", "y")
ASIDE_M = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8)
SHOTS = 7


def row(which: Pattern, aside_m: float) -> str:
    """One row of the table: pattern, p_y, range of joint 1, data_std of each offset in degrees."""
    robot = load_robot("irb1600", Path("."))
    target = [900.0, 1000 * aside_m, 0.0]
    header = Header.model_validate(
        {
            "robot": "irb1600",
            "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
            "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
            "geometry": "exact",
            "targets": {"psd": {"guess_mm": target}},
        }
    )
    name = f"| {which.upper()} | {aside_m:.1f} |"
    try:
        postures = pattern(header, robot, np.array(target), which, SHOTS)
    except BadInput:
        return f"{name} cannot be made | | | | | |"
    plan = Plan(
        header,
        robot,
        planned(postures * robot.display, ("psd",) * SHOTS),
        tuple(range(SHOTS)),
        Path("plan.yaml"),
        "0" * 64,
        (),
    )
    spread = float(np.degrees(np.ptp(postures[:, 0])))
    offsets = [own for own in check(plan).parameters if own.group == "offset" and not own.held]
    told = ["none" if own.data_std is None else f"{own.data_std:.2g}" for own in offsets]
    return f"{name} {spread:.1f} | {' | '.join(told)} |"


def main() -> None:
    """Print the table in Markdown."""
    print("| pattern | p_y, m | joint 1 varies by, deg | δ2 | δ3 | δ4 | δ5 | δ6 |")
    print("|---|---|---|---|---|---|---|---|")
    for which in PATTERNS:
        for aside in ASIDE_M:
            print(row(which, aside))


if __name__ == "__main__":
    main()
