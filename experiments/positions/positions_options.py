"""What is stated to convert positions: the arm, the zeros, and what the backup leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from ...model.options import JOINT_3, Option
from ..command_options import HoldOut, Without


@dataclass(frozen=True)
class BackupOptions:
    """What a backup leaves open."""

    tools: Annotated[
        Sequence[str],
        Option(
            "Pose of a tool that the backup does not state, [NAME=]X,Y,Z,… in the language's own form;"
            " without NAME that of all positions that leave it open. Repeatable.",
            "--tool",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    frames: Annotated[
        Sequence[str],
        Option(
            "The same of a work object, base or user frame. Repeatable.",
            "--frame",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    new_tools: Annotated[
        Sequence[str],
        Option(
            "Pose of a tool that was measured again since: positions are written for it. Repeatable.",
            "--new-tool",
            metavar="POSE",
            rare=True,
        ),
    ] = ()
    new_frames: Annotated[
        Sequence[str], Option("The same of a frame. Repeatable.", "--new-frame", metavar="POSE", rare=True)
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
        Literal["ground", "link"] | None,
        Option(
            "fanuc: what joint 3 is counted from, if not as the robot file states.", label=JOINT_3, rare=True
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
            " same place; joint 3 between links 2 and 3. Repeatable.",
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
        Option("ABB: 1 if a reading rises with cal_offset, -1 if it falls; one, or one a joint: 1,-1,…"),
    ] = None
    ratio: Annotated[
        str | None, Option("ABB: motor turns for one turn of each joint, R1,R2,…, if not in MOC.cfg.")
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
