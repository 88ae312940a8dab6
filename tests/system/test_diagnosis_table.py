"""Twenty runs spoilt on purpose: what the diagnosis says of each, in the table of docs/diagnosis.md.

Each of them contradicts its noise or its priors, and at least 17 have to be named by their cause.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from corruptions import CORRUPTIONS, Corruption

from zerobeam.analysis.diagnostics.diagnosis import Explanation, diagnose
from zerobeam.analysis.findings import lack_of_fit
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.problem import Problem
from zerobeam.reports.words.diagnosis import explanation_sentence, times

TABLE = Path(__file__).resolve().parents[2] / "docs" / "diagnosis.md"
HEAD = ("what is wrong", "run", "residuals, times the noise", "named", "what is said")
NAMED = 17  # of the twenty
FAR = 4.0  # prior stds beyond which an estimate contradicts its prior


@dataclass(frozen=True, eq=False)
class Judged:
    """A spoilt run with its solution and what the diagnosis says."""

    corruption: Corruption
    solution: Solution
    diagnosis: tuple[Explanation, ...]

    @property
    def named(self) -> bool:
        return any(self.corruption.named_by(found) for found in self.diagnosis)

    @property
    def contradicted(self) -> bool:
        """By the residuals, or by an estimate too far from its prior."""
        far = float(np.abs(self.solution.fit.z).max())
        return lack_of_fit(self.solution) is not None or far > FAR

    @property
    def row(self) -> str:
        chi2, dof, _ = self.solution.against_noise
        said = (
            "; ".join(explanation_sentence(found) for found in self.diagnosis)
            or "nothing: no cause explains it"
        )
        cells = (self.corruption.what, self.corruption.run, times(np.sqrt(chi2 / dof)))
        return f"| {' | '.join((*cells, 'yes' if self.named else 'no', said))} |\n"


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> list[Judged]:
    result = []
    for corruption in CORRUPTIONS:
        solution = solve(Problem.from_run(corruption.spoilt(tmp_path_factory.mktemp("spoilt"))))
        result.append(Judged(corruption, solution, diagnose(solution)))
    return result


def test_there_are_twenty(judged: list[Judged]) -> None:
    assert len(judged) == len({(own.corruption.what, own.corruption.run) for own in judged}) == 20


def test_none_is_in_agreement_with_its_noise_and_priors(judged: list[Judged]) -> None:
    assert [own.corruption.what for own in judged if not own.contradicted] == []


def test_most_are_named_and_none_by_something_else_alone(judged: list[Judged]) -> None:
    assert sum(own.named for own in judged) >= NAMED
    wrong = [own.corruption.what for own in judged if own.diagnosis and not own.named]
    assert wrong == []


def test_what_is_named_agrees_with_the_noise(judged: list[Judged]) -> None:
    for own in judged:
        for found in own.diagnosis:
            assert found.agrees
            assert found.factor < 1.5


def test_the_table_of_the_documentation_has_these_rows(judged: list[Judged]) -> None:
    head = "".join(f"| {' | '.join(cells)} |\n" for cells in (HEAD, ("---",) * len(HEAD)))
    rows = "".join(own.row for own in judged)
    text = TABLE.read_text(encoding="utf-8")
    if os.environ.get("ZEROBEAM_WRITE_GOLDEN"):
        text = text[: text.index(f"| {HEAD[0]}")] + head + rows
        TABLE.write_text(text, encoding="utf-8")
    assert text.partition(head)[2] == rows, "ZEROBEAM_WRITE_GOLDEN=1 writes it anew"
