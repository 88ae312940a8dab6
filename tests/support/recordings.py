"""Recordings of real arms, brought into run files as a person would: `zerobeam import csv` with a header.

A ball at the flange sat in two sockets 50 mm apart, at several places of the cell.
"""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from command_line import Answer, zerobeam
from made_once import made_once


@dataclass(frozen=True)
class Arm:
    """A recorded arm: its URDF chain and how far along the tip's z axis the ball is, mm."""

    name: str
    urdf: str
    base: str
    tip: str
    ball_z: float
    limits: str = "error"


PANDA_1 = Arm("panda_1", "panda.urdf", "panda_link0", "panda_hand_tcp", 32)
PANDA_2 = Arm("panda_2", "panda.urdf", "panda_link0", "panda_hand_tcp", 32)
KUKA_14 = Arm("kuka_14", "iiwa14.urdf", "base_link", "tool0", 40)
# This one really went beyond the limits that its URDF states.
DINOVA_1 = Arm("dinova_1", "gen3lite.urdf", "kinova_base_link", "end_effector_link", 180, "warn")


def places(data: Path, arm: Arm) -> list[str]:
    return sorted(folder.name for folder in (data / "mukca" / arm.name).iterdir() if folder.is_dir())


def header_text(data: Path, arm: Arm, chosen: Sequence[str]) -> str:
    """A header with exact geometry, which no real arm has."""
    urdf = (data / "mukca" / "urdf" / arm.urdf).resolve()
    distances = "".join(
        f"  - {{between: [{place}_0, {place}_1], mm: 50, sigma_mm: 0.1}}\n" for place in chosen
    )
    return (
        f"robot: {{urdf: {urdf}, base: {arm.base}, tip: {arm.tip}}}\n"
        f"tool: {{kind: probe, calibrated: false, point_mm: [0, 0, {arm.ball_z}]}}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.5}\n"
        f"limits: {arm.limits}\n"
        "geometry: exact\n"
        f"distances:\n{distances}"
    )


def recorded(data: Path, arm: Arm) -> tuple[Answer, Path]:
    """What the import of all places of an arm said, and the run file, which nobody may change."""

    def make() -> tuple[Answer, Path]:
        return imported(
            data, Path(tempfile.mkdtemp(dir=os.environ["ZEROBEAM_TESTS_MADE"])), arm, places(data, arm)
        )

    return made_once(f"import {arm.name}", make)


def imported(data: Path, folder: Path, arm: Arm, chosen: Sequence[str]) -> tuple[Answer, Path]:
    """What the import said, and the run file, of the chosen places of the cell."""
    header, run = folder / f"{arm.name}.yaml", folder / f"{arm.name}.jsonl"
    header.write_text(header_text(data, arm, chosen), encoding="utf-8")
    files, targets = [], []
    for place in chosen:
        for hole in (0, 1):
            files.append(data / "mukca" / arm.name / place / f"hole_{hole}.csv")
            targets += ["--target", f"{place}_{hole}"]
    told = zerobeam("import", "csv", *files, "--header", header, "--units", "rad", *targets, "-o", run)
    return told, run
