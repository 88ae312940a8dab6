"""Tables that show themselves, and DataFrames of what a run recorded and of what a fit leaves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING, Self

import numpy as np

from ..analysis.answer.result import Result
from ..analysis.covariance import frame
from ..analysis.observability.check import CheckedTable
from ..analysis.solution import ParameterTable
from ..model.files.run import Run
from ..model.files.shot import Shot
from ..reports.output.html import card
from ..reports.output.terminal import page_text, table_text
from ..reports.style.blocks import Page, Table

if TYPE_CHECKING:
    import pandas as pd


class Shown:
    """What shows itself as a table: as text, and in a notebook as HTML."""

    table: Table

    def with_table(self, table: Table) -> Self:
        """The same, shown as this table."""
        self.table = table
        return self

    def __repr__(self) -> str:
        return table_text(self.table)

    def _repr_html_(self) -> str:
        return card(None, [self.table])


class ShownPage(ABC):
    """What shows itself as a page: as text, and in a notebook as HTML."""

    @abstractmethod
    def _page(self) -> Page: ...

    def __repr__(self) -> str:
        return page_text(self._page())

    def _repr_html_(self) -> str:
        page = self._page()
        blocks = [*page.front, *(block for section in page.sections for block in section.all)]
        return card(page, [block for block in blocks if isinstance(block, Table)])


class ShownParameters(Shown, ParameterTable):
    """Parameters of an answer."""


class ShownPredictions(Shown, CheckedTable):
    """Parameters of a plan."""


def data_frame(run: Run) -> pd.DataFrame:
    """What was recorded: a row for each measurement, by its number."""
    joints = [f"J{i + 1}_{joint.unit}" for i, joint in enumerate(run.robot.joints)]
    rows = [
        {**_means(shot), **dict(zip(joints, shot.joints_deg, strict=True)), **_read(shot)}
        for shot in run.shots
    ]
    return _by_measurement(rows, (shot.shot for shot in run.shots))


def _means(shot: Shot) -> dict[str, object]:
    means = {name: getattr(shot, name) for name in ("target", "instrument", "reflector", "posture")}
    return {name: value for name, value in means.items() if value is not None}


def _read(shot: Shot) -> dict[str, float]:
    """The readings of a measurement, a number each."""
    numbers: dict[str, float] = {}
    for column, value in shot.readings.items():
        values = np.atleast_1d(value).tolist()
        names = [column] if len(values) == 1 else [f"{column}_{k + 1}" for k in range(len(values))]
        numbers.update(zip(names, values, strict=True))
    others = {"sigma_mm": shot.sigma_mm, "time_s": shot.time_s}
    return numbers | {name: value for name, value in others.items() if value is not None}


def residual_frame(result: Result) -> pd.DataFrame:
    """What the fit leaves: a row for each measurement, by its number."""
    rows = [
        {
            "target": shot.target,
            **{f"residual_mm_{k + 1}": value for k, value in enumerate(shot.miss_mm)},
            **{f"residual_deg_{k + 1}": value for k, value in enumerate(shot.miss_deg)},
            "length_mm": shot.length_mm,
            "normalised": shot.whitened,
            "leave_one_out_mm": np.nan if shot.leave_one_out is None else shot.leave_one_out,
            "cooks_distance": np.nan if shot.cooks is None else shot.cooks,
        }
        for shot in result.shots
    ]
    return _by_measurement(rows, (shot.shot for shot in result.shots))


def _by_measurement(rows: list[dict[str, object]], shots: Iterable[int]) -> pd.DataFrame:
    table = frame(rows)
    table.index = list(shots)
    table.index.name = "measurement"
    return table
