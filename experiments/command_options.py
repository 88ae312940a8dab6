"""What is stated to commands that need few words."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from ..analysis.analyse_options import Ess, Sampling
from ..model.options import Option, Seed, argument

Url = Annotated[
    str | None,
    Option(
        "SQLite file, or postgresql://user@host/database. Default: history.sqlite in your data folder.",
        "--db",
        metavar="URL",
        names="write",
        variable="ZEROBEAM_HISTORY",
    ),
]
SerialOrAll = Annotated[str | None, argument("Serial number of one arm (all).", metavar="[SERIAL]")]
Model = Annotated[str | None, Option("Model of the arm, where several have this serial number.")]
Without = Annotated[
    Sequence[str],
    Option(
        "Exclude this parameter (delta4, link2.a): it counts as 0. Repeatable.",
        metavar="NAME",
        label="Offsets to leave out",
    ),
]
HoldOut = Annotated[
    Path | None,
    Option(
        "Another run of the same header, which the offsets must predict (as analyse --hold-out).",
        metavar="RUN",
        among="run",
        rare=True,
    ),
]
ToleranceMm = Annotated[
    float,
    Option(
        "TCP error by the offsets alone that is tolerated, mm.", least=1e-6, most=1e6, label="TCP tolerance"
    ),
]


def _sampling(typed: bool) -> Sampling:
    return "always" if typed else "never"


@dataclass(frozen=True)
class BatchSettings:
    """How all runs of a batch are solved."""

    seed: Seed = 0
    ess: Ess = 1000.0
    sampling: Annotated[
        Sampling,
        Option(
            "Sample the posterior of every run, or of none; by default where the curvature at the mode"
            " does not describe it.",
            "--posterior/--no-posterior",
            typed=bool | None,
            text=_sampling,
        ),
    ] = "where needed"
    report: Annotated[bool, Option("Write the report of each run, too.")] = False


@dataclass(frozen=True)
class CompareOptions:
    """How repeated runs are compared."""

    seed: Seed = 0


@dataclass(frozen=True)
class VerifyOptions:
    """How a corrected robot is judged."""

    tolerance: Annotated[
        float | None,
        Option("The error of an offset that must be noticed (deg; mm). Default: the header's tolerance."),
    ] = None


@dataclass(frozen=True)
class AddOptions:
    """Which history results are added to, and what is said of runs that do not say it."""

    db: Url = None
    serial: Annotated[str | None, Option("Serial number of the arm, where a run states none.", app=False)] = (
        None
    )
    when: Annotated[
        str | None,
        Option("Date of the measurements, where a run states none, or their time on its day.", app=False),
    ] = None
    replace: Annotated[bool, Option("Replace another result of the same run.")] = False
    seed: Seed = 0


@dataclass(frozen=True)
class HistoryPageOptions:
    """Of which arms of a history a page is written, and for which day."""

    serial: SerialOrAll = None
    tolerance_mm: ToleranceMm = 0.5
    as_of: Annotated[
        str | None,
        Option(
            "Day for which it is said what is overdue (default: of the last result in the history).",
            among="days",
        ),
    ] = None
    model: Model = None
    db: Url = None


@dataclass(frozen=True)
class NewRobotOptions:
    """How the arm of a new robot file is stated: by rows, by the lengths of its data sheet, or by a URDF."""

    vendor: Annotated[str | None, Option("New: who makes the arm, as in robot files.")] = None
    row: Annotated[
        list[str] | None,
        Option(
            "New: a alpha d theta lower upper [speed] of a joint, mm and degrees; once for each joint.",
            metavar="ROW",
        ),
    ] = None
    convention: Annotated[Literal["standard", "modified"], Option("New: convention of the rows.")] = (
        "standard"
    )
    below: Annotated[
        float, Option("New, with rows or a URDF: how far the mounting face is below the base frame, mm.")
    ] = 0.0
    urdf: Annotated[
        Path | None, Option("New: the URDF whose chain from --base to --tip is the arm, in rows.")
    ] = None
    sheet: Annotated[
        str | None,
        Option(
            "New: lengths of the data sheet, mm: height=…,shoulder=…,upper=…,elbow=…,forearm=…,wrist=….",
            metavar="LENGTHS",
        ),
    ] = None
    ranges: Annotated[
        list[str] | None,
        Option(
            "New, with --sheet: lower upper [speed] of a joint, degrees; once for each joint.",
            "--range",
            metavar="RANGE",
        ),
    ] = None
