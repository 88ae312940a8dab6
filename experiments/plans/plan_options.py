"""How a plan is made, as it is stated to `plan`, to Python and in study files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from ...model.errors import BadInput
from ...model.options import USUAL_REPEATS, Option, Seed, numbers_typed

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
    return Option(help, flag, least=least, label=label, unit=unit, needs=PATTERN, rare=True)


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
    _line("x, y: of the middle of the pattern's line before the base's z axis, mm.", "--distance"),
]
LineHeight = Annotated[float | None, _line("x, y: of the pattern's line over the target, mm.", "--height")]
LineWidth = Annotated[float | None, _line("x, y: length of the pattern's line, mm.", "--width", least=0)]
FlangeRoll = Annotated[
    float | None,
    _line("x, y: rotation of the flange about the beams, deg; 0: b1 along the line.", "--roll", unit="deg"),
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
            "Header file (.yaml): robot, tool, noise; or a run file (.jsonl). Not for verify.", "--header"
        ),
    ] = None
    target: Annotated[
        tuple[float, ...] | None,
        Option(
            "Position of the target: X,Y,Z in mm, base frame; default: the header's. Not for verify.",
            text=numbers_typed(3, "--target"),
            unit="mm",
            parts=("x", "y", "z"),
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
            " or drifts, a target that moves and a wrong reading show in the difference. Not for verify.",
            least=0,
            most=10_000,
            label="Again at the end",
        ),
    ] = USUAL_REPEATS
    measure: Annotated[
        Mapping[str, Portion],
        Option(
            "optimal: how many measurements an instrument of the header makes (of which targets); for"
            " each of several.",
            metavar="NAME[@TARGET,…]=COUNT",
            text=portions_typed,
            typed=list[str],
            needs=OPTIMAL,
            rare=True,
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
            "With --tolerance: the most measurements.",
            least=2,
            most=10_000,
            label="At most, with u",
            needs=("--tolerance", "optimal"),
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
