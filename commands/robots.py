"""The command that shows a robot as it is understood."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..experiments.command_options import NewRobotOptions
from ..model.errors import BadInput
from ..model.options import J3Origin, Option, PendantUnit, PoseAngles, argument
from .console import EXIT_STATUS, out, print_json, show_answer
from .shared_options import Json


def robot(
    name: Annotated[
        str | None,
        argument(
            "A built-in name, a robot file (.yaml), or a URDF (.urdf); new: make a robot file.",
            metavar="ROBOT",
        ),
    ] = None,
    names: Annotated[bool, Option("Print the built-in robots.", "--list")] = False,
    joints: Annotated[
        list[str] | None,
        Option("Joint values as the pendant shows them, in any common form. Default: all zero."),
    ] = None,
    units: Annotated[
        PendantUnit | None,
        Option("Unit of --joints, if not as the robot file states (deg)."),
    ] = None,
    j3: J3Origin = None,
    pose: Annotated[
        list[str] | None,
        Option(
            "Pose of the flange that the pendant shows at the --joints of the same number: X, Y, Z and"
            " the maker's angles, base frame, no tool. Says which entry of the file is wrong.",
            metavar="POSE",
        ),
    ] = None,
    angles: Annotated[PoseAngles | None, Option("Form of the angles of --pose, if not the maker's.")] = None,
    base: Annotated[str | None, Option("First link of a URDF's chain.")] = None,
    tip: Annotated[str | None, Option("Its last link.")] = None,
    picture: Annotated[Path | None, Option("Write a page with the arm in 3D (.html).")] = None,
    as_json: Json = False,
    file: Annotated[
        Path | None, Option("Robot file to write (.yaml): new, or a copy of ROBOT to be edited.", "-o --out")
    ] = None,
    pulses: Annotated[
        str | None,
        Option(
            "With -o, of a pendant that shows pulses: how many for a degree of each joint, negative"
            " where they fall: P1,P2,….",
            "--pulses-per-deg",
            metavar="PULSES",
        ),
    ] = None,
    *,
    new: NewRobotOptions,
    fanuc_backup: Annotated[
        Path | None,
        Option(
            "With -o, of a FANUC: folder of a backup (SYSMAST.VA, SYMOTN.VA), which says what the"
            " encoder of joint 3 measures.",
            metavar="FOLDER",
        ),
    ] = None,
) -> None:
    """Show a robot, compare its file with a pendant, or make a robot file.

    Shown: mounting face, counting of the pendant, joints, reach, flange's pose.
    With --pose: which entry of the file disagrees with the pendant (status 1).
    new: made from rows, a data sheet or a URDF. With -o: a copy of another's.
    """
    from ..experiments.arm_shown import typed_arm
    from ..experiments.new_robot import copy_robot, stated_arm, with_fanuc_backup, write_robot
    from ..model.files.header import UrdfRef
    from ..model.files.robot_file import built_in_robots
    from ..reports.output.terminal import print_rows
    from ..reports.plan.robot_page import robot_page, robots_table
    from ..words.sentences import to_json

    if names:
        if as_json:
            print_json({"robots": list(built_in_robots())})
        else:
            print_rows(out, robots_table())
        return
    if name is None:
        raise BadInput(
            "which robot?", allowed="a built-in name (--list), a robot file (.yaml), or a URDF (.urdf)"
        )
    if name == "new":
        if file is None or new.vendor is None:
            raise BadInput(
                "a new robot has a file and a maker",
                allowed="-o FILE.yaml and --vendor MAKER",
                remedy="zerobeam robot new -o mine.yaml --vendor doosan, with the maker of your arm",
            )
        made, head = stated_arm(file.stem, new, base, tip)
        write_robot(file, with_fanuc_backup(made, fanuc_backup), head)
        base = tip = None
        name = str(file)
        if picture is None:
            picture = file.with_suffix(".html")
    elif file is not None:
        copy_robot(name, file, pulses, fanuc_backup)
        name = str(file)
    elif pulses is not None or fanuc_backup is not None:
        option = "--pulses-per-deg" if pulses is not None else "what --fanuc-backup says"
        raise BadInput(f"{option} is written into a robot file", remedy="name the file: -o mine.yaml")
    if (base is None) != (tip is None):
        raise BadInput("a URDF's chain has two ends", remedy="state both --base and --tip")
    ref = name if base is None or tip is None else UrdfRef(urdf=name, base=base, tip=tip)
    arm = typed_arm(ref, joints or [], units=units, j3=j3, poses=pose or [], angles=angles)
    if picture is not None:
        from ..reports.scene import write_arm_page

        write_arm_page(picture, arm.robot, [pose.joints for pose in arm.poses])
    show_answer(as_json, to_json(arm), lambda: robot_page(arm), picture=picture)
    if arm.check is not None and not arm.check.agrees:
        raise typer.Exit(EXIT_STATUS["misfit"])
