"""What is stated to `import` and `export` of whatever format."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from ...model.errors import BadInput
from ...model.options import JOINT_3, Option
from ..command_options import HoldOut, Without

FASTEST = 60.0  # deg/s
_J3 = Literal["ground", "link"] | None


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
        _J3,
        Option(
            "fanuc, robodk, csv, pdf: what the pendant counts joint 3 from, if not as the robot file states.",
            label=JOINT_3,
        ),
    ] = None
    register: Annotated[
        int | None,
        Option("fanuc: first position register for the joints (1).", label="First register"),
    ] = None
    listener: Annotated[
        str | None,
        Option("urscript: HOST:PORT that the joints are sent to as well.", label="Joints also sent to"),
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
