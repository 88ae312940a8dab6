"""Twenty runs spoilt on purpose: what the diagnosis says of each, in the table of docs/diagnosis.md.

Each of them is a misfit with exit status 1, never a pass, and at least 17 have to be named by their cause.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from corruptions import CORRUPTIONS, Corruption

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.diagnostics.diagnosis import Explanation
from zerobeam.analysis.posterior.posterior import UNSAMPLED
from zerobeam.commands.console import EXIT_STATUS
from zerobeam.words.message import headline
from zerobeam.words.misfit_words import explanation_sentence
from zerobeam.words.numbers import times

TABLE = Path(__file__).resolve().parents[2] / "docs" / "diagnosis.md"
HEAD = (
    "what is wrong",
    "run",
    "verdict",
    "exit status",
    "residuals, times the noise",
    "named",
    "what is said",
)
NAMED = 17  # of the twenty


@dataclass(frozen=True, eq=False)
class Judged:
    """A spoilt run and its result, but for the posterior."""

    corruption: Corruption
    result: Result

    @property
    def diagnosis(self) -> tuple[Explanation, ...]:
        return self.result.diagnosis

    @property
    def named(self) -> bool:
        return any(self.corruption.named_by(found) for found in self.diagnosis)

    @property
    def row(self) -> str:
        said = (
            "; ".join(explanation_sentence(found) for found in self.diagnosis)
            or "nothing: no cause explains it"
        )
        likelihood, verdict = self.result.likelihood, self.result.verdict
        before = float(np.sqrt(likelihood.chi2 / likelihood.dof))
        cells = (
            self.corruption.what,
            self.corruption.run,
            verdict,
            str(EXIT_STATUS[verdict]),
            times(self.diagnosis[0].before if self.diagnosis else before),
        )
        return f"| {' | '.join((*cells, 'yes' if self.named else 'no', said))} |\n"


pytestmark = pytest.mark.long  # twenty whole analyses: make test has the diagnosis of each cause alone


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> list[Judged]:
    result = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("zerobeam.analysis.analyse.sample_posterior", lambda *_, **__: (UNSAMPLED, None))
        for corruption in CORRUPTIONS:
            spoilt = corruption.spoilt(tmp_path_factory.mktemp("spoilt"))
            result.append(Judged(corruption, analyse(spoilt).result))
    return result


def test_there_are_twenty(judged: list[Judged]) -> None:
    assert len(judged) == len({(own.corruption.what, own.corruption.run) for own in judged}) == 20


def test_every_one_is_a_misfit_and_none_a_pass(judged: list[Judged]) -> None:
    for own in judged:
        assert own.result.verdict == "misfit", own.corruption.what
        assert EXIT_STATUS[own.result.verdict] == 1
        assert "Pass" not in headline(own.result)
        offsets = [row for row in own.result.parameters if row.group == "offset"]
        assert not {"identified", "weak"} & {row.status for row in offsets}


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
        text = text[: text.rindex(f"| {HEAD[0]}")] + head + rows
        TABLE.write_text(text, encoding="utf-8")
    assert text.partition(head)[2] == rows, "ZEROBEAM_WRITE_GOLDEN=1 writes it anew"
