"""Which rigs can carry a plan out, and what each of them can do: what `run` refuses is offered to nobody."""

from __future__ import annotations

from typing import Annotated, Literal

from ..model.files.plan import Plan
from ..model.records import it, record

RigKind = Literal["simulated", "manual", "live", "abb"]
_WORDS: dict[RigKind, str] = {
    "simulated": "Simulation",
    "manual": "By hand",
    "live": "By hand, joints read from the controller",
    "abb": "ABB robot",
}


@record(kw_only=True)
class OfferedRig:
    """A rig that can carry a plan out."""

    name: RigKind
    words: str


@record(kw_only=True)
class OfferedRun:
    """How a plan can be carried out."""

    rigs: list[OfferedRig]
    servo: Annotated[bool, it("a beam is led onto its target: with cell, camera, adaptive order")]
    closing: Annotated[bool, it("the first posture can be measured again at the end")]


def offered_run(plan: Plan, vendor: str | None) -> OfferedRun:
    """What can carry the plan out for a robot of this vendor (None: not stated)."""
    beam = plan.header.only_beam
    abb = beam and vendor in (None, "abb") and plan.robot.conventions.joint3 != "ground"
    return OfferedRun(
        rigs=[OfferedRig(name=name, words=words) for name, words in _WORDS.items() if abb or name != "abb"],
        servo=beam,
        closing=plan.header.only_tools,
    )
