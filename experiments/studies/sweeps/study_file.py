"""Study files (YAML, `zerobeam/study-file/1`): a base of settings, and axes along which some of them change.

Every combination of the axes' values is a case. The built-in studies are such files too.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, model_validator

from ....model.errors import BadInput, located
from ....model.files.header import (
    GeometryOfArm,
    Header,
    RobotRef,
    StatedGeometry,
    StatedNoise,
    StatedPrior,
    StatedTarget,
    StatedTolerance,
    StatedTool,
    check_header,
)
from ....model.files.robot_file import load_robot
from ....model.kinematics.robot import Robot
from ....model.likelihood.geometry import Geometry
from ....model.likelihood.noise import NoiseModel
from ....model.likelihood.parameters import Parameters
from ....model.parsing.reading import Document, KeyPath, did_you_mean, read_yaml, shown
from ....model.parsing.validation import (
    FileModel,
    Name,
    Positive,
    Vector,
    refusal,
    validate,
    with_length,
)
from ....words import numbers
from ...measuring_options import (
    AcceptanceDeg,
    CriterionOfPlan,
    FlangeRoll,
    LineDistance,
    LineHeight,
    LineWidth,
    MarginDeg,
    Pattern,
    PlanOptions,
)

STUDY_FILE_SCHEMA: Literal["zerobeam/study-file/1"] = "zerobeam/study-file/1"
OTHER_STUDIES = (
    "coverage",
    "cell",
    "table2",
    "geometry",
    "drift",
    "wrong-models",
    "instruments",
)  # their answers have another shape
TARGET = "psd"
_FOLDER = Path(__file__).parent
_MOST_CASES = 10_000
_MOST_RUNS = 100_000

Cost = Literal["likelihood", "midpoint"]
Scalar = bool | int | float | str
SettingValues = dict[str, object]  # values of settings, by name as in a file


def as_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def _costs(value: object) -> object:
    if isinstance(value, list | tuple) and "likelihood" not in value:
        raise refusal(
            "the likelihood fit is missing",
            found=shown(list(value)),
            allowed="[likelihood] or [likelihood, midpoint]",
            remedy="add likelihood: the predictions are of its scatter",
        )
    return as_tuple(value)


def _pair(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refusal("a list of 2 numbers is wanted", found=shown(value), allowed="[shortest, longest]")
    return tuple(value)


class PlacedTarget(FileModel):
    """The target of all measurements."""

    xyz_mm: Vector = Field(description="nominal position, base frame, millimetres")
    sigma_mm: Positive = Field(
        default=30.0,
        description="prior standard deviation in each direction, millimetres; true positions are random",
    )


class PlanMaking(FileModel):
    """How the plan of a case is made."""

    kind: Pattern = Field(
        default="optimal", description="the paper's X- or Y-Pattern, or the best of many candidates"
    )
    shots: Annotated[int, Field(ge=1, le=10_000)] = Field(default=7, description="number of measurements")
    span: Positive | None = Field(
        default=None,
        description="length of a pattern's line as a share of the arm's reach; default: the pattern's own",
    )
    distance_mm: LineDistance = None
    height_mm: LineHeight = None
    width_mm: LineWidth = None
    roll_deg: FlangeRoll = None
    candidates: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=1000, description="postures that an optimal plan is chosen from"
    )
    criterion: CriterionOfPlan = PlanOptions.criterion
    facing: (
        Annotated[Vector, with_length("the normal of the face", "any vector but zero, or null")] | None
    ) = Field(
        default=(0.0, 0.0, 1.0),
        description="outward normal of the target's face, base frame, any length; null: any side",
    )
    acceptance_deg: Annotated[AcceptanceDeg, Field(gt=0, le=90)] = PlanOptions.acceptance_deg
    beam_mm: Annotated[tuple[float, float], BeforeValidator(_pair)] = Field(
        default=(200.0, 2000.0), description="shortest and longest beam, millimetres"
    )
    margin_deg: MarginDeg = PlanOptions.margin_deg

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if not 0 <= self.beam_mm[0] < self.beam_mm[1]:
            raise refusal(
                "no beam is within the stated lengths",
                key=("beam_mm",),
                found=shown(list(self.beam_mm)),
                allowed="a shortest beam of 0 or more and below the longest",
            )
        if self.span is not None and self.width_mm is not None:
            raise refusal(
                "span and width_mm state the same length",
                key=("width_mm",),
                found=f"span: {self.span:g}, width_mm: {self.width_mm:g}",
                remedy="state one of them",
            )
        return self


class Settings(FileModel):
    """Everything that a case depends on, except the seed."""

    robot: RobotRef = Field(
        description="a built-in name, the path of a robot file (.yaml), or a chain of a URDF file"
    )
    tool: StatedTool = Field(description="what the flange carries, as in a header")
    noise: StatedNoise = Field(description="standard deviations of the readings, as in a header")
    prior: StatedPrior = Field(
        default=StatedPrior(),
        description="of the offsets, as in a header; true offsets are random draws from it",
    )
    held: Annotated[tuple[Name, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="names of the parameters that are not estimated, as in a header"
    )
    tolerance: StatedTolerance = Field(
        default=StatedTolerance(),
        description="largest standard uncertainty that counts as identified, as in a header",
    )
    geometry: GeometryOfArm = Field(
        default=None,
        description="how far arms deviate from nominal geometry, as in a header; true links are random draws"
        " from it",
    )
    target: PlacedTarget = Field(description="position of the target")
    plan: PlanMaking = Field(default=PlanMaking(), description="how the plan is made")
    runs: Annotated[int, Field(ge=0, le=_MOST_RUNS)] = Field(
        default=200, description="simulated runs of each case; 0: prediction only"
    )
    costs: Annotated[tuple[Cost, ...], BeforeValidator(_costs)] = Field(
        default=("likelihood",), description="fits of each run; midpoint is the paper's (eq. 8)"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        geometry = self.geometry if isinstance(self.geometry, StatedGeometry) else StatedGeometry()
        known = "the noise of a study is known: the runs are simulated with it"
        drawn = "the tolerances of a study are known: its arms are random draws from them"
        sizes = "a study states the tolerances of its arms itself"
        to_state = "state tolerance, gravity_deg and harmonics_deg"
        for of, key, value, only, what, remedy in (
            ("noise", "scale", self.noise.scale, "known", known, "remove scale"),
            ("geometry", "scale", geometry.scale, "known", drawn, "remove scale"),
            ("geometry", "tolerances", geometry.tolerances, None, sizes, to_state),
        ):
            if value != only:
                raise refusal(what, key=(of, key), found=f"{key}: {value}", remedy=remedy)
        return self

    def as_in_file(self, *, without: tuple[str, ...] = ()) -> SettingValues:
        """All settings but those of the names `without`; no geometry where none is stated."""
        values = self.model_dump(mode="json", by_alias=True, exclude=set(without))
        return {key: value for key, value in values.items() if key != "geometry" or value is not None}

    def header(self) -> Header:
        """The header that a plan of these settings would have."""
        target = StatedTarget(guess_mm=self.target.xyz_mm, sigma_mm=self.target.sigma_mm)
        return Header(
            robot=self.robot,
            tool=self.tool,
            noise=self.noise,
            prior=self.prior,
            held=self.held,
            tolerance=self.tolerance,
            geometry=self.geometry,
            targets={TARGET: target},
        )


@cache
def setting_names() -> tuple[str, ...]:
    """Dotted names of all settings."""
    return tuple(_names(Settings, ""))


def _names(model: type[FileModel], prefix: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}"
        for inner in _models(field.annotation):
            yield from _names(inner, f"{prefix}{name}.")


def _models(annotation: object) -> Iterator[type[FileModel]]:
    """The model of a setting, also of an optional one or one among several kinds."""
    if isinstance(annotation, type) and issubclass(annotation, FileModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def overlap(one: str, other: str) -> bool:
    """Whether two dotted names are the same setting, or one is a part of the other."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _value(value: object) -> object:
    """One value of an axis, before pydantic tries what it might be."""
    if isinstance(value, list) and len(value) == 3:
        return tuple(value)
    if isinstance(value, bool | int | float | str | tuple | dict | NamedChange):
        return value
    raise refusal(
        "this cannot be a value of an axis",
        found=shown(value),
        allowed="a number, a word, true or false, [x, y, z], or {name: …, set: {SETTING: value, …}}",
    )


