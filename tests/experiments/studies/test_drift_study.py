"""The study of drift: a small sample quickly; at length, the figures that are stated."""

from pathlib import Path

import pytest

from zerobeam.experiments.studies import drift_coverage as module
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.drift_coverage import DriftStudy, drift_study
from zerobeam.model.errors import BadInput
from zerobeam.reports.studies.study_pages import DRIFT, study_page


@pytest.mark.long
def test_a_small_study_is_carried_out_and_shown() -> None:
    shares: list[float] = []
    answer = drift_study(2, Engine(0, lambda stage, share: shares.append(share), processes=1))
    assert isinstance(answer, DriftStudy)
    assert shares == [0.0, 1.0]
    assert answer.alarms.arms == 1
    assert sum(row.of for row in answer.power) == 1
    page = study_page(answer)
    assert page.verdict.key in ("pass", "weak")
    assert set(DRIFT.pictures(answer)) == {"power"}
    assert len(list(DRIFT.tables["power.csv"](answer))) == len(answer.power)


def test_what_the_arms_judge_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In pieces, whose answers do not depend on which are worked out when."""
    monkeypatch.setattr(module, "_SIZE", 2)

    def once(piece: module._Piece, number: int, axis: object) -> module.JudgedArm:
        return module.JudgedArm(True, number == 1, False, False, 0.1 * number, None, False)

    monkeypatch.setattr(module, "_judged_arm", once)
    how = {"store": tmp_path / "cases.jsonl", "processes": 1}
    answer = drift_study(3, Engine(0, **how))
    assert (answer.intervals.held, answer.along_axis.held, answer.alarms.arms) == (3, 1, 3)
    with pytest.raises(BadInput, match="arms differs"):
        drift_study(4, Engine(0, **how))


@pytest.mark.long
def test_intervals_and_alarms_of_500_arms_hold_and_the_control_does_not() -> None:
    answer = drift_study(500, Engine(0))
    assert answer.intervals.agrees
    assert answer.along_axis.agrees
    assert answer.alarms.agrees
    assert not answer.control.agrees
    assert answer.agrees
    assert [row.share for row in answer.power][-1] > 0.9
