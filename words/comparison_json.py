"""`zerobeam/compare/1`: what `compare --json` prints and `compare.json` holds (docs/compare.md)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..analysis.repeatability.compare import (
    FALSE_ALARM,
    Agreement,
    ComparedOffset,
    ComparedRun,
    Comparison,
    OffsetOfRun,
    Question,
)
from ..analysis.repeatability.consistency import LEVEL, AgainstOthers, Consistency, Interval, RunDrift
from ..analysis.repeatability.repeat import Kind
from ..model.files.json_document import JsonDocument
from .comparison import failure, headline, notes

_OF_TEST = ("ratio", "ratio_interval95", "chi2", "dof", "p_value", "p_holm")
COMPARE_SCHEMA: Literal["zerobeam/compare/1"] = "zerobeam/compare/1"


class ComparedOffsetRow(JsonDocument):
    """An offset over the runs."""

    name: str
    unit: str
    runs: int = Field(
        description="in how many runs it is identifiable; 0: it is not compared, all else is null"
    )
    unvalidated: bool = Field(description="the model does not describe a run that its numbers are from")
    std: float | None = Field(description="of a run, by the scatter")
    std_interval95: Interval | None = Field(description="of the true std (χ²)")
    predicted_std: float | None = Field(description="root mean square of the predicted ones")
    ratio: float | None = Field(description="observed over predicted scatter")
    ratio_interval95: Interval | None
    chi2: float | None = Field(description="the test of this offset")
    dof: int | None
    p_value: float | None
    p_holm: float | None = Field(description="adjusted for the number of offsets")
    drift: RunDrift | None = Field(
        description="`slope` (unit per `at_unit`), `interval95`, `dof`, `p_value`, `p_holm`"
    )
    mean: float | None = Field(description="over the runs")
    mean_interval95: Interval | None
    mean_by: Literal["prediction", "scatter"] | None = Field(description="the source of the mean's interval")

    @classmethod
    def of(cls, row: ComparedOffset) -> ComparedOffsetRow:
        """The document of an offset."""
        mean, scatter, test = row.mean, row.scatter, row.test
        return cls.filled(
            row,
            std=None if scatter is None else scatter.std,
            std_interval95=None if scatter is None else scatter.interval95,
            **{name: None if test is None else getattr(test, name) for name in _OF_TEST},
            mean=None if mean is None else mean.value,
            mean_interval95=None if mean is None else mean.interval95,
            mean_by=None if mean is None else mean.by,
        )


class ComparedRunRow(JsonDocument):
    """A run among others."""

    name: str = Field(description="of the file; of a table the name of the row")
    sha256: str | None
    robot: str | None
    shots: int | None
    when: str | None
    at: float = Field(description="hours from the first run, or its number")
    failure: str | None = Field(description="why it has no numbers, or null")
    misfit: bool = Field(description="whether the model does not describe it")
    odd: AgainstOthers | None = Field(
        description=(
            "this run against the others: `chi2`, `dof` (null without covariances), `p_value`, `p_holm`"
        )
    )
    offsets: list[OffsetOfRun] = Field(
        description="`name`, `unit`, `estimate` and `std` without prior, `status`: that of the result, or"
        " `prior` (of a result: a prior has a part, so it is not compared), `stated` or `not stated` (of a"
        " table)"
    )

    @classmethod
    def of(cls, run: ComparedRun) -> ComparedRunRow:
        """The document of a run."""
        return cls.filled(run, failure=None if run.failure is None else failure(run.failure))


class ComparisonSettings(JsonDocument):
    """How runs were compared."""

    seed: int
    level: float = Field(description="of intervals")
    chance: float = Field(description="probability of a false alarm in all tests")
    asked: list[Question] = Field(description="which tests were possible")
    order: Literal["time", "given"]
    at_unit: Literal["h", "run"] = Field(description="hours from the first run, or its number")


class ComparisonDocument(JsonDocument):
    """`compare.json`, and what `compare --json` prints: null where there is no answer."""

    schema_: Literal["zerobeam/compare/1"] = Field(default=COMPARE_SCHEMA, alias="schema")
    kind: Kind = Field(description="what was compared")
    verdict: Agreement = Field(description="`misfit`: the model does not describe one of the runs, or more")
    headline: str = Field(description="the answer in a sentence")
    odd_run: str | None = Field(description="name of the outlying run")
    differing: list[str] = Field(description="names of the offsets that scatter more than predicted")
    drifting: list[str] = Field(description="names of the offsets that drift")
    misfit: list[str] = Field(description="names of the runs that the model does not describe")
    consistency: Consistency | None = Field(
        description="all offsets together: `chi2`, `dof`, `noise_dof` (degrees of freedom of an estimated"
        " noise; null if known), `p_value`, `p_holm` (the same: there is one), `ratio` (observed over"
        " predicted scatter, as stds) with `ratio_interval95`; null without covariances"
    )
    offsets: list[ComparedOffsetRow] = Field(description="each over the runs")
    runs: list[ComparedRunRow] = Field(description="in the order used")
    held: list[str] = Field(description="offsets that all runs hold")
    failed: list[str] = Field(description="runs whose fit did not converge, which have no numbers")
    settings: ComparisonSettings = Field(description="how runs were compared")
    versions: dict[str, str] = Field(description="of Python and the libraries")
    notes: list[str] = Field(description="in sentences")

    @classmethod
    def of(cls, comparison: Comparison) -> ComparisonDocument:
        """The document of a comparison."""
        by_time = comparison.by_time
        return cls.filled(
            comparison,
            headline=headline(comparison),
            misfit=comparison.misfits,
            offsets=[ComparedOffsetRow.of(row) for row in comparison.offsets],
            runs=[ComparedRunRow.of(run) for run in comparison.runs],
            settings=ComparisonSettings.filled(
                comparison,
                level=LEVEL,
                chance=FALSE_ALARM,
                order="time" if by_time else "given",
                at_unit="h" if by_time else "run",
            ),
            notes=list(notes(comparison)),
        )
