"""Carrying out a plan: each shot is on disk before the next one is made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from ..model.plan import Plan
from ..model.run import RunJournal
from .simulate import Truth, simulated_run_header, simulated_shots

Progress = Callable[[str, float], None]


def carry_out(plan: Plan, rig: Literal["simulated"], file: Path, seed: int, told: Progress) -> int:
    """Record the plan's shots to a new run file and return how many there are.

    The simulated rig draws true offsets of about a degree from the seed and notes them in the run's
    provenance. Raises BadInput if the file exists, RigFault if a posture cannot be aimed.
    """
    rng = np.random.default_rng(seed)
    truth = Truth.drawn(plan, rng)
    header = simulated_run_header(plan, truth, file, seed)
    count = 0
    with RunJournal(file, header) as journal:
        for shot in simulated_shots(truth, rng):
            journal.append(shot)
            count += 1
            told("shots", count / len(plan.postures))
    return count
