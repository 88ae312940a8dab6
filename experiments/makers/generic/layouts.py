"""What is stated of tables: of joint positions, and of points with the joints at them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ....model.errors import BadInput
from ....model.options import J3Origin, Option, PendantUnit, names_typed
from ..maker import Decimal, MarkerColumn, StillDeg, StillMm, StillSeconds

if TYPE_CHECKING:
    from ....model.arrays import Matrix
    from ....model.kinematics.robot import Robot

_BY_NUMBER, _BY_TIME = ("--match=number",), ("--match=time",)
_ANGLES = ("--rotation-columns",)
_OF_JOINTS = "columns of the joints"
_BOUNDS = {"still_deg": (1e-9, 360.0), "still_s": (1e-3, 1e6), "still_mm": (1e-9, 1e6)}


def _names(help: str, flag: str | None = None) -> Option:
    """Names of columns or joints, separated by commas."""
    return Option(help, flag, text=names_typed)


def _column(help: str, label: str) -> Option:
    return Option(help, label=label, among="columns")


def require_columns(flag: str, names: Sequence[str] | None, count: int) -> None:
    """BadInput where the columns of an option, if it is stated, are not so many different ones."""
    if names is not None and (len(names) != count or len(set(names)) != count):
        raise BadInput(
            f"{flag} has not {count} columns",
            found=", ".join(names),
            allowed=f"{count} different ones",
        )


@dataclass(frozen=True)
class Stillness:
    """The definition of a dwell: every joint within so many degrees (prismatic: mm) for at least so many
    seconds."""

    still_deg: StillDeg = None
    still_s: StillSeconds = None
    still_mm: StillMm = None

    @property
    def defined(self) -> bool:
        """Whether it is; BadInput for half of it."""
        if (self.still_deg is None) != (self.still_s is None) or (self.still_mm and self.still_s is None):
            raise BadInput(
                "a dwell needs a tolerance and a time",
                remedy="state both --still-deg and --still-s, or neither",
            )
        return self.still_s is not None

    def required(self) -> "Stillness":
        """Itself; BadInput where it is not stated."""
        if not self.defined:
            raise BadInput(
                "a recording over time needs to know what a dwell is",
                remedy="state --still-deg and --still-s",
            )
        return self

    @property
    def seconds(self) -> float:
        """The shortest dwell."""
        return self.required().still_s or 0.0

    def __str__(self) -> str:
        return f"joints within {self.still_deg:g} deg for {self.still_s:g} s"

    def tolerance(self, robot: "Robot") -> "Matrix":
        """(n,) degrees or mm; BadInput for a value that is missing or not above zero."""
        import numpy as np

        slides = [joint.kind == "prismatic" for joint in robot.joints]
        if any(slides) and self.still_mm is None:
            raise BadInput(
                "the tolerance of a dwell is not stated for the prismatic joints",
                found=f"{robot.name} has prismatic joints",
                remedy="state it in mm (--still-mm)",
            )
        for name, (least, most) in _BOUNDS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise BadInput(
                    f"the value of --{name.replace('_', '-')} is out of range",
                    found=f"{value:g}",
                    allowed=f"a number above 0, from {least:g} to {most:g}",
                )
        return np.array([self.still_mm if slide else self.still_deg for slide in slides], dtype=float)


NO_DWELLS = Stillness()


@dataclass(frozen=True)
class CsvLayout:
    """The layout of CSV files. Columns are stated by name (with a `header_row`) or number, from 1.

    Without `columns` the files hold only joints, in the pendant's order. `lengths` is required if there are
    prismatic joints. `changes_only`: rows only where the joints changed, each valid until the next.
    """

    units: Annotated[PendantUnit, Option("Unit of the angles.")]
    target_column: Annotated[
        str | None, _column("Column with each row's target, instead.", "Target of each row")
    ] = None
    lengths: Annotated[Literal["mm", "m"] | None, Option("Unit of prismatic joints.")] = None
    header_row: Annotated[bool, Option("The first row names the columns.")] = False
    columns: Annotated[
        Sequence[str] | None,
        _names(
            "Columns of joint 1, 2, …: a,b,c by name (with --header-row) or number, from 1; or A1=j1,A2=j2,…"
            " in any order."
        ),
    ] = None
    delimiter: Annotated[str | None, Option("Delimiter between two values; found if not stated.")] = None
    decimal: Decimal = "."
    j3: J3Origin = None
    spot_columns: Annotated[Sequence[str] | None, _names("Columns of spot_mm: dx,dy in mm.")] = None
    shot_column: Annotated[
        str | None, _column("Column of the measurement numbers.", "Measurement number")
    ] = None
    time_column: Annotated[str | None, Option("Column of times.", among="columns")] = None
    time_units: Annotated[
        Literal["s", "ms", "us", "ns"] | None, Option("Unit of the times.", needs=("--time-column",))
    ] = None
    marker_column: MarkerColumn = None
    small_angles: Annotated[
        bool, Option("The angles are in degrees, although all are as small as radians would be.")
    ] = False
    reversed_joints: Annotated[
        Sequence[str], _names("Joints recorded with the other sign: j2,j5,… or names.", "--reversed")
    ] = ()
    changes_only: bool = False

    def check(self, *, dwells: bool) -> None:
        """BadInput for a layout that no file can have, and for one in which `dwells` cannot be found."""
        from ....model.files.text_tables import PER_SECOND, check_signs

        check_signs(self.delimiter, self.decimal)
        if self.time_column is not None and self.time_units is None:
            raise BadInput("the unit of the times is not stated", allowed=", ".join(PER_SECOND))
        require_columns("--spot-columns", self.spot_columns, 2)
        if not self.header_row and not all("=" in name or name.isdecimal() for name in self.columns or ()):
            raise BadInput(
                "columns are given by name, but no header row is stated",
                remedy="state the header row, if the files have one, or give numbers from 1",
            )
        if not dwells and self.marker_column is not None:
            raise BadInput(
                "a column of markers is stated, but not what counts as a dwell",
                remedy="state the tolerance and the shortest time (--still-deg, --still-s)",
            )
        if dwells and self.time_column is None:
            raise BadInput("dwells can be found only with a column of times", remedy="state it and its unit")
        if dwells and self.shot_column is not None:
            raise BadInput(
                "a dwell has many rows, and no number of its own", remedy="leave out the column of numbers"
            )
        if dwells and self.target_column is not None and self.marker_column is None:
            raise BadInput(
                "the target of a dwell cannot be read from a column without markers",
                remedy="state a marker column, or one target for each file",
            )

    @property
    def others(self) -> Mapping[str, str]:
        """The columns that are not joints, by what they are."""
        columns = {
            "target": self.target_column,
            "measurement number": self.shot_column,
            "spot in mm (dx, dy)": ", ".join(self.spot_columns or ()),
            f"time in {self.time_units}": self.time_column,
            "marker": self.marker_column,
        }
        return {what: column for what, column in columns.items() if column}


@dataclass(frozen=True)
class PointLayout:
    """What is stated of a table of points and of the joints beside it. Columns are names, or numbers from 1.

    Several markers in a row: `columns` are three for each, and `reflector` names them in that order.
    `inverse` None: it is looked at whether another reading of the poses fits.
    """

    joint_columns: Annotated[
        Sequence[str],
        _names("Columns of joint 1, 2, …: a,b,c by name or number, from 1; or A1=j1,A2=j2,… in any order."),
    ]
    joint_units: Annotated[Literal["deg", "rad"], Option("Unit of the joints.")]
    units: Annotated[
        Literal["mm", "m", "inch"] | None, Option("Unit of the coordinates, unless the file says it.")
    ] = None
    columns: Annotated[
        Sequence[str] | None, _names("Columns of x,y,z, by name or number (default: by these names).")
    ] = None
    instrument: Annotated[str | None, Option("Instrument of the header, if it states several.")] = None
    reflector: Annotated[
        str | None,
        Option("Reflector of all points, if there are several; or of each marker in a row: R1,R2,…"),
    ] = None
    reflector_column: Annotated[
        str | None, Option("Column with each point's reflector, instead.", among="columns")
    ] = None
    joints: Annotated[
        Path | None,
        Option(
            "Table of the joints, if they are not in the same table as the points.",
            label="Table of the joints",
            among="tables",
        ),
    ] = None
    match: Annotated[
        Literal["number", "time"] | None,
        Option(
            "What joins a point of FILE and a row of --joints.",
            label="Points and joints belong together by",
            needs=("--joints",),
        ),
    ] = None
    number_column: Annotated[
        str | None,
        Option(
            "Column of the points' numbers, or names that end with them.", among="columns", needs=_BY_NUMBER
        ),
    ] = None
    joints_number_column: Annotated[
        str | None,
        Option("The same of --joints; without both: row by row.", among=_OF_JOINTS, needs=_BY_NUMBER),
    ] = None
    time_column: Annotated[
        str | None, Option("Column of the points' times.", among="columns", needs=_BY_TIME)
    ] = None
    time_units: Annotated[
        str | None,
        Option("Their unit: s, ms, us, ns, iso, or a pattern such as %d.%m.%Y %H:%M:%S.", needs=_BY_TIME),
    ] = None
    joints_time_column: Annotated[
        str | None, Option("Column of times of --joints.", among=_OF_JOINTS, needs=_BY_TIME)
    ] = None
    joints_time_units: Annotated[str | None, Option("Their unit, if it is another one.", needs=_BY_TIME)] = (
        None
    )
    within_s: Annotated[
        float | None,
        Option("Largest time between a point and its joints, seconds.", label="Largest time", needs=_BY_TIME),
    ] = None
    rotation_columns: Annotated[
        Sequence[str] | None, _names("Of poses: columns of three angles, a,b,c, in the order of --euler.")
    ] = None
    rotation_units: Annotated[
        Literal["deg", "rad"] | None, Option("Unit of these angles.", needs=_ANGLES)
    ] = None
    euler: Annotated[
        str | None,
        Option(
            "Axes in the order of the columns, fixed or moving with the body: XYZ-fixed, ZYX-moving, …; find:"
            " the order that fits the nominal arm; vector: a rotation vector, as of UR.",
            label="Axes of the angles",
            needs=_ANGLES,
        ),
    ] = None
    quaternion_columns: Annotated[
        Sequence[str] | None, _names("Of poses: columns w,x,y,z instead of angles.")
    ] = None
    inverse: Annotated[
        str | None,
        Option(
            "Of poses: the table has the inverse rotation, the inverse pose, or none. Default: looked at."
        ),
    ] = None
    uncertainty: Annotated[
        Literal["1sigma", "95", "none"] | None,
        Option("Level of the uncertainty columns; none: they are not used."),
    ] = None
    uncertainty_columns: Annotated[
        Sequence[str] | None, _names("Columns of the uncertainty of x,y,z (default: by names such as U-x).")
    ] = None
    lengths: Annotated[Literal["mm", "m"] | None, Option("Unit of prismatic joints.")] = None
    delimiter: Annotated[str | None, Option("Delimiter of FILE; found if not stated.")] = None
    decimal: Decimal = "."
    j3: J3Origin = None
    small_angles: Annotated[
        bool, Option("The joints are in degrees, although all are as small as radians would be.")
    ] = False

    def check(self) -> None:
        """BadInput for options that contradict each other, or of which one is missing."""
        from ....model.files.text_tables import check_signs

        check_signs(self.delimiter, self.decimal)
        if self.joints is not None and self.match is None:
            raise BadInput(
                "it is not stated how points and joints belong together",
                found=f"--joints {self.joints}",
                allowed="--match number or --match time",
            )
        if self.joints is None and self.match is not None:
            raise BadInput(
                "there is nothing to match the points with",
                found=f"--match {self.match}",
                remedy="state --joints TABLE, or leave out --match where the points have joints beside them",
            )
        if self.match == "time":
            needed = {
                "--time-column": self.time_column,
                "--time-units": self.time_units,
                "--joints-time-column": self.joints_time_column,
                "--within-s": self.within_s,
            }
            if missing := [flag for flag, value in needed.items() if value is None]:
                raise BadInput("--match time needs more", found=f"no {missing[0]}", allowed=", ".join(needed))
            if not (self.within_s or 0) > 0:
                raise BadInput("no time is within that", found=f"--within-s {self.within_s}", allowed="> 0")
        if self.match == "number" and (self.number_column is None) != (self.joints_number_column is None):
            raise BadInput(
                "only one of the tables has numbers",
                found="--number-column" if self.number_column else "--joints-number-column",
                allowed="--number-column and --joints-number-column, or neither: then row by row",
            )
        if self.rotation_columns is not None and (self.euler is None or self.rotation_units is None):
            raise BadInput(
                "angles of an orientation without their order and unit",
                found="--euler is missing" if self.euler is None else "--rotation-units is missing",
                allowed="--euler XYZ-fixed, ZYX-moving, … or find; --rotation-units deg or rad",
            )
        if self.rotation_columns is not None and self.quaternion_columns is not None:
            raise BadInput(
                "an orientation is stated twice",
                found="--rotation-columns and --quaternion-columns",
                allowed="one of them",
            )
        poses = self.rotation_columns is not None or self.quaternion_columns is not None
        if self.inverse not in (None, "none", "rotation", "pose"):
            raise BadInput(
                "no such inverse of poses",
                found=f"--inverse {self.inverse}",
                allowed="none, rotation or pose",
            )
        if self.inverse is not None and not poses:
            raise BadInput(
                "an inverse is stated, but no orientation",
                found=f"--inverse {self.inverse}",
                allowed="--inverse with --quaternion-columns or --rotation-columns",
            )
        if poses and len(self.markers) > 1:
            raise BadInput(
                "poses of several markers in a row are not read",
                found=f"{len(self.columns or ())} columns",
                allowed="three columns of one position",
            )
        require_columns("--columns", self.columns, 3 * len(self.markers))
        require_columns("--rotation-columns", self.rotation_columns, 3)
        require_columns("--quaternion-columns", self.quaternion_columns, 4)
        require_columns("--uncertainty-columns", self.uncertainty_columns, 3)
        if self.reflector is not None and self.reflector_column is not None:
            raise BadInput(
                "reflectors are stated both by name and by a column", remedy="state one of the two"
            )

    @property
    def markers(self) -> tuple[str, ...]:
        """The reflectors of the positions in a row, in their order; "" of one without a name."""
        names = [name.strip() for name in (self.reflector or "").split(",")]
        if len(set(names)) != len(names):
            raise BadInput("a reflector is named twice", found=self.reflector, argument="reflector")
        return tuple(names)
