"""A made-up study, by the steps of CONTRIBUTING: is the mean of several readings as uncertain as is said?"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from zerobeam.commands.studying import Study as Carried
from zerobeam.commands.studying import _command
from zerobeam.experiments.studies.answer import StudyAnswer
from zerobeam.experiments.studies.cases import Engine
from zerobeam.model.options import Option
from zerobeam.model.records import it
from zerobeam.reports.studies.study_blocks import Study, flat, table
from zerobeam.reports.studies.study_pages import STUDIES
from zerobeam.reports.style.blocks import Paragraph, section_of

SPOT_MM = 0.05


# 1. Settings, a piece, what becomes of it, and the answer.
@dataclass(frozen=True)
class MeansSettings:
    """How the study was carried out."""

    runs: Annotated[int, it("runs of each number of readings")]
    seed: Annotated[int, it("seed")]


@dataclass(frozen=True)
class Mean:
    """Of so many `readings`: in how many `runs` the truth was within 1.96 u (`held`)."""

    readings: int
    runs: int
    held: int


@dataclass(frozen=True, kw_only=True)
class MeansStudy(StudyAnswer):
    """The whole answer."""

    settings: MeansSettings
    means: tuple[Mean, ...]


def mean_of(piece: tuple[int, int, int]) -> Mean:
    """A number of readings in so many runs, with a seed."""
    readings, runs, seed = piece
    drawn = np.random.default_rng([seed, readings]).normal(0.0, SPOT_MM, (runs, readings)).mean(axis=1)
    return Mean(readings, runs, int((abs(drawn) < 1.96 * SPOT_MM / np.sqrt(readings)).sum()))


def means_study(runs: int, engine: Engine) -> MeansStudy:
    """Carry the study out."""
    pieces = [(readings, runs, engine.seed) for readings in (1, 4, 16)]
    means = engine.each("means", Mean, mean_of, pieces, runs=runs)
    off = 4 * np.sqrt(0.95 * 0.05 / runs)
    return MeansStudy(
        study="means",
        title="Is the mean of several readings as uncertain as it is said?",
        headline="The truth is within 1.96 u as often as it should be.",
        agrees=all(abs(one.held / one.runs - 0.95) < off for one in means),
        notes=("Readings are normal and independent.",),
        settings=MeansSettings(runs, engine.seed),
        means=tuple(means),
    )


# 2. How it is shown, and its entry.
STUDIES["means"] = Study[MeansStudy](
    subtitle=lambda answer: f"{answer.settings.runs} runs of each number of readings",
    sections=lambda answer: [
        section_of(
            "Means",
            Paragraph("How often the truth was within 1.96 u of the mean."),
            table(
                "Runs that held the truth",
                ("readings", "held"),
                answer.means,
                lambda one: (str(one.readings), f"{one.held} of {one.runs}"),
            ),
        )
    ],
    hold="means.csv holds the counts",
    tables={"means.csv": flat("means", "readings runs held")},
)


# 3. Its command.
@_command("means")
def study_means(runs: Annotated[int, Option("Runs of each number.", least=20)] = 400) -> Carried:
    """Is the mean of several readings as uncertain as it is said?"""
    return partial(means_study, runs)
