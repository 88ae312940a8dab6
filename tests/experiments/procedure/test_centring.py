"""Stage 2: the spot is led to the centre down to the noise floor, within bounds, or the reason is told."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from scipy import stats
from servo_shots import Start, plan, start

from zerobeam.experiments.procedure import centring
from zerobeam.experiments.procedure.rig import MeasurementRefused, RefusalReason
from zerobeam.experiments.procedure.steering import FROM_BELOW, Belief
from zerobeam.model.arrays import Matrix

FAINT = {"noise_mm": 1e-7, "resolution_mm": 1e-7, "nonlinearity": 0.0}


def reason(shot: Start, frame: Matrix | None = None) -> RefusalReason:
    with pytest.raises(MeasurementRefused) as refused:
        shot.centred(frame)
    return refused.value.reason


def watch_plateau(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps go on at the floor: neither good enough nor out of patience."""
    monkeypatch.setattr(centring, "ENOUGH_MM", 0.0)
    monkeypatch.setattr(centring, "_PATIENCE", 100)


@pytest.mark.parametrize("seed", range(3))
def test_the_spot_is_brought_to_the_centre(seed: int) -> None:
    shot = start(7.0, seed)
    off = shot.centred().off_mm
    assert 4 < off[0] < 25
    assert off[-1] <= centring.ENOUGH_MM
    assert np.linalg.norm(shot.rig.hit()) < centring.ENOUGH_MM + 0.001


def test_with_the_exact_jacobian_what_is_left_is_of_second_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without any error the first step leaves what the turn by 7 mm at 1 m makes in second order and the
    damping (1e-6 of the larger eigenvalue), far below 1 %."""
    watch_plateau(monkeypatch)
    off = start(7.0, 3, exact=True, psd=FAINT, slant_deg=20).centred().off_mm
    assert off[1] < 0.01 * off[0]
    assert min(off[:5]) < 1e-5


def test_a_wrong_jacobian_is_slower_or_loses_the_face(monkeypatch: pytest.MonkeyPatch) -> None:
    """The control: with the PSD's axes forgotten the first step goes astray, and without t dd/dq, which is
    most of it, the beam leaves the face."""
    exact = start(7.0, 3, exact=True, psd=FAINT, slant_deg=20)
    assert len(exact.centred().off_mm) <= 4
    astray = start(7.0, 3, exact=True, psd=FAINT, slant_deg=20)
    frame = astray.psd.frame(astray.belief.beam(astray.joints)[1])
    turn = np.array([[0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), 0.5, 0], [0, 0, 1]])
    off = astray.centred(frame @ turn).off_mm
    assert off[1] > 0.5 * off[0]
    assert len(off) >= 6
    assert off[-1] <= centring.ENOUGH_MM  # as it follows it is put right

    def without_turn(self: Belief, joints: Matrix, frame: Matrix) -> tuple[Matrix, Matrix]:
        moving = [
            (self.beam(joints + way)[0] - self.beam(joints - way)[0]) / 2e-6 for way in 1e-6 * np.eye(6)
        ]
        return np.zeros(2), frame[:, :2].T @ np.column_stack(moving)

    monkeypatch.setattr(Belief, "spot", without_turn)
    assert reason(start(7.0, 3, exact=True, psd=FAINT, slant_deg=20)) == RefusalReason.OFF_FACE


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.one_in(2)
def test_the_floor_is_that_of_the_psds_noise(noise: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step takes away what the last reading said; then the spot is off by that reading's noise, and the
    next one says so with its own: 2 noise / sqrt(samples) r.m.s. over two axes. Successive ones share a
    noise: half of the 2 x 25 x 5 numbers are independent, at least."""
    watch_plateau(monkeypatch)
    squares = []
    for seed in range(5):
        shot = start(2.0, seed, exact=True, psd={"noise_mm": noise, "lost": 0.0, "nonlinearity": 0.0})
        squares += [off**2 for off in shot.centred().off_mm[-25:]]
    expected = 4 * noise**2 / 20
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(squares)) / len(squares)
    assert low < np.mean(squares) / expected < high


