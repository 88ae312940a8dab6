"""What events of a run say in words, which terminal and app show alike."""

from dataclasses import replace

from zerobeam.experiments.procedure.events import (
    Doubted,
    GivenUp,
    MeasurementRecorded,
    PendantReading,
    PostureRequested,
    ReadingRequested,
    Retried,
    Suspected,
    event_json,
)
from zerobeam.experiments.procedure.rig import RefusalReason

RECORDED = MeasurementRecorded(3, "psd", (0.003, 0.004), 9.0, 4, {}, None, None, True, 2.04)


def test_what_is_measured_is_said_with_how_much_is_done() -> None:
    asked = PostureRequested(3, "psd", 1, 7, (), ())
    assert asked.title == "Measurement 3 (1 of 7 done), target psd"
    extra = replace(asked, done=7, again=0, target="R2", reflector="R2", instrument="laser")
    assert extra.title == "Measurement 3 (7 of 8 done), posture 0 again, instrument laser, reflector R2"
    assert ReadingRequested(4, (), "tracker", "R2").title == "Measurement 4, instrument tracker, reflector R2"


def test_an_answer_says_what_it_does() -> None:
    answers = ("yes", "rad", "as 4", "redo 2")
    assert list(Doubted(0, "far", "", answers).choices.values()) == [
        "record it all the same",
        "they are radians",
        "it is measurement 4",
        "repeat measurement 2",
    ]
    assert Suspected(2, 1e-4, 0.25).choices == {"redo 2": "repeat measurement 2"}


def test_a_measurement_says_what_became_of_it() -> None:
    assert RECORDED.line == "recorded in 2.0\u00a0s, spot 0.0050\u00a0mm from the centre"
    assert replace(RECORDED, spot_mm=None, seconds=None).line == "recorded"
    assert RECORDED.warning is None
    assert "contradict" in str(event_json(replace(RECORDED, consistent=False))["warning"])
    refused = Retried(1, 4, RefusalReason.NO_SIGNAL, "dark")
    assert refused.line == "attempt 1 refused (no signal): dark"
    assert GivenUp(4, RefusalReason.NO_SIGNAL, "dark").line == "given up (no signal): dark"


def test_a_joint_is_written_as_its_pendant_shows_it() -> None:
    shown = [PendantReading("J1", -1.23456, unit).text for unit in ("deg", "rad", "pulse")]
    assert shown == ["−1.23", "−1.2346", "−1"]
