"""Stand-in controllers of the pages that lead a maker's arm from the plan to the test of the corrected robot.

A controller runs the program that a page exports, on one simulated arm whose offsets, links, gravity and
harmonics deviate from nominal, and saves the file that the page imports. Where the page has exported what a
person enters, the arm has it: it is read from that sheet, by what the controller computes with it.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import doosan_controller
import fanuc_interpreter
import numpy as np
import urscript_interpreter
import yaskawa_controller
from fanuc_backups import LR_MATE, write_backup
from program_arm import PendantArm
from rapid_interpreter import RapidController

from zerobeam.model.files.plan import read_plan

OFFSETS = {"delta2": 0.42, "delta3": -0.31, "delta4": 0.55, "delta5": -0.18, "delta6": 0.3}
_GEARS = (-100.0, -120.0, 100.0, -50.0, -50.0, 50.0)  # as the page of the IRB 1600 states them


class Controller(NamedTuple):
    """`run` carries a program out and saves its recordings in its folder; `entered` are the changes of the
    readings, degrees by joint, by what the sheet `sheet` has a person enter."""

    run: Callable[[Path, PendantArm], object]
    sheet: str | None = None
    entered: Callable[[str], dict[int, float]] = lambda text: {}


def _fanuc(program: Path, arm: PendantArm) -> None:
    saved = fanuc_interpreter.carried_out(program.read_text(encoding="utf-8"), arm)
    program.with_name("posreg.va").write_text(saved, encoding="utf-8")
    write_backup(program.with_name("backup"), LR_MATE)


def _master_counts(text: str) -> dict[int, float]:
    """By how much the angles between links change that the controller reckons with."""
    new, here = list(LR_MATE.master), LR_MATE.pulses(np.zeros(6), LR_MATE.master)
    for joint, count, now in re.findall(r"^J(\d) +\S+ +(-?\d+) +\(now (-?\d+)\)$", text, re.MULTILINE):
        assert int(now) == new[int(joint) - 1]
        new[int(joint) - 1] = int(count)
    changes = enumerate(LR_MATE.angles(here, new).tolist(), start=1)
    return {joint: change for joint, change in changes if abs(change) > 1e-4}  # the rest is rounding


def _home_positions(text: str) -> dict[int, float]:
    """An axis reads 0 where it read so many pulses."""
    rows = re.findall(r"^([SLURBT]) .* = ([-+]\d+) pulses$", text, re.MULTILINE)
    axes = ["SLURBT".index(axis) for axis, _ in rows]
    return {i + 1: -int(row[1]) / yaskawa_controller.PULSES[i] for i, row in zip(axes, rows, strict=True)}


def _abb(program: Path, arm: PendantArm) -> None:
    log = RapidController(program.read_text(encoding="utf-8"), arm).run()
    program.with_name("zb_plan.log").write_text(log, encoding="utf-8")


def _cal_offsets(text: str) -> dict[int, float]:
    """The readings fall with cal_offset at a positive ratio, on the controller of the page."""
    rows = re.findall(r"^# (\d);.*; ([-+.\d]+)$", text, re.MULTILINE)
    return {int(joint): math.degrees(-float(change) / _GEARS[int(joint) - 1]) for joint, change in rows}


def _ur(program: Path, arm: PendantArm) -> None:
    log, _ = urscript_interpreter.carried_out(program.read_text(encoding="utf-8"), arm)
    program.with_suffix(".log").write_text(log, encoding="utf-8")


def _joint_zeros(text: str) -> dict[int, float]:
    """A joint reads 0 where it read what it is driven to."""
    rows = re.findall(r"^J(\d) +\S+ +([-+][\d.]+)$", text, re.MULTILINE)
    return {int(joint): -float(at) for joint, at in rows}


WAYS = {
    "docs/how-to/ur5e.md": Controller(_ur, "joint-zero.txt", _joint_zeros),
    "docs/how-to/fanuc.md": Controller(_fanuc, "mastering.txt", _master_counts),
    "docs/how-to/yaskawa.md": Controller(
        yaskawa_controller.carried_out, "home-position.txt", _home_positions
    ),
    "docs/how-to/abb-way.md": Controller(_abb, "moc-changes.txt", _cal_offsets),
    "docs/how-to/doosan.md": Controller(doosan_controller.carried_out),
}


class StandIn:
    """The controller of a page and its arm, which learns of each command of the page after it has run.
    The person `enters` what the sheet states, or forgets it."""

    def __init__(self, page: str, folder: Path, *, enters: bool = True) -> None:
        self._controller, self._folder, self._enters = WAYS.get(page), folder, enters
        self._arm: dict[str, float] | None = None
        self.programs = 0

    def after(self, words: list[str]) -> None:
        """What the person and the controller do after the command `words` (without zerobeam)."""
        if self._controller is None or words[:2] != ["export", "plan"]:
            return
        plan = read_plan(self._folder / words[3])
        arm = PendantArm(plan, OFFSETS, seed=8, known=self._arm and self._now(self._arm, self._controller))
        self._arm = self._arm or arm.truth
        self._controller.run(self._folder / words[words.index("-o") + 1], arm)
        self.programs += 1

    def _now(self, arm: dict[str, float], controller: Controller) -> dict[str, float]:
        """The arm with what was entered: what is left of its offsets."""
        if controller.sheet is None or not self._enters:
            return arm
        entered = controller.entered((self._folder / controller.sheet).read_text(encoding="utf-8"))
        assert len(entered) == 4  # joints 2 to 5
        return arm | {f"delta{joint}": arm[f"delta{joint}"] - value for joint, value in entered.items()}
