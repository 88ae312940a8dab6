"""FANUC: master counts, TP programs, position registers."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ....model.options import J3, JOINT_3, J3Origin, Option
from ..maker import Maker, OffsetFile, PlanProgram, PointNames, TaughtFormat, TaughtPoint
from ..manifest import ProgramName, ProgramTemplate, ToolName, read_taught, taught_reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ...command_options import ProgramMotion
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob


def _sheet(
    run: "Run",
    calibration: "RobotCalibration",
    j3: Annotated[
        J3 | None,
        Option("What the pendant counts joint 3 from, if not as the robot file states.", label=JOINT_3),
    ] = None,
    master_counts: Annotated[str | None, Option("Present master counts: C1,C2,…")] = None,
    pulses_per_degree: Annotated[
        str | None,
        Option("$PARAM_GROUP[1].$ENCSCALES of each joint: P1,P2,…, with --mosign, or negative if they fall."),
    ] = None,
    mosign: Annotated[
        str | None, Option("$PARAM_GROUP[1].$MOSIGN of each joint: TRUE,FALSE,…: FALSE if pulses fall.")
    ] = None,
    backup: Annotated[
        Path | None,
        Option(
            "Folder of a fresh backup, or its SYSMAST.VA: counts, pulses, signs and coupling are read.",
            among="files",
        ),
    ] = None,
) -> str:
    """FANUC: a sheet for a person, the new master counts. Nothing is applied."""
    from .mastering import FanucCounts, fanuc_text

    counts = FanucCounts.of_options(master_counts, pulses_per_degree, run.robot.n, mosign, backup)
    return fanuc_text(run.robot, calibration, counts, j3)


def _without_counts(options: Mapping[str, Any]) -> str | None:
    if options["master_counts"] is not None or options["backup"] is not None:
        return None
    return (
        "without new counts: state --backup FOLDER, or master counts, pulses per degree and signs, for them"
    )


_REGISTERS = 100


def _registers(plan: "Plan", motion: "ProgramMotion") -> Mapping[str, object]:
    """The first and the last position register that a plan's program writes, and how it counts joint 3:
    from the ground, as a FANUC does, or from link 2, as on the few controllers that are set so."""
    from ....model.errors import BadInput
    from ....model.kinematics.pendant import pendant_of

    ground = pendant_of(plan.robot, motion.j3, "fanuc").ground
    first = 1 if motion.register is None else motion.register
    last = first + len(plan.postures) - 1
    if not 1 <= first <= last <= _REGISTERS:
        raise BadInput(
            "the position registers of the postures do not exist",
            found=f"PR[{first}] to PR[{last}]",
            allowed=f"PR[1] to PR[{_REGISTERS}]",
            remedy="state another --register, or divide the plan",
        )
    counted = f"J3 counted from {'the ground' if ground else 'link 2'}"
    return {"register": first, "last": last, "counted": counted}


_PROGRAM = ProgramTemplate(
    "fanuc",
    "a TP program",
    "a TP position",
    name=ProgramName.word("program", "a FANUC", 36, "zb_plan.ls"),
    tool=ToolName(r"0*([1-9]|10)", "a tool frame number of FANUC", "1 to 10", "1"),
    quote=lambda text: text.replace(";", ","),
    more=_registers,
)


def _overwrites(plan: "Plan", motion: "ProgramMotion") -> str:
    first, last = map(_registers(plan, motion).get, ("register", "last"))
    return (
        f"the program overwrites PR[{first}] to PR[{last}], and leaves the recorded joints in them: save"
        " posreg.va before it is started, or choose others by --register N"
    )


def _named(
    text: str, points: list[TaughtPoint], first: int = 1, planned: int | None = None
) -> list[TaughtPoint]:
    """The P[n] of a listing, or position registers of group 1, by their numbers.

    Registers that a plan's program has not measured are none; with `planned` (the number of postures) so
    are those before `first` and behind the last posture, and each has its posture's number.
    """
    from ....model.errors import BadInput

    points = [point._replace(name=point.name.strip("PR[]")) for point in points]
    if _REGISTER not in text:
        if not points and "/POS" not in text:
            raise BadInput(
                "the file is not a TP program with positions",
                found="no line /POS",
                allowed="a text listing (.ls)",
                remedy="save the program as ASCII, not as .tp",
            )
        return points
    if planned is not None:
        points = [point._replace(number=int(point.name) - first) for point in points]
        points = [point for point in points if point.number in range(planned)]
    measured = [point for point in points if not point.joints or point.joints[0] != _NOT_MEASURED]
    return [
        point if point.joints or point.unread else point._replace(left_out="not in joints")
        for point in measured
    ]


_REGISTER = "$POSREG"
_NOT_MEASURED = 999.0  # deg, joint 1: what the program of a plan writes before it has measured
_FORMAT = TaughtFormat(
    "TP",
    "TP programs (.ls) or position registers (posreg.va).",
    "FANUC: positions in joint representation, taught or recorded by a plan's program.",
    (
        (r"\$POSREG", "its position registers ($POSREG)"),
        (r"^/POS\b", "its line /POS, as of a TP program"),
    ),
    named=_named,
    note="FANUC positions of group 1, angles in degrees, joint 1 first",
)


def _read(
    job: "ImportJob",
    j3: J3Origin = None,
    points: PointNames = None,
    register: Annotated[
        int, Option("the first position register of its program.", least=1, case="With --plan")
    ] = 1,
) -> "Imported":
    planned = None if job.plan is None else len(job.plan.postures)
    named = partial(_named, first=register, planned=planned)
    return read_taught(replace(_FORMAT, named=named), job, points, j3=j3)


MAKER = Maker(
    "FANUC",
    "fanuc",
    r"fanuc|lr ?mate\w*|crx\w*|arcmate|m ?\d+i[a-d]?\w*|r ?\d+i[a-d]?\w*",
    offsets=(OffsetFile("fanuc", _sheet, lacks=_without_counts),),
    program=(
        PlanProgram(
            "fanuc",
            "TP program (FANUC)",
            ("zb_plan.ls",),
            _PROGRAM,
            ("speed", "zone", "tool", "j3", "register"),
            overwrites=_overwrites,
        ),
    ),
    read=(taught_reader("fanuc", _FORMAT, _read, first=("files", "file", "j3")),),
    live="fanuc://HOST",
)
