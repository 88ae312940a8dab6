"""The study of instruments on two small setups: figures that follow by a second way, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from zerobeam.experiments.studies import instrument_choice
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.instrument_choice import BUILT_IN, SetupsFile, instruments_study
from zerobeam.model.errors import BadInput
from zerobeam.model.parsing.validation import read_model
from zerobeam.reports.studies.study_pages import INSTRUMENTS, study_page

TWO = """\
schema: zerobeam/setups/1
robot: irb1600
joint_deg: 0.005
tcp_mm: [0, 0, 100]
measurements: [5, 20]
setups:
  - name: tracker
    cost: 4
    measure: {leica: {minutes: 0.3}}
    header:
      geometry: exact
      instruments:
        leica: {kind: tracker, sigma_mm: 0.03, reflectors: {R1: {guess_mm: [60, 0, 60]}}}
  - name: bar on the axis
    cost: 2
    measure: {bar: {minutes: 1}}
    header:
      geometry: exact
      instruments:
        bar: {kind: ballbar, tip_mm: [0, 0, 100], sigma_mm: 0.005, range_mm: [300, 500]}
      targets: {s1: {guess_mm: [900, 200, 100], sigma_mm: 10}}
"""


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> instrument_choice.InstrumentsStudy:
    file = tmp_path_factory.mktemp("setups") / "two.yaml"
    file.write_text(TWO, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(instrument_choice, "_CANDIDATES", 80)
        return instruments_study(file, Engine(0, processes=1))


@pytest.mark.long
def test_more_measurements_know_more(answer: instrument_choice.InstrumentsStudy) -> None:
    tracker = answer.setups[0]
    few, many = tracker.plans
    assert (few.measurements, many.measurements) == (5, 20)
    assert many.worst_u < few.worst_u
    assert many.tcp_mm < few.tcp_mm
    # Of the measurements alone, with the travel of some seconds besides.
    assert 20 * 0.3 < many.minutes < 20 * 0.3 + 1
    # The noise of a coordinate over some metres of arm, by the root of the number: the right order.
    assert 0.003 < many.tcp_mm < 0.1


@pytest.mark.long
def test_what_a_setup_does_not_determine_has_no_number(answer: instrument_choice.InstrumentsStudy) -> None:
    """A socket on the axis of joint 6: that offset has no number; the TCP on that axis has one."""
    plan = answer.setups[1].plans[-1]
    assert plan.undetermined == ("delta6",)
    assert plan.worst_u is None
    assert plan.worst is None
    assert plan.tcp_mm is not None
    page = repr(study_page(answer))
    assert "J6" in page
    assert answer.headline.startswith("With 20 measurements tracker leaves")


@pytest.mark.long
def test_page_figure_and_table_show_all(answer: instrument_choice.InstrumentsStudy) -> None:
    (picture,) = INSTRUMENTS.pictures(answer).values()
    assert "bar on the axis (not determined)" in picture.alt
    rows = list(INSTRUMENTS.tables["plans.csv"](answer))
    assert [row["setup"] for row in rows] == ["tracker"] * 2 + ["bar on the axis"] * 2
    assert rows[-1]["undetermined"] == "delta6"


def test_the_built_in_setups_are_read_whole() -> None:
    content = read_model(SetupsFile, BUILT_IN)
    for setup in content.setups:
        header = instrument_choice._header(content, setup)
        assert set(header.labels) == set(setup.measure)
        assert header.arm is not None  # a typical arm
    assert len({setup.name for setup in content.setups}) == len(content.setups)
    assert np.ptp([setup.cost for setup in content.setups]) > 0


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("cost: 4", "cost: 9", "cost"),
        ("kind: tracker", "kind: telescope", "kind"),
        ("measurements: [5, 20]", "measurements: []", "measurements"),
        ("leica: {minutes: 0.3}", "other: {minutes: 0.3}", "how many measurements"),
    ],
)
def test_a_setups_file_that_is_wrong_is_said(old: str, new: str, what: str, tmp_path: Path) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text(TWO.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(BadInput, match=what):
        instruments_study(file, Engine(0, processes=1))
