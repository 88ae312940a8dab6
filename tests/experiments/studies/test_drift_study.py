"""The study of drift: a small sample quickly; at length, the figures that are stated."""

from __future__ import annotations

import pytest

from zerobeam.experiments.studies.drift import DriftStudy, drift_study
from zerobeam.reports.studies.drift_page import drift_pictures, power_rows
from zerobeam.reports.studies.kinds import study_page


def test_a_small_study_is_carried_out_and_shown() -> None:
    told: list[float] = []
    found = drift_study(2, 0, lambda stage, share: told.append(share))
    assert isinstance(found, DriftStudy)
    assert told == [0.0, 0.5]
    assert found.alarms.arms == 1
    assert sum(own.of for own in found.power) == 1
    page = study_page(found)
    assert page.verdict.key in ("pass", "weak")
    (picture,) = drift_pictures(found)
    assert picture is not None
    assert len(list(power_rows(found))) == len(found.power)


@pytest.mark.long
def test_intervals_and_alarms_of_500_arms_hold_and_the_control_does_not() -> None:
    found = drift_study(500, 0, lambda stage, share: None)
    assert found.intervals.agrees
    assert found.along_axis.agrees
    assert found.alarms.agrees
    assert not found.control.agrees
    assert found.agrees
    assert [own.share for own in found.power][-1] > 0.9
