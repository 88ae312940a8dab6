"""Forms in which offsets and plans are exported, as the makers have them."""

from __future__ import annotations

import inspect
from functools import cache
from typing import Annotated

from ....experiments.makers.maker import makers, plan_programs
from ....experiments.positions.position_languages import LANGUAGES
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
    """A language: `positions` reads its files."""

    name: str
    vendor: Annotated[str, it("of the robots that it is for, as robot files name it")]
    endings: list[str]


@end_point("GET /api/languages", "The languages whose taught positions are read.")
@cache
def languages(_: Folder) -> list[LanguageForm]:
    """The languages whose taught positions are read."""
    return [
        LanguageForm(name=language.name, vendor=language.vendor, endings=list(language.endings))
        for language in LANGUAGES
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
