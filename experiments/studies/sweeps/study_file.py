"""Study files (YAML, `zerobeam/study-file/1`): a base of settings, and axes along which some of them change.

Every combination of the axes' values is a case. The built-in studies are such files too.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from ....model.errors import BadInput
from ....model.files.header import Header, check_header
from ....model.files.reading import Document, KeyPath, did_you_mean, read_yaml, shown
from ....model.files.robot_file import load_robot
from ....model.files.validation import FileModel, Name, Vector, refusal, validate
from ....model.kinematics.robot import Robot
from ....model.likelihood.geometry import Geometry
from ....model.likelihood.noise import NoiseModel
from ....model.likelihood.parameters import Parameters
from ....model.likelihood.tool import Tool
from ....words import numbers
from .case_settings import TARGET, Settings, as_tuple, overlap, setting_names

STUDY_FILE_SCHEMA: Literal["zerobeam/study-file/1"] = "zerobeam/study-file/1"
OTHER_STUDIES = ("coverage", "cell", "table2", "geometry")  # their answers have another shape
_FOLDER = Path(__file__).parent
_MOST_CASES = 10_000

Scalar = bool | int | float | str


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


class NamedChange(FileModel):
    """A value of an axis that changes several settings at once."""

    name: Name = Field(description="what reports call it")
    set_: dict[Name, Any] = Field(
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
        for i, one in enumerate(self.shown_values):
            if one in self.shown_values[:i]:
                raise refusal("duplicate value of an axis", key=("values", i), found=shown(one))
        return self

    @property
    def name(self) -> str:
        """The label, or else the key."""
        return self.label or self.key

    @property
    def shown_values(self) -> tuple[int | float | str, ...]:
        """The values as numbers or words."""
        return tuple(map(_shown_value, self.values))

    def changes(self, index: int) -> dict[str, Any]:
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

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.study in OTHER_STUDIES:
            raise refusal(
                "this is the name of another kind of study",
                key=("study",),
                found=self.study,
                allowed=f"any name but {', '.join(OTHER_STUDIES)}",
            )
        keys = [axis.key for axis in self.axes]
        taken: dict[str, int] = {}
        for i, axis in enumerate(self.axes):
            if axis.key in keys[:i]:
                raise refusal("two axes have the same key", key=("axes", i), found=axis.key)
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
        count = math.prod(len(axis.values) for axis in self.axes)
        if count > _MOST_CASES:
            raise refusal(
                "the study is too large", key=("axes",), found=f"{count} cases", allowed=_MOST_CASES
            )
        return self


@dataclass(frozen=True, eq=False)
class Case:
    """One combination: `at` has the index of its value on every axis."""

    at: tuple[int, ...]
    words: str
    settings: Settings
    header: Header
    robot: Robot

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that the case's answer depends on, besides seed and versions."""
        return self._digest(self.settings.stated(exclude={"robot"}))

    @property
    def pattern_print(self) -> str:
        """SHA-256 of all that the postures of a pattern depend on."""
        return self._digest(self.settings.model_dump(mode="json", include={"tool", "target", "plan"}))

    def _digest(self, settings: dict[str, Any]) -> str:
        stated = json.dumps(settings)
        parts = [self.robot.name, stated]
        for joint in self.robot.joints:
            values = [*joint.fixed.ravel(), *joint.axis, joint.lower, joint.upper]
            parts.append(f"{joint.name} {joint.kind} {joint.speed} {[float(v).hex() for v in values]}")
        parts.append(str([float(v).hex() for v in self.robot.flange.ravel()]))
        if self.robot.conventions.range3 is not None:
            parts.append(str([v.hex() for v in self.robot.conventions.range3]))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class StatedStudy:
    """A study file that was read: its content with the changes asked for, and its cases in order (the last
    axis changes fastest)."""

    content: StudyFile
    cases: tuple[Case, ...]
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


