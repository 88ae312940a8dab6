"""The page of the study `wrong-models`: verdicts, errors and causes of arms with something wrong."""

from __future__ import annotations

from collections.abc import Iterator

from ...experiments.studies.wrong_models import WrongModel, WrongModelsStudy
from ...words import numbers
from ..style.blocks import Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture
from .study_blocks import NOT_GIVEN, PlainRow, columns_of, how_it_was_done, view_of

_COLUMNS = (
    "scenario",
    "measurements",
    "pass",
    "misfit",
    "weak",
    "z",
    "largest, u",
    "beyond",
    "not said",
    "named",
    "decided",
)


def wrong_models_page(answer: WrongModelsStudy) -> Page:
    """The display strings of the study of wrong models."""
    settings = answer.settings
    sections = [
        section_of(
            "Verdicts, errors and causes",
            Paragraph(
                f"Of {settings.arms} arms each: how many pass, are a misfit, or neither. Of those that pass:"
                " the root mean square and the largest error of the offsets in their standard uncertainties"
                f" u, and how many have an offset beyond {settings.limit_u:g} u; how many of these"
                " do not name the wrong model among their conditions. Of the misfits: how many"
                " name the right cause first; and of those where the best cause has an evidence of more than"
                f" {settings.decided:g} times the next, how many are right."
            ),
            _table(answer),
        ),
        how_it_was_done(
            answer,
            [
                ("Arms of each scenario", str(settings.arms)),
                ("Measurements", ", ".join(map(str, settings.measurements))),
                ("Seed", str(settings.seed)),
            ],
            "models.csv holds the counts",
        ),
    ]
    subtitle = f"{settings.arms} simulated arms for each scenario, seed {settings.seed}"
    return view_of(answer, subtitle, sections)


def _table(answer: WrongModelsStudy) -> Table:
    rows = []
    for one in answer.models:
        broken = not one.holds
        rows.append(row_of(*cells(one), tone="weak" if broken else ""))
    return table_of("Random arms with one thing wrong", _COLUMNS, rows)


def cells(one: WrongModel) -> tuple[str, ...]:
    """A row of the table, also of docs/diagnosis.md."""
    passed = one.z is not None and one.largest_u is not None
    return (
        one.scenario,
        str(one.measurements),
        str(one.passes),
        str(one.misfits),
        str(one.weak),
        numbers.fixed(one.z or 0.0, 2) if passed else NOT_GIVEN,
        numbers.fixed(one.largest_u or 0.0, 1) if passed else NOT_GIVEN,
        str(one.beyond),
        str(one.unsaid),
        f"{one.named} of {one.misfits}" if one.nameable and one.misfits else NOT_GIVEN,
        f"{one.decided_right} of {one.decided}" if one.nameable and one.decided else NOT_GIVEN,
    )


def markdown(answer: WrongModelsStudy) -> str:
    """The table as docs/diagnosis.md has it."""
    lines = [_COLUMNS, ("---",) * len(_COLUMNS), *map(cells, answer.models)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def wrong_models_pictures(answer: WrongModelsStudy) -> list[Picture | None]:
    """None: the table is the answer."""
    return []


def model_rows(answer: WrongModelsStudy) -> Iterator[PlainRow]:
    """`models.csv`: a row for each scenario and number of measurements."""
    for one in answer.models:
        yield columns_of(
            one,
            "scenario",
            "measurements",
            "arms",
            "passes",
            "misfits",
            "weak",
            "z",
            "largest_u",
            "beyond",
            "unsaid",
            "nameable",
            "noticeable",
            "named",
            "decided",
            "decided_right",
        )
