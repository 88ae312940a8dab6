"""What is stated to commands that need few words, to convert positions, and to `import` and `export` of
whatever format."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from ..model.errors import BadInput
from ..model.options import J3, JOINT_3, Ess, Option, Sampling, Seed, argument

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
        "Exclude this parameter (delta4, link2.a): it counts as 0.",
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


@dataclass(frozen=True)
class BackupOptions:
    """What a backup leaves open."""

    tools: Annotated[
        Sequence[str],
        Option(
            "Pose of a tool that the backup does not state, [NAME=]X,Y,Z,… in the language's own form;"
            " without NAME that of all positions that leave it open.",
            "--tool",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    frames: Annotated[
        Sequence[str],
        Option(
            "The same of a work object, base or user frame.",
            "--frame",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    new_tools: Annotated[
        Sequence[str],
        Option(
            "Pose of a tool that was measured again since: positions are written for it.",
            "--new-tool",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    new_frames: Annotated[
        Sequence[str], Option("The same of a frame.", "--new-frame", metavar="POSE", rare=True)
    ] = ()
    base: Annotated[
        str | None,
        Option(
            "Pose of the arm's base in the world, if it is not 0 and not in the backup.",
            metavar="POSE",
            label="Base of the arm in the world",
            rare=True,
        ),
    ] = None
    near: Annotated[
        str | None,
        Option(
            "Joints J1,J2,… in degrees near which the poses without a configuration are.",
            label="Joints near poses without a configuration",
            rare=True,
        ),
    ] = None
    accept: Annotated[
        Sequence[str],
        Option(
            "Lines of the table that you have looked at: FILE:LINE, FILE:FIRST-LAST, several with commas.",
            metavar="LINES",
            label="Lines that you have looked at",
        ),
    ] = ()
    j3: Annotated[
        J3 | None,
        Option(
            "what joint 3 is counted from, if not as the robot file states.",
            label=JOINT_3,
            rare=True,
            case="fanuc",
        ),
    ] = None


@dataclass(frozen=True)
class ZeroOptions:
    """Which zeros were entered: by hand, by the mastering before and after, or as a run says."""

    robot: Annotated[
        str | None, Option("The arm: a built-in name or a robot file; with --run that of the run.", app=False)
    ] = None
    entered: Annotated[
        Sequence[str],
        Option(
            "What was entered, J2=-0.265,J3=0.112 in degrees (mm): by so much more the joint reads at the"
            " same place; joint 3 between links 2 and 3.",
            metavar="ZEROS",
        ),
    ] = ()
    run: Annotated[Path | None, Option("Run whose values were entered.", metavar="RUN")] = None
    old_mastering: Annotated[
        Path | None,
        Option(
            "Backup before the mastering, with --new-mastering: FANUC SYSMAST.VA and SYMOTN.VA, KUKA"
            " $machine.dat ($MAMES), ABB MOC.cfg (cal_offset)."
        ),
    ] = None
    new_mastering: Annotated[Path | None, Option("The same after it.")] = None
    motor_sign: Annotated[
        str | None,
        Option(
            "1 if a reading rises with cal_offset, -1 if it falls; one, or one a joint: 1,-1,…", case="ABB"
        ),
    ] = None
    ratio: Annotated[
        str | None, Option("motor turns for one turn of each joint, R1,R2,…, if not in MOC.cfg.", case="ABB")
    ] = None


@dataclass(frozen=True)
class ReachOptions:
    """By which offsets of a run calculated poses are corrected. A run that the model does not describe is
    refused, whatever is stated: these poses move a robot."""

    allow_weak: Annotated[
        bool, Option("Correct by weakly observable offsets too; the table has the U that is left.")
    ] = False
    allow_assumed: Annotated[
        bool,
        Option(
            "Correct by offsets that are only as good as what is assumed of tool and instruments too; the"
            " table names them."
        ),
    ] = False
    without: Without = ()
    hold_out: HoldOut = None


FASTEST = 60.0  # deg/s


@dataclass(frozen=True)
class ImportOptions:
    """Where a run comes from that is not in the recording: a header and its targets, or a plan."""

    header: Annotated[Path | None, Option("Header file (.yaml): robot, tool, noise.")] = None
    plan: Annotated[Path | None, Option("Plan that was measured, instead of --header and --target.")] = None
    target: Annotated[
        Sequence[str],
        Option("Target of a file: once for each file, in their order, unless the files name them."),
    ] = ()
    dry_run: Annotated[bool, Option("Say what would be imported, and write nothing.")] = False


@dataclass(frozen=True)
class ExportOptions:
    """What is exported besides what is identifiable, and what is not."""

    allow_weak: Annotated[bool, Option("Export weakly observable offsets too; the file marks them.")] = False
    allow_displaced: Annotated[
        bool, Option("Export although a target seems to have moved; the file says so.")
    ] = False
    allow_assumed: Annotated[
        bool,
        Option(
            "Export offsets that are only as good as what is assumed of tool and instruments too; the file"
            " marks them."
        ),
    ] = False
    unvalidated: Annotated[
        bool, Option("Export in spite of a misfit (the model does not describe the run); the file says so.")
    ] = False
    without: Without = ()
    hold_out: HoldOut = None


@dataclass(frozen=True)
class ProgramMotion:
    """How the program of a plan moves.

    `speed` deg/s is that of the fastest joint; `zone` rounds the path at intermediate postures, mm or percent
    as the language has it, 0 stops there; `tool` is its name or number in the controller; `register` the
    first position register for what is recorded; `listener` HOST:PORT.
    """

    speed: Annotated[float, Option("Speed of the fastest joint, degrees a second.", unit="deg/s")] = 10.0
    zone: Annotated[
        float,
        Option(
            "Rounding of intermediate postures: mm (rapid, urscript, robodk, as, val3), percent (krl,"
            " fanuc).",
            label="Rounding, mm or %",
        ),
    ] = 0.0
    tool: Annotated[
        str | None,
        Option(
            "Tool of the controller: a name (rapid, drl, as, tmscript), a number (krl, fanuc, inform, slim).",
            label="Tool of the controller",
        ),
    ] = None
    j3: Annotated[
        J3 | None,
        Option(
            "what the pendant counts joint 3 from, if not as the robot file states.",
            label=JOINT_3,
            case="fanuc, robodk, csv, pdf",
        ),
    ] = None
    register: Annotated[
        int | None,
        Option("first position register for the joints (1).", label="First register", case="fanuc"),
    ] = None
    listener: Annotated[
        str | None,
        Option(
            "HOST:PORT that the joints are sent to as well.", label="Joints also sent to", case="urscript"
        ),
    ] = None

    def __post_init__(self) -> None:
        if not 0.1 <= self.speed <= FASTEST:
            raise BadInput(
                "--speed is out of range",
                found=f"{self.speed:g}",
                allowed=f"0.1 to {FASTEST:g} degrees a second: people stand beside the arm",
            )
        if not 0 <= self.zone <= 100:
            raise BadInput(
                "--zone is out of range", found=f"{self.zone:g}", allowed="0 (stop) to 100 (mm or percent)"
            )

    def require_only(self, language: str, options: Sequence[str]) -> None:
        """BadInput for the first of the stated options that the language has no place for."""
        unset = ProgramMotion()
        for name in vars(unset):
            if name not in options and getattr(self, name) != getattr(unset, name):
                raise BadInput(f"--{name} is not for {language}", remedy=f"leave --{name} out")