@pytest.mark.parametrize("resolution_deg", [0.0005, 0.005])
def test_the_floor_is_that_of_the_encoders(resolution_deg: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each joint of the wrist stands off by half a step at most where it is sent; the steps wander about in
    that, so that the spot stays within one step of all three, and gets nearer than half of it."""
    watch_plateau(monkeypatch)
    for seed in range(4):
        cell: dict[str, Any] = {"arm": {"resolution_deg": resolution_deg}, "psd": FAINT}
        shot = start(2.0, seed, exact=True, **cell)
        frame = shot.psd.frame(shot.belief.beam(shot.joints)[1])
        columns = np.linalg.norm(shot.belief.spot(shot.joints, frame)[1][:, 3:], axis=0)
        one_step = np.radians(resolution_deg) * columns.sum()
        floor = np.array(_until_refused(shot)[-20:])
        assert floor.max() < one_step
        assert floor.min() < one_step / 2
        # The control: it is the encoders' floor. Ten times finer ones would be ten times lower.
        assert floor.max() > one_step / 20


def _until_refused(shot: Start) -> list[float]:
    """How far off the spot was at each stand, also where that is not enough."""
    off: list[float] = []
    shot.rig.laser(True)
    frame = shot.psd.frame(shot.belief.beam(shot.joints)[1])
    with suppress(MeasurementRefused):
        centring.centre(
            shot.rig,
            shot.belief,
            shot.psd,
            shot.joints,
            shot.dark,
            frame,
            lambda at: off.append(float(np.linalg.norm(at))),
        )
    return off


def test_no_step_is_too_long_and_no_joint_leaves_its_limits() -> None:
    """The longest way of a joint is a step and the way down before it."""
    robot = plan().robot
    for seed in range(5):
        shot = start(120.0, seed)
        before = len(shot.rig.moves)
        search, _ = shot.shot()
        moves = np.array(shot.rig.moves)
        assert (moves >= robot.lower).all()
        assert (moves <= robot.upper).all()
        assert np.abs(np.diff(moves[before:], axis=0)).max() <= np.radians(10.0 + FROM_BELOW) + 1e-12
        begun = next(k for k, move in enumerate(moves) if np.array_equal(move, search.joints))
        assert np.abs(np.diff(moves[begun:], axis=0)).max() <= np.radians(2.0 + FROM_BELOW) + 1e-12


def test_the_play_of_the_gears_is_on_one_side_in_every_shot(monkeypatch: pytest.MonkeyPatch) -> None:
    """With stands that are come to from below a play of 0.02 degrees is one offset of all shots; come to
    straight, it scatters from shot to shot, and the servo chases it."""
    play = np.radians(0.02)

    def stands() -> tuple[Matrix, list[list[float]]]:
        shots = [start(6.0, seed, exact=True, arm={"backlash_deg": 0.02}) for seed in range(6)]
        off = [_until_refused(shot) for shot in shots]
        return np.array([(shot.rig.link() - shot.rig.joints())[3:] for shot in shots]), off

    play_of_each, off = stands()
    np.testing.assert_allclose(play_of_each, -play / 2, atol=1e-12)
    assert max(shot[-1] for shot in off) <= centring.ENOUGH_MM
    monkeypatch.setattr(centring, "come_to", lambda rig, belief, joints: rig.move(joints))
    scattered, chased = stands()
    assert np.ptp(scattered, axis=0).max() == pytest.approx(play)
    assert sum(map(len, chased)) > sum(map(len, off))


def test_a_stand_that_is_centred_by_chance_is_still_come_to_from_below() -> None:
    shot = start(0.0, 1, exact=True, arm={"backlash_deg": 0.02})
    shot.rig.move(shot.joints + 0.01)
    shot.rig.move(shot.joints)
    assert (shot.rig.link() > shot.rig.joints()).all()
    shot.centred()
    assert (shot.rig.link() < shot.rig.joints()).all()


ALONE = {"kind": "reflection", "shot": 2, "at_mm": [4.0, -3.0]}
# So near to the centre that no single step is long enough to tell.
NEAR = {**ALONE, "at_mm": [0.25, 0.2]}
BACKWARDS = {"exact": True, "slant_deg": 0, "psd": {"placed": {"misturned_deg": [0, 0, 180]}}}


@pytest.mark.parametrize(
    ("off_mm", "seed", "cell", "expected"),
    [
        pytest.param(40.0, 2, {}, RefusalReason.OFF_FACE, id="the beam is beside the face"),
        pytest.param(8.5, 3, BACKWARDS, RefusalReason.OFF_FACE, id="the beam leaves the face"),
        pytest.param(2.0, 2, {"laser": {"light": 1.4}}, RefusalReason.TOO_BRIGHT, id="too bright"),
        pytest.param(2.0, 2, {"psd": {"saturation": 0.4}}, RefusalReason.SATURATED, id="saturated"),
        pytest.param(60.0, 2, {"faults": [ALONE]}, RefusalReason.NOT_FOLLOWING, id="a reflection alone"),
        pytest.param(60.0, 2, {"faults": [NEAR]}, RefusalReason.NOT_FOLLOWING, id="one near the centre"),
        pytest.param(3.0, 2, {"faults": [ALONE]}, RefusalReason.TOO_BRIGHT, id="a reflection and the spot"),
    ],
)
def test_what_keeps_the_spot_from_the_centre_is_a_reason(
    off_mm: float, seed: int, cell: dict[str, Any], expected: RefusalReason
) -> None:
    assert reason(start(off_mm, seed, **cell)) == expected


def test_a_laser_that_is_a_little_too_bright_will_do() -> None:
    assert start(2.0, 2, laser={"light": 1.05}).centred().off_mm[-1] <= centring.ENOUGH_MM


def test_a_spot_that_cannot_be_centred_is_a_reason() -> None:
    """Encoders of 0.1 degrees are steps of some mm at the target; the plan's noise is 0.01 degrees."""
    found = set()
    for seed in range(4):
        try:
            start(3.0, seed, exact=True, arm={"resolution_deg": 0.1}).centred()
        except MeasurementRefused as refused:
            found.add(refused.reason)
    assert RefusalReason.NOT_CONVERGING in found


@pytest.mark.parametrize(
    ("off_mm", "seeds", "cell"),
    [(400.0, 5, {}), (100.0, 2, {"camera": None})],
    ids=["pictures", "beam alone"],
)
@pytest.mark.at_length(r"^beam alone")
def test_within_the_stated_range_every_beam_is_brought_to_the_centre(
    off_mm: float, seeds: int, cell: dict[str, Any]
) -> None:
    for seed in range(seeds):
        shot = start(off_mm, seed, **cell)
        shot.shot()
        # What the play of the encoders and the joints' noise leave where patience ends.
        assert np.linalg.norm(shot.rig.hit()) < 0.05
