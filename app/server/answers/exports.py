"""Forms in which offsets and plans are exported and languages that are corrected, as the makers have them."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from ....experiments.makers.maker import makers, plan_programs, program_languages
from ....experiments.makers.user_programs import poses_to_state
from ....model.errors import BadInput
from ....model.files.run import read_run
from ....model.records import it, record
from ..folder import Folder
from ..requests import end_point
from .forms import FormField, form_of


@record(kw_only=True)
class ExportForm:
    """A form: `export NAME` writes it."""

    name: str
    maker: str
    vendor: Annotated[str | None, it("of the robots that it is for, as robot files name it; null: any")]
    about: str
    ending: str
    options: list[FormField]


@end_point("GET /api/exports", "The forms in which offsets are exported.")
@cache
def exports(_: Folder) -> list[ExportForm]:
    """The forms of all makers, those for robots of any maker first."""
    ordered = sorted(makers(), key=lambda maker: maker.vendor is not None)
    return [
        ExportForm(
            name=form.name,
            maker=maker.name,
            vendor=maker.vendor,
            about=inspect.getdoc(form.text) or form.name,
            ending=form.ending,
            options=form_of(form.text),
        )
        for maker in ordered
        for form in maker.offsets
    ]


@record(kw_only=True)
class LanguageForm:
    """A language: `export program` corrects its programs."""

    name: str
    vendor: Annotated[str, it("of the robots that it is for, as robot files name it")]
    about: str
    endings: list[str]


@end_point("GET /api/languages", "The languages whose programs are corrected.")
@cache
def languages(_: Folder) -> list[LanguageForm]:
    """The languages whose programs are corrected."""
    return [
        LanguageForm(name=files.name, vendor=vendor, about=files.about, endings=list(files.endings))
        for files, vendor in program_languages()
    ]


@record(kw_only=True)
class PlanForm:
    """A program that a plan is exported as, or the sheet for a person: `export plan NAME` writes it."""

    name: str
    vendor: Annotated[str | None, it("of the robots that it is for, as robot files name it; null: any")]
    label: str
    files: Annotated[list[str], it("usual names; others with the first one's stem follow its name")]
    options: Annotated[list[str], it("names of what may be stated of the motion")]


@end_point("GET /api/plan-exports", "The programs that a plan is exported as.")
@cache
def plan_forms(_: Folder) -> list[PlanForm]:
    """The sheet and the programs of all makers."""
    sheet = PlanForm(
        name="pdf",
        vendor=None,
        label="sheet for the person at the robot (PDF)",
        files=["plan.pdf"],
        options=["j3"],
    )
    programs = [
        PlanForm(
            name=program.name,
            vendor=vendor,
            label=program.label,
            files=list(program.files),
            options=list(program.options),
        )
        for program, vendor in plan_programs()
    ]
    return [sheet, *programs]


_LARGEST = 2 * 10**6  # bytes of a program that is read while somebody waits


@record(kw_only=True)
class PoseToState:
    """A tool or frame of a program whose pose a person must state: `export program --tool NAME=POSE`."""

    what: Literal["tool", "frame"]
    name: Annotated[str, it("as the program has it; empty: the one that it leaves open")]
    form: Annotated[str, it("what its numbers are, with their units")]


@end_point("GET /api/program", "Tools and frames of a program whose poses must be stated to correct it.")
def poses(folder: Folder, file: str, run: str) -> list[PoseToState]:
    """What must be stated to correct a program of the run's robot."""
    path, robot = folder.file(file), read_run(folder.file(run)).robot
    if path.stat().st_size > _LARGEST:
        remedy = "use zerobeam export program, which names what must be stated"
        raise BadInput("the program is too long to be looked at here", remedy=remedy, file=Path(file))
    return [
        PoseToState(
            what="tool" if pose.option == "--tool" else "frame", name=pose.name, form=_with_units(pose.form)
        )
        for pose in poses_to_state(robot, path)
    ]


def _with_units(form: str) -> str:
    values, _, units = form.partition(" in ")
    named = f" ({units})" if units else " (mm)" if "Q1" in values else " (mm, deg)"
    return values.replace(",", ", ") + named
