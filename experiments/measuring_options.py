"""How a plan is made, as it is stated to `plan`, to Python and in study files, and how it is carried out, as
it is stated to `run`."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from ..model.errors import BadInput
from ..model.options import J3, JOINT_3, USUAL_REPEATS, Option, PendantUnit, Seed, numbers_typed, options_of

Pattern = Literal["x", "y", "optimal"]


class Portion(NamedTuple):
    """How many measurements an instrument makes, and of which targets (none named: of all that it can)."""

    number: int
    targets: tuple[str, ...] = ()


def portions_typed(texts: Sequence[str]) -> dict[str, Portion]:
    """NAME[@TARGET,…]=COUNT of each instrument."""
    shares: dict[str, Portion] = {}
    for text in texts:
        name, _, count = text.rpartition("=")
        label, _, targets = name.partition("@")
        if not label or not count.isdecimal() or not 1 <= int(count) <= 10_000 or label in shares:
            raise BadInput(
                "--measure is not understood",
                found=text,
                allowed="NAME=COUNT or NAME@TARGET,…=COUNT, once for each instrument, COUNT from 1 to 10000",
            )
        shares[label] = Portion(int(count), tuple(part for part in targets.split(",") if part))
    return shares


def _direction(text: str) -> tuple[float, ...] | None:
    return None if text == "any" else numbers_typed(3, "--facing")(text)


OPTIMAL, PATTERN = ("optimal",), ("x,y",)  # for which kind of plan: the word of the command


def _line(help: str, flag: str, unit: str = "mm", least: float | None = None) -> Option:
    label = f"{flag.removeprefix('--').capitalize()} of the line"
    return Option(help, flag, case="x, y", least=least, label=label, unit=unit, needs=PATTERN, rare=True)


# Stated in study files too.
CriterionOfPlan = Annotated[
    Literal["A", "D", "E"], Option("Criterion of an optimal plan.", needs=OPTIMAL, rare=True)
]
AcceptanceDeg = Annotated[
    float,
    Option(
        "Largest angle between the beam and that normal, deg.",
        "--acceptance",
        label="Largest angle to it",
        unit="deg",
        needs=OPTIMAL,
        rare=True,
    ),
]
MarginDeg = Annotated[
    float,
    Option(
        "Distance kept from every joint limit, deg.",
        "--margin",
        least=0,
        label="Margin to limits",
        unit="deg",
        needs=OPTIMAL,
        rare=True,
    ),
]
LineDistance = Annotated[
    float | None,
    _line("of the middle of the pattern's line before the base's z axis, mm.", "--distance"),
]
LineHeight = Annotated[float | None, _line("of the pattern's line over the target, mm.", "--height")]
LineWidth = Annotated[float | None, _line("length of the pattern's line, mm.", "--width", least=0)]
FlangeRoll = Annotated[
    float | None,
    _line("rotation of the flange about the beams, deg; 0: b1 along the line.", "--roll", unit="deg"),
]


@dataclass(frozen=True)
class PlanOptions:
    """How a plan is made: degrees and millimetres, as people state them.

    `target` (3,) None: where the header says. `shots` None: as many as usual; `measure` says by the label of
    each of several instruments how many it makes, and of which targets. From `facing` to `margin_deg` and the
    `obstacles` are constraints of an optimal plan, which are kept in it; a pattern has none, and has the line
    of `distance_mm`, `height_mm`, `width_mm` and `roll_deg`.
    """

    header_file: Annotated[
        Path | None,
        Option(
            "Header file (.yaml): robot, tool, noise; or a run file (.jsonl).",
            "--header",
            more="Not for verify.",
        ),
    ] = None
    target: Annotated[
        tuple[float, ...] | None,
        Option(
            "Position of the target: X,Y,Z in mm, base frame; default: the header's.",
            text=numbers_typed(3, "--target"),
            unit="mm",
            parts=("x", "y", "z"),
            more="Not for verify.",
        ),
    ] = None
    shots: Annotated[
        int | None,
        Option(
            "Number of measurements. Default: 20 (x, y and geometry: exact 7; verify: as few as the test"
            " needs).",
            least=2,
            most=10_000,
            label="Measurements",
        ),
    ] = None
    repeat: Annotated[
        int,
        Option(
            "How many of the measurements are made again at the end, in the same postures: a zero that jumps"
            " or drifts, a target that moves and a wrong reading show in the difference.",
            least=0,
            most=10_000,
            label="Again at the end",
            more="Not for verify.",
        ),
    ] = USUAL_REPEATS
    measure: Annotated[
        Mapping[str, Portion],
        Option(
            "how many measurements an instrument of the header makes (of which targets); for"
            " each of several.",
            metavar="NAME[@TARGET,…]=COUNT",
            text=portions_typed,
            typed=list[str],
            needs=OPTIMAL,
            rare=True,
            case="optimal",
        ),
    ] = field(default_factory=dict)
    candidates: Annotated[
        int,
        Option("Candidate postures to choose from.", least=10, most=1_000_000, needs=OPTIMAL, rare=True),
    ] = 10_000
    criterion: CriterionOfPlan = "A"
    tolerance: Annotated[
        float | None,
        Option(
            "Take the fewest measurements that reach this standard uncertainty (deg; mm) and detect"
            " wrong models.",
            label="… or as few as reach u",
            unit="deg",
            needs=OPTIMAL,
        ),
    ] = None
    max_shots: Annotated[
        int,
        Option(
            "the most measurements.",
            least=2,
            most=10_000,
            label="At most, with u",
            needs=("--tolerance", "optimal"),
            case="With --tolerance",
        ),
    ] = 30
    facing: Annotated[
        tuple[float, ...] | None,
        Option(
            "Outward normal of the target's face: X,Y,Z, or any.",
            text=_direction,
            label="Normal of the target, or any",
            needs=OPTIMAL,
            rare=True,
        ),
    ] = (0.0, 0.0, 1.0)
    acceptance_deg: AcceptanceDeg = 60.0
    beam_mm: Annotated[
        tuple[float, ...],
        Option(
            "Shortest and longest beam, mm: MIN,MAX.",
            "--beam",
            text=numbers_typed(2, "--beam"),
            unit="mm",
            parts=("at least", "at most"),
            needs=OPTIMAL,
            rare=True,
        ),
    ] = (200.0, 2000.0)
    margin_deg: MarginDeg = 5.0
    distance_mm: LineDistance = None
    height_mm: LineHeight = None
    width_mm: LineWidth = None
    roll_deg: FlangeRoll = None
    obstacles: Annotated[
        Path | None,
        Option("Obstacles file (.yaml): floor, boxes.", among="obstacles", needs=OPTIMAL, rare=True),
    ] = None
    seed: Seed = 0


RIGS = ("simulated", "replay", "abb", "manual")
_ABB, _SIMULATED = ("--rig=abb",), ("--rig=simulated",)


def _port(help: str, label: str) -> Option:
    return Option(help, case="ABB", least=1, most=65535, label=label, needs=_ABB, rare=True)


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
            "the arm of this simulated run, with its offsets entered.",
            metavar="RUN",
            label="Arm of the simulated run",
            among="run",
            needs=_SIMULATED,
            rare=True,
            case="Simulated",
        ),
    ] = None
    as_found: Annotated[
        bool,
        Option(
            "without its offsets entered; with the seed of RUN the targets stay too.",
            needs=("--arm",),
            rare=True,
            case="With --arm",
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
            "the standard uncertainty that is enough (deg; mm). Default: the plan's.",
            label="u that is enough",
            needs=("--adaptive",),
            rare=True,
            case="With --adaptive",
        ),
    ] = None
    gain: Annotated[
        float | None,
        Option(
            "end when the next measurement lowers no U by this much an hour (deg; mm).",
            least=1e-9,
            label="Least gain an hour",
            needs=("--adaptive",),
            rare=True,
            case="With --adaptive",
        ),
    ] = None
    host: Annotated[
        str | None,
        Option("address of the controller.", label="Controller’s address", needs=_ABB, case="ABB"),
    ] = None
    port: Annotated[int, _port("port of Robot Web Services.", "Port of Robot Web Services")] = 80
    egm_port: Annotated[int, _port("own UDP port for EGM.", "Own UDP port for EGM")] = 6510
    sensor_port: Annotated[int, _port("port of PSD and camera at the host.", "Port of PSD and camera")] = 6520
    sensors: Annotated[
        Path | None,
        Option(
            "Sensors file. ABB: else those of the simulated controller. By hand or live: an instrument"
            " that sends lines. Live with a laser: the PSD, which confirms a posture by a centred beam.",
            among="sensors",
            needs=("--rig=abb,live,manual",),
        ),
    ] = None
    user: Annotated[str | None, Option("user, else ZEROBEAM_ABB_USER.", needs=_ABB, case="ABB")] = None
    password: Annotated[
        str | None, Option("password, else ZEROBEAM_ABB_PASSWORD or the keyring.", app=False, case="ABB")
    ] = field(default=None, repr=False)
    speed: Annotated[
        float,
        Option(
            "share of the joints' top speeds.",
            label="Share of the joints’ top speeds",
            needs=_ABB,
            case="ABB",
        ),
    ] = 0.25
    laser: Annotated[
        str,
        Option(
            "digital output of the laser, NETWORK/UNIT/NAME.",
            label="Output of the laser",
            needs=_ABB,
            rare=True,
            case="ABB",
        ),
    ] = "Local/DRV_1/zb_laser"
    yes: Annotated[bool, Option("move without asking first.", app=False, case="ABB")] = False
    watch: Annotated[
        Path | None, Option("take the joint values from this file as it grows.", app=False, case="Manual")
    ] = None
    units: Annotated[
        PendantUnit | None,
        Option(
            "unit of the joint values, if neither they nor the robot file state it (deg).",
            needs=("--rig=manual",),
            case="Manual",
        ),
    ] = None
    j3: Annotated[
        J3 | None,
        Option(
            "what joint 3 is counted from, if not as the robot file states.",
            label=JOINT_3,
            needs=("--rig=manual,live",),
            case="Manual",
        ),
    ] = None
    repeat: Annotated[
        int | None,
        Option(
            "how many measurements are made again at the end (2). Else the plan says.",
            least=0,
            most=10_000,
            label="Again at the end",
            needs=("--adaptive",),
            rare=True,
            case="With --adaptive",
        ),
    ] = None
    once_more: Annotated[
        bool,
        Option(
            "measure once more what this run has measured again: does it agree now?",
            app=False,
            case="With --resume",
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
