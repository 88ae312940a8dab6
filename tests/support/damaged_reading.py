"""What must hold of a reader of damaged files of a plan: a plain refusal, or the joints that are there."""

from __future__ import annotations

from pathlib import Path

from damaged_files import damaged

from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.recordings import ImportJob
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan


def joints_by_posture(reader: str, plan: Plan, path: Path) -> dict[int, tuple[float, ...]]:
    """What a maker's reader makes of a file of this plan."""
    read = next(each.read for maker in makers() for each in maker.read if each.name == reader)
    return {
        shot.shot: tuple(shot.joints_deg)
        for shot in read(ImportJob.begin([path], plan, path.with_name("run.jsonl"))).shots
    }


def survives_damage(reader: str, plan: Plan, path: Path, lines: dict[int, str], count: int = 200) -> int:
    """How many of so many damaged files are read. `lines` are those of the measured joints, by posture: where
    the line is as it was, the joints are too."""
    text = path.read_text()
    whole = joints_by_posture(reader, plan, path)
    assert whole.keys() == lines.keys()
    assert all(text.count(line) == 1 for line in lines.values())
    other, accepted = path.with_name(f"damaged{path.suffix}"), 0
    for copy in damaged(text, count):
        other.write_text(copy)
        try:
            joints = joints_by_posture(reader, plan, other)
        except BadInput:
            continue
        accepted += 1
        for number, row in joints.items():
            assert row == whole.get(number) or lines.get(number, "") not in copy, (number, copy)
    return accepted
