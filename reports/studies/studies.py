"""The studies that can be shown: to add one, write its view, figures and plain tables, and enter it here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ...experiments.studies.sweeps.grid_answer import GridStudy, to_json
from ..style.blocks import Page
from ..style.canvas import Picture
from .study_cell import cell_view, parameter_rows, time_rows
from .study_cell import plan_rows as cell_plan_rows
from .study_coverage import coverage_rows, coverage_view, rank_rows
from .study_figures import cell_pictures, coverage_pictures, sweep_pictures, table2_pictures
from .study_table2 import OF_THE_PAPER, paper_rows, scatter_rows, table2_view
from .study_table2 import plan_rows as table2_plan_rows
from .sweeps import sweep_page

Json = dict[str, Any]
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Study(Generic[Answer]):
    """How an answer of one kind is shown; all of it follows from the answer alone."""

    view: Callable[[Answer], Page]
    pictures: Callable[[Answer], dict[str, Picture]]
    tables: Mapping[str, Callable[[Answer], Iterator[Json]]]  # rows by the name of the CSV file
    to_json: Callable[[Answer], Json]  # the content of study.json
    # Numbers in a parameter's row that are not the study's own, so that it may be one that no data set tells.
    stated: frozenset[str] = frozenset()


def as_it_is(answer: Json) -> Json:
    """The content of an answer that is plain JSON types already."""
    return answer


STUDIES: dict[str, Study[Json]] = {
    "coverage": Study(
        coverage_view,
        coverage_pictures,
        {"coverage.csv": coverage_rows, "ranks.csv": rank_rows},
        as_it_is,
    ),
    "cell": Study(
        cell_view,
        cell_pictures,
        {"parameters.csv": parameter_rows, "time.csv": time_rows, "plans.csv": cell_plan_rows},
        as_it_is,
    ),
    "table2": Study(
        table2_view,
        table2_pictures,
        {"scatter.csv": scatter_rows, "plans.csv": table2_plan_rows, "paper.csv": paper_rows},
        as_it_is,
        OF_THE_PAPER,
    ),
}


# Every study over settings, whatever its name: people write their own.
SWEEP: Study[GridStudy] = Study(
    sweep_page.sweep_page,
    sweep_pictures,
    {"cases.csv": sweep_page.case_rows, "offsets.csv": sweep_page.parameter_rows},
    to_json,
)


def known_study(answer: object) -> Study[Any] | None:
    """The kind of an answer, or of the content of a study.json. None if it is of no known kind.

    In a file a study over settings is known by its axes and cases, any other by its name.
    """
    if isinstance(answer, GridStudy):
        return SWEEP
    if not isinstance(answer, dict):
        return None
    if isinstance(answer.get("axes"), list) and isinstance(answer.get("cases"), list):
        return SWEEP
    return STUDIES.get(str(answer.get("study")))


def study_of(answer: GridStudy | Json) -> Study[Any]:
    """The study that `answer` is of. Raises ValueError where it is of none."""
    study = known_study(answer)
    if study is None:
        names = ", ".join(STUDIES)
        name = answer.get("study") if isinstance(answer, dict) else answer
        raise ValueError(f"a study is one of {names}, or has axes and cases, not {name!r}")
    return study


def study_view(answer: GridStudy | Json) -> Page:
    """The display strings of a study (see `study_view.py`)."""
    return study_of(answer).view(answer)
