"""A held-out run of poses: millimetres beside millimetres, degrees beside degrees."""

import numpy as np
import pytest
from pose_runs import CAMERA, pose_header, pose_run, postures

from zerobeam.analysis.analyse import analyse
from zerobeam.words.finding_words import notes, predicted_run_sentences

ALL = (1, 2, 3, 4, 5, 6)


def held_out(true_deg: float):
    """Predicted: poses whose rotations have the noise `true_deg`, where 0.03° is stated."""
    stated = pose_header()
    true = pose_header(instruments={"cam": {**CAMERA, "sigma_deg": true_deg}})
    fitted = pose_run(postures(20, ALL, seed=1), own=stated, seed=1)
    other = pose_run(postures(20, ALL, seed=2), own=true, seed=2)
    other = type(fitted).of_shots(stated, other.robot, other.shots, "other")
    return analyse(fitted, held_out=other, sampling="never").result


@pytest.mark.one_in(2)
@pytest.mark.parametrize("true_deg", [0.03, 0.3])
def test_rotations_are_compared_with_rotations(true_deg):
    result = held_out(true_deg)
    run = result.hold_out
    # Sixty numbers: 4 standard errors of the root of their mean square.
    scatter = 4 / np.sqrt(2 * 60)
    noise = np.sqrt(3) * np.hypot(0.03, 0.01)
    assert run.expected_deg == pytest.approx(noise, rel=0.25)
    assert run.rms_deg / run.expected_deg == pytest.approx(np.hypot(true_deg, 0.014) / 0.033, rel=scatter)
    assert run.rms_mm == pytest.approx(run.expected_mm, rel=scatter)
    text = " ".join(predicted_run_sentences(run))
    assert "Rotations are off by" in text
    found = [note for note in notes(result) if "held-out run" in note]
    assert bool(found) == (true_deg > 0.1)
    if found:
        lengths = f"{run.rms_mm:.2f} mm rms, {run.expected_mm:.2f} mm expected"
        assert f"({lengths}; {run.rms_deg:.2f}° rms, {run.expected_deg:.3f}° expected) that are" in found[0]
