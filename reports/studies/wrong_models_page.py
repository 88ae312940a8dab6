"""The study `wrong-models`: verdicts, errors and causes of arms with something wrong."""

from __future__ import annotations

from ...experiments.studies.wrong_models import WrongModel, WrongModelsStudy
from ...words import numbers
from ..style.blocks import Paragraph, Section, section_of
from .study_blocks import NOT_GIVEN, Study, flat, table

_COLUMNS = (
    "what is wrong",
    "measurements",
    "passes",
    "misfits",
    "weakly observable",
    "rms error of passes, u",
    "largest error of a pass, u",
    "passes beyond 4 u",
    "of these without a warning",
    "right cause named first",
    "right of causes decided",
)
_BRIEF = (0, 1, 2, 3, 6, 7, 9)  # the columns of the docs


def cells(one: WrongModel) -> tuple[str, ...]:
    """A row of the table, also of docs/diagnosis.md."""
    return (
        one.scenario,
        *map(str, (one.measurements, one.passes, one.misfits, one.weak)),
        NOT_GIVEN if one.z is None else numbers.fixed(one.z, 2),
        NOT_GIVEN if one.largest_u is None else numbers.fixed(one.largest_u, 1),
        *map(str, (one.beyond, one.unsaid)),
        f"{one.named} of {one.misfits}" if one.nameable and one.misfits else NOT_GIVEN,
        f"{one.decided_right} of {one.decided}" if one.nameable and one.decided else NOT_GIVEN,
    )


def markdown(answer: WrongModelsStudy) -> str:
    """The table as docs/diagnosis.md has it, with fewer columns."""
    lines = [_COLUMNS, ("---",) * len(_COLUMNS), *map(cells, answer.models)]
    return "".join(f"| {' | '.join(line[k] for k in _BRIEF)} |\n" for line in lines)


def _sections(answer: WrongModelsStudy) -> list[Section]:
    settings = answer.settings
    about = (
        f"Of {settings.arms} arms each: how many pass, are a misfit, or neither. Of those that pass:"
        " the root mean square and the largest error of the offsets in their standard uncertainties"
        f" u, and how many have an offset beyond {settings.limit_u:g} u; how many of these"
        " do not name the wrong model among their conditions. Of the misfits: how many"
        " name the right cause first; and of those where the best cause has an evidence of more than"
        f" {settings.decided:g} times the next, how many are right."
    )
    counts = table(
        "Random arms with one thing wrong",
        _COLUMNS,
        answer.models,
        cells,
        tone=lambda one: "" if one.holds else "weak",
    )
    return [section_of("Verdicts, errors and causes", Paragraph(about), counts)]


WRONG_MODELS = Study[WrongModelsStudy](
    subtitle=lambda answer: f"{answer.settings.arms} simulated arms for each scenario",
    sections=_sections,
    hold="models.csv holds the counts",
    tables={
        "models.csv": flat(
            "models",
            "scenario measurements arms passes misfits weak z largest_u beyond unsaid nameable noticeable"
            " named decided decided_right",
        )
    },
)
