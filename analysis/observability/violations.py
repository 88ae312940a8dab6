"""A constraint of a plan that one of its postures breaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..status import Verdict

# "violated": the plan breaks its own constraints, whatever it would determine.
PlanVerdict = Verdict | Literal["violated"]
Condition = Literal["limits", "behind", "beam_mm", "facing", "itself", "cell", "beam"]


@dataclass(frozen=True)
class Violation:
    """Posture `posture` (from 0) breaks `constraint`, a key of the plan's `constraints`.

    `condition`: "limits" (a joint is nearer to a limit than the margin), "beam_mm", "facing", "itself" (the
    arm touches itself), "cell" (it touches the floor or a box), "beam" (a box is in the beam's way). `at` is
    the value found, `lowest` to `highest` are allowed, in `unit`; None for what is touched. `joint` (from 1)
    is that of "limits", `via` (from 0) an intermediate posture on the way to the posture. `planned`: it is
    broken by the posture as written, and no longer once the wrist is turned onto the target.
    """

    posture: int
    constraint: Literal["acceptance_deg", "beam_mm", "margin_deg", "obstacles"]
    condition: Condition
    at: float | None = None
    lowest: float | None = None
    highest: float | None = None
    unit: str | None = None
    joint: int | None = None
    via: int | None = None
    planned: bool = False

    @property
    def unseen(self) -> bool:
        """Whether the posture gives no measurement: the beam does not come to the front of the target."""
        return self.condition in ("facing", "beam")
