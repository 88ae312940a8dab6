"""How a plan is carried out, as it is stated to `run`."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from ..model.errors import BadInput
from ..model.options import JOINT_3, Option, Seed, options_of

RIGS = ("simulated", "replay", "abb", "manual")
_ABB, _SIMULATED = ("--rig=abb",), ("--rig=simulated",)


def _port(help: str, label: str) -> Option:
    return Option(help, least=1, most=65535, label=label, needs=_ABB, rare=True)


@dataclass(frozen=True)
class RunOptions:
    """What carries a plan out, and how; `rig` is one of the RIGS, or the address of a controller."""

    rig: Annotated[
        str,
        Option(
            "What carries the plan out: simulated, replay, abb, manual; or a controller whose joints are"
            " read while its own program or a person moves the arm: SCHEME://HOST[:PORT] (ur, kuka, fanuc,"
            " yaskawa, ros).",
            metavar="RIG",
        ),
    ] = "simulated"
    cell: Annotated[
        Path | None,
        Option("Cell file (.yaml) of the simulated rig.", among="cell", needs=_SIMULATED),
    ] = None
    camera: Annotated[
        bool,
        Option(
            "Find the PSD in pictures, or by the beam alone.",
            "--camera/--no-camera",
            needs=_SIMULATED,
        ),
    ] = True
    arm: Annotated[
        Path | None,
        Option(
            "Simulated: the arm of this simulated run, with its offsets entered.",
            metavar="RUN",
            label="Arm of the simulated run",
            among="run",
            needs=_SIMULATED,
            rare=True,
        ),
    ] = None
    as_found: Annotated[
        bool,
        Option(
            "With --arm: without its offsets entered; with the seed of RUN the targets stay too.",
            needs=("--arm",),
            rare=True,
        ),
    ] = False
    recording: Annotated[
        Path | None, Option("Recorded run (.jsonl) that a replay reads.", "--recorded", app=False)
    ] = None
    resume: Annotated[bool, Option("Go on with a run that was stopped.")] = False
    adaptive: Annotated[
        bool,
        Option(
            "Choose the next posture by the measurements so far; end when the tolerance is reached.",
            rare=True,
        ),
    ] = False
    tolerance: Annotated[
        float | None,
        Option(
            "With --adaptive: the standard uncertainty that is enough (deg; mm). Default: the plan's.",
            label="u that is enough",
            needs=("--adaptive",),
            rare=True,
        ),
    ] = None
    gain: Annotated[
        float | None,
        Option(
            "With --adaptive: end when the next measurement lowers no U by this much an hour (deg; mm).",
            least=1e-9,
            label="Least gain an hour",
            needs=("--adaptive",),
            rare=True,
        ),
    ] = None
    host: Annotated[
        str | None,
        Option("ABB: address of the controller.", label="Controller’s address", needs=_ABB),
    ] = None
    port: Annotated[int, _port("ABB: port of Robot Web Services.", "Port of Robot Web Services")] = 80
    egm_port: Annotated[int, _port("ABB: own UDP port for EGM.", "Own UDP port for EGM")] = 6510
    sensor_port: Annotated[
        int, _port("ABB: port of PSD and camera at the host.", "Port of PSD and camera")
    ] = 6520
    sensors: Annotated[
        Path | None,
        Option(
            "Sensors file. ABB: else those of the simulated controller. By hand or live: an instrument"
            " that sends lines. Live with a laser: the PSD, which confirms a posture by a centred beam.",
            among="sensors",
            needs=("--rig=abb,live,manual",),
        ),
    ] = None
    user: Annotated[str | None, Option("ABB: user, else ZEROBEAM_ABB_USER.", needs=_ABB)] = None
    password: Annotated[
        str | None, Option("ABB: password, else ZEROBEAM_ABB_PASSWORD or the keyring.", app=False)
    ] = field(default=None, repr=False)
    speed: Annotated[
        float,
        Option("ABB: share of the joints' top speeds.", label="Share of the joints’ top speeds", needs=_ABB),
    ] = 0.25
    laser: Annotated[
        str,
        Option(
            "ABB: digital output of the laser, NETWORK/UNIT/NAME.",
            label="Output of the laser",
            needs=_ABB,
            rare=True,
        ),
    ] = "Local/DRV_1/zb_laser"
    yes: Annotated[bool, Option("ABB: move without asking first.", app=False)] = False
    watch: Annotated[
        Path | None, Option("Manual: take the joint values from this file as it grows.", app=False)
    ] = None
    units: Annotated[
        Literal["deg", "rad", "pulse"] | None,
        Option(
            "Manual: unit of the joint values, if neither they nor the robot file state it (deg).",
            needs=("--rig=manual",),
        ),
    ] = None
    j3: Annotated[
        Literal["ground", "link"] | None,
        Option(
            "Manual: what joint 3 is counted from, if not as the robot file states.",
            label=JOINT_3,
            needs=("--rig=manual,live",),
        ),
    ] = None
    repeat: Annotated[
        int | None,
        Option(
            "With --adaptive: how many measurements are made again at the end (2). Else the plan says.",
            least=0,
            most=10_000,
            label="Again at the end",
            needs=("--adaptive",),
            rare=True,
        ),
    ] = None
    once_more: Annotated[
        bool,
        Option(
            "With --resume: measure once more what this run has measured again: does it agree now?",
            app=False,
        ),
    ] = False
    closing: Annotated[
        bool, Option("Measure the first posture again at the end: has the PSD moved?", rare=True)
    ] = False
    force: Annotated[
        bool,
        Option(
            "Replace a simulated run of that name by this one; measurements are never replaced.",
            "--force --overwrite",
            app=False,
        ),
    ] = False
    seed: Seed = 0

    @property
    def kind(self) -> Literal["simulated", "replay", "abb", "manual", "live"]:
        """The rig without its address."""
        return "live" if "://" in self.rig else self.rig  # type: ignore[return-value]

    def resuming(self, plan: Path, file: Path) -> str:
        """The command that goes on with a run of the plan, as it can be pasted. A password is not shown, and
        before the arm moves a person is asked again."""
        left_out = ("resume", "force", "password", "yes")
        words = [
            word
            for one in options_of(RunOptions)
            if one.name not in left_out
            for word in one.words_for(getattr(self, one.name))
        ]
        return shlex.join(["zerobeam", "run", str(plan), "-o", str(file), *words, "--resume"])

    def require_consistent(self) -> None:
        """BadInput for options that contradict each other, or are for another rig."""
        if self.tolerance is not None and not self.adaptive:
            raise BadInput("--tolerance is for an adaptive run", remedy="add --adaptive, or leave it out")
        if self.gain is not None and not self.adaptive:
            raise BadInput("--gain is for an adaptive run", remedy="add --adaptive, or leave it out")
        if self.repeat is not None and not self.adaptive:
            raise BadInput(
                "--repeat is for an adaptive run: else the plan says what is measured again",
                remedy="add --adaptive, or make the plan with --repeat",
            )
        if self.once_more and not self.resume:
            raise BadInput("--once-more goes on with a run", remedy="add --resume, or leave it out")
        if self.sensors is not None and self.kind not in ("live", "abb", "manual"):
            raise BadInput(
                "--sensors is for real sensors", remedy="add --rig abb, manual or a controller's address"
            )
        if self.as_found and self.arm is None:
            raise BadInput("--as-found is for the arm of a run", remedy="add --arm RUN, or leave it out")
        if self.watch is not None and self.rig != "manual":
            raise BadInput("--watch is for the manual rig", remedy="add --rig manual, or leave it out")
        if self.force and self.resume:
            raise BadInput("--force and --resume contradict each other", remedy="state one of the two")