def read_study(path: Path | str, runs: int | None = None) -> StatedStudy:
    """A study file, every case of it checked; `runs` in the place of the base's."""
    document = read_yaml(Path(path))
    found = document.data.get("schema") if isinstance(document.data, dict) else None
    if found != STUDY_FILE_SCHEMA:
        raise BadInput(
            "this is not a study file of this version",
            found="no 'schema' key" if found is None else f"schema: {shown(found)}",
            allowed=f"schema: {STUDY_FILE_SCHEMA}",
            file=document.file,
            line=document.line(("schema",)),
        )
    content = validate(StudyFile, document.data, file=document.file, line=document.line)
    if runs is not None:
        if any(overlap(key, "runs") for axis in content.axes for key in _changed(axis)):
            raise BadInput(
                "both an axis of the study and --runs set the number of runs",
                found=f"--runs {runs}",
                remedy="leave out --runs",
                file=document.file,
                line=document.line(("axes",)),
            )
        stated = {**_stated(content.base), "runs": runs}
        base = validate(Settings, stated, file=None, line=lambda _: None)
        content = content.model_copy(update={"base": base})
    robots: dict[str, Robot] = {}
    grid = product(*(range(len(axis.values)) for axis in content.axes))
    cases = tuple(_case(content, at, document, robots) for at in grid)
    return StatedStudy(content, cases, document.file.name, document.sha256)


def _changed(axis: Axis) -> Iterator[str]:
    for j in range(len(axis.values)):
        yield from axis.changes(j)


def _stated(settings: Settings) -> dict[str, Any]:
    """What of the settings is stated, as in a file."""
    return settings.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _case(content: StudyFile, at: tuple[int, ...], document: Document, robots: dict[str, Robot]) -> Case:
    """The settings of one case; BadInput at the line of the value that does not suit."""
    data, where = _stated(content.base), dict[str, KeyPath]()
    defaults = content.base.model_dump(mode="json", by_alias=True)
    for i, (axis, j) in enumerate(zip(content.axes, at, strict=True)):
        place: KeyPath = ("axes", i, "values", j)
        for key, value in axis.changes(j).items():
            _put(data, defaults, key, value, document, place)
            where[key] = place

    def line(place: KeyPath) -> int | None:
        dotted = ".".join(str(part) for part in place)
        axis_place = next((own for key, own in where.items() if overlap(key, dotted)), None)
        return document.line(("base", *place) if axis_place is None else axis_place)

    settings = validate(Settings, data, file=document.file, line=line)
    header, ref = settings.header(), json.dumps(data["robot"])
    if ref not in robots:
        robots[ref] = load_robot(
            settings.robot, document.file.parent, file=document.file, line=line(("robot",))
        )
    robot = robots[ref]
    check_header(header, robot, file=document.file, line=line)
    try:
        tool, noise = Tool.from_header(header), NoiseModel.from_header(header, robot)
        Parameters.build(robot, tool, noise, Geometry.from_header(header, robot), header, [TARGET])
    except BadInput as error:
        raise error.at(document.file, line(("held",))) from None
    words = ", ".join(axis.words(j) for axis, j in zip(content.axes, at, strict=True))
    return Case(at, words, settings, header, robot)


def _put(
    data: dict[str, Any], defaults: dict[str, Any], key: str, value: Any, document: Document, place: KeyPath
) -> None:
    """Set a dotted name; its last part may be the x, y or z of a triple."""
    *path, last = key.split(".")
    names = setting_names()
    triple = last in ("x", "y", "z") and ".".join(path) in names
    if not (key in names or triple):
        raise BadInput(
            "there is no setting of this name",
            found=key,
            allowed=", ".join(names),
            remedy=did_you_mean(key, names),
            file=document.file,
            line=document.line(place),
        )
    if triple:
        *path, name = path
    for part in path:
        # What is stated of a part may be nothing at all.
        data = data.setdefault(part, {})
        defaults = defaults.get(part) or {}
    if not triple:
        data[last] = copy.deepcopy(value)
        return
    point = data.get(name, defaults.get(name))
    if not isinstance(point, list | tuple) or len(point) != 3:
        raise BadInput(
            f"{'.'.join((*path, name))} has no {last}: it is not a point or direction",
            found=shown(point),
            file=document.file,
            line=document.line(place),
        )
    data[name] = [value if axis == last else own for axis, own in zip("xyz", point, strict=True)]