def _require_once(what: str, key: str, values: Sequence[object], show: Callable[[object], str] = str) -> None:
    for i, one in enumerate(values):
        if one in values[:i]:
            raise refusal(what, key=(key, i), found=show(one))


class NamedChange(FileModel):
    """A value of an axis that changes several settings at once."""

    name: Name = Field(description="what reports call it")
    set_: dict[Name, object] = Field(
        alias="set", description="values by the dotted name of the setting, such as plan.shots"
    )


AxisValue = Annotated[Scalar | Vector | NamedChange, BeforeValidator(_value)]


class Axis(FileModel):
    """What changes from case to case."""

    key: Name = Field(
        description="dotted name of the setting, such as noise.joint_deg, or target.xyz_mm.x for one"
        " coordinate; free where every value is named"
    )
    label: Name | None = Field(default=None, description="what reports call it; default: the key")
    unit: str = Field(default="", description="unit of the values, for reports")
    values: Annotated[tuple[AxisValue, ...], BeforeValidator(as_tuple), Field(min_length=1)] = Field(
        description="numbers, words, true or false, [x, y, z], or {name, set} to change several settings"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        _require_once("duplicate value of an axis", "values", self.shown_values, shown)
        return self

    @property
    def name(self) -> str:
        """The label, or else the key."""
        return self.label or self.key

    @property
    def shown_values(self) -> tuple[int | float | str, ...]:
        """The values as numbers or words."""
        return tuple(map(_shown_value, self.values))

    def changes(self, index: int) -> SettingValues:
        """The settings that a value of the axis changes, by their dotted names."""
        value = self.values[index]
        return dict(value.set_) if isinstance(value, NamedChange) else {self.key: value}

    def words(self, index: int) -> str:
        """A value in words: `joint noise 0.01°`, or the name of a change."""
        value = self.shown_values[index]
        if isinstance(self.values[index], NamedChange):
            return str(value)
        text = f"{value} {self.unit}".rstrip() if isinstance(value, str) else numbers.exact(value, self.unit)
        return f"{self.name} {text}"


def _shown_value(value: Scalar | Vector | NamedChange) -> int | float | str:
    if isinstance(value, NamedChange):
        return value.name
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"[{', '.join(f'{v:g}' for v in value)}]" if isinstance(value, tuple) else value


class StudyFile(FileModel):
    """The content of a study file."""

    schema_: Literal["zerobeam/study-file/1"] = Field(
        alias="schema", description="kind and version of the file"
    )
    study: Name = Field(description="name of the study")
    title: Name = Field(description="what is asked")
    base: Settings = Field(description="the settings of all cases, where no axis changes them")
    axes: Annotated[tuple[Axis, ...], BeforeValidator(as_tuple), Field(min_length=1)] = Field(
        description="what changes; every combination of their values is a case"
    )
    beside: Annotated[tuple[NamedChange, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="single cases to compare with: the base with changes of their own, no axis"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.study in OTHER_STUDIES:
            raise refusal(
                "this is the name of another kind of study",
                key=("study",),
                found=self.study,
                allowed=f"any name but {', '.join(OTHER_STUDIES)}",
            )
        _require_once("two axes have the same key", "axes", [axis.key for axis in self.axes])
        taken: dict[str, int] = {}
        for i, axis in enumerate(self.axes):
            for name in dict.fromkeys(_changed(axis)):
                other = next((old for old in taken if overlap(old, name)), None)
                if other is not None and taken[other] != i:
                    raise refusal(
                        "two axes change the same setting",
                        key=("axes", i),
                        found=f"{other} and {name}",
                        remedy="change it along one of them",
                    )
                taken[name] = i
        names = [one.name for one in self.beside]
        _require_once("two cases beside the grid have the same name", "beside", names)
        count = math.prod(len(axis.values) for axis in self.axes)
        if count > _MOST_CASES:
            raise refusal(
                "the study is too large", key=("axes",), found=f"{count} cases", allowed=_MOST_CASES
            )
        return self


@dataclass(frozen=True, eq=False)
class Case:
    """One combination: `at` has the index of its value on every axis; empty of a case beside the grid."""

    at: tuple[int, ...]
    words: str
    settings: Settings
    header: Header
    robot: Robot

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that the case's answer depends on, besides seed and versions."""
        return self._digest(self.settings.as_in_file(without=("robot",)))

    @property
    def pattern_print(self) -> str:
        """SHA-256 of all that the postures of a pattern depend on."""
        return self._digest(self.settings.model_dump(mode="json", include={"tool", "target", "plan"}))

    def _digest(self, settings: SettingValues) -> str:
        parts = [self.robot.name, json.dumps(settings)]
        for joint in self.robot.joints:
            values = [*joint.fixed.ravel(), *joint.axis, joint.lower, joint.upper]
            parts.append(f"{joint.name} {joint.kind} {joint.speed} {[float(v).hex() for v in values]}")
        parts.append(str([float(v).hex() for v in self.robot.flange.ravel()]))
        if self.robot.conventions.range3 is not None:
            parts.append(str([v.hex() for v in self.robot.conventions.range3]))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class SettingsStudy:
    """A study file that was read: its content, and its cases in order (the last axis changes fastest)."""

    content: StudyFile
    cases: tuple[Case, ...]
    beside: tuple[Case, ...]
    file: str
    sha256: str


def built_in_studies() -> tuple[str, ...]:
    """Names of the studies that come with the program."""
    return tuple(sorted(entry.stem for entry in _FOLDER.glob("*.yaml")))


def built_in_study(name: str) -> Path:
    """The study file of a built-in study. BadInput where there is none of this name."""
    if name not in built_in_studies():
        raise BadInput(
            "there is no built-in study of this name",
            found=name,
            allowed=", ".join(built_in_studies()),
            remedy=did_you_mean(name, built_in_studies()),
        )
    return _FOLDER / f"{name}.yaml"


def read_study(path: Path | str, runs: int | None = None) -> SettingsStudy:
    """A study file, every case of it checked; `runs` in the place of the base's."""
    document = read_yaml(Path(path))
    schema = document.data.get("schema") if isinstance(document.data, dict) else None
    if schema != STUDY_FILE_SCHEMA:
        raise BadInput(
            "this is not a study file of this version",
            found="no 'schema' key" if schema is None else f"schema: {shown(schema)}",
            allowed=f"schema: {STUDY_FILE_SCHEMA}",
            file=document.file,
            line=document.line(("schema",)),
        )
    content = validate(StudyFile, document.data, file=document.file, line=document.line)
    if runs is not None:
        every = [key for axis in content.axes for key in _changed(axis)]
        every += [key for one in content.beside for key in one.set_]
        if any(overlap(key, "runs") for key in every):
            raise BadInput(
                "both the cases of the study and --runs set the number of runs",
                found=f"--runs {runs}",
                remedy="leave out --runs",
                file=document.file,
                line=document.line(("axes",)),
            )
        settings = {**content.base.model_dump(mode="json", by_alias=True, exclude_unset=True), "runs": runs}
        base = validate(Settings, settings, file=None, line=lambda _: None)
        content = content.model_copy(update={"base": base})
    case, cases = partial(_case, content, document, dict[str, Robot]()), []
    for at in product(*(range(len(axis.values)) for axis in content.axes)):
        by_axis = [(i, axis, j) for i, (axis, j) in enumerate(zip(content.axes, at, strict=True))]
        words = ", ".join(axis.words(j) for _, axis, j in by_axis)
        cases.append(case(at, words, [(("axes", i, "values", j), axis.changes(j)) for i, axis, j in by_axis]))
    beside = [case((), one.name, [(("beside", i), one.set_)]) for i, one in enumerate(content.beside)]
    return SettingsStudy(content, tuple(cases), tuple(beside), document.file.name, document.sha256)


def _changed(axis: Axis) -> Iterator[str]:
    for j in range(len(axis.values)):
        yield from axis.changes(j)


def _case(
    content: StudyFile,
    document: Document,
    robots: dict[str, Robot],
    at: tuple[int, ...],
    words: str,
    changes: Iterable[tuple[KeyPath, SettingValues]],
) -> Case:
    """The settings of one case: the base with changes, each with its place in the file; BadInput at the line
    of the value that does not suit. `robots` are those of the cases before."""
    # The settings that the file has, and those with defaults.
    values = content.base.model_dump(mode="json", by_alias=True, exclude_unset=True)
    defaults, value_places = content.base.model_dump(mode="json", by_alias=True), dict[str, KeyPath]()
    for of_value, changed in changes:
        for key, value in changed.items():
            with located(document.file, document.line(of_value)):
                _put(values, defaults, key, value)
            value_places[key] = of_value

    def line(key_path: KeyPath) -> int | None:
        dotted = ".".join(map(str, key_path))
        of_value = next((at for key, at in value_places.items() if overlap(key, dotted)), None)
        return document.line(of_value or ("base", *key_path))

    settings = validate(Settings, values, file=document.file, line=line)
    header, ref = settings.header(), json.dumps(values["robot"])
    if ref not in robots:
        robots[ref] = load_robot(
            settings.robot, document.file.parent, file=document.file, line=line(("robot",))
        )
    robot = robots[ref]
    check_header(header, robot, file=document.file, line=line)
    with located(document.file, line(("held",))):
        (label,) = header.labels
        tool = header.made(label, robot.n)
        noise, geometry = NoiseModel.from_header(header, robot, tool), Geometry.from_header(header, robot)
        Parameters.build(robot, tool, noise, geometry, header, {TARGET: tool})
    return Case(at, words, settings, header, robot)


def _put(values: SettingValues, every: SettingValues, key: str, value: object) -> None:
    """Set a dotted name in `values`; its last part may be the x, y or z of a triple. `every` has the
    defaults, too."""
    *path, last = key.split(".")
    names = setting_names()
    triple = last in ("x", "y", "z") and ".".join(path) in names
    if not (key in names or triple):
        raise BadInput(
            "there is no setting of this name",
            found=key,
            allowed=", ".join(names),
            remedy=did_you_mean(key, names),
        )
    if triple:
        *path, name = path
    branch: Any = values
    defaults: Any = every
    for part in path:
        # The file may have nothing of a part.
        branch = branch.setdefault(part, {})
        defaults = defaults.get(part) or {}
    if not triple:
        branch[last] = copy.deepcopy(value)
        return
    point = branch.get(name, defaults.get(name))
    if not isinstance(point, list | tuple) or len(point) != 3:
        raise BadInput(
            f"{'.'.join((*path, name))} has no {last}: it is not a point or direction",
            found=shown(point),
        )
    branch[name] = [value if axis == last else old for axis, old in zip("xyz", point, strict=True)]
