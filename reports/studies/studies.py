"""The studies that can be shown: to add one, write its view, figures and plain tables, and enter it here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ..style.blocks import Page
from ..style.canvas import Picture
from .study_cell import cell_view, parameter_rows, time_rows
from .study_cell import plan_rows as cell_plan_rows
from .study_coverage import coverage_rows, coverage_view, rank_rows
from .study_figures import cell_pictures, coverage_pictures, sweep_pictures, table2_pictures
from .study_sweep import TABLES as SWEEP_TABLES
from .study_sweep import sweep_view
from .study_table2 import OF_THE_PAPER, paper_rows, scatter_rows, table2_view
from .study_table2 import plan_rows as table2_plan_rows

Json = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """How an answer of one kind is shown; all of it follows from the answer alone."""

    view: Callable[[Json], Page]
    pictures: Callable[[Json], dict[str, Picture]]
    tables: Mapping[str, Callable[[Json], Iterator[Json]]]  # rows by the name of the CSV file
    # Numbers in a parameter's row that are not the study's own, so that it may be one that no data set tells.
    stated: frozenset[str] = frozenset()


STUDIES: dict[str, Study] = {
    "coverage": Study(
        coverage_view, coverage_pictures, {"coverage.csv": coverage_rows, "ranks.csv": rank_rows}
    ),
    "cell": Study(
        cell_view,
        cell_pictures,
        {"parameters.csv": parameter_rows, "time.csv": time_rows, "plans.csv": cell_plan_rows},
    ),
    "table2": Study(
        table2_view,
        table2_pictures,
        {"scatter.csv": scatter_rows, "plans.csv": table2_plan_rows, "paper.csv": paper_rows},
        OF_THE_PAPER,
    ),
}


# Every study that sweeps settings, whatever its name: people write their own.
SWEEP = Study(sweep_view, sweep_pictures, SWEEP_TABLES)


def known_study(answer: object) -> Study | None:
    """How `answer` is shown: a sweep by its axes and cases, any other by its name. None if it is neither."""
    if not isinstance(answer, dict):
        return None
    if isinstance(answer.get("axes"), list) and isinstance(answer.get("cases"), list):
        return SWEEP
    return STUDIES.get(str(answer.get("study")))


def study_of(answer: Json) -> Study:
    """The study that `answer` is of. Raises ValueError where it is of none."""
    study = known_study(answer)
    if study is None:
        names = ", ".join(STUDIES)
        raise ValueError(f"a study is one of {names}, or has axes and cases, not {answer.get('study')!r}")
    return study


def study_view(answer: Json) -> Page:
    """The display strings of a study (see `study_view.py`)."""
    return study_of(answer).view(answer)
