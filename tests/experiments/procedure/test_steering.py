"""Steps of the wrist: what they take away, how far they go, where they end; stands come to from below."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from servo_shots import Start, WatchedRig, plan, start

from zerobeam.experiments.procedure import steering
from zerobeam.experiments.procedure.rig import MeasurementRefused, RefusalReason
from zerobeam.experiments.procedure.steering import FROM_BELOW, Belief, Search, come_to, step
from zerobeam.experiments.sensors.markers import blobs
from zerobeam.model.arrays import Matrix

LARGEST = np.radians(2.0)


def believed(posture: int = 3) -> tuple[Belief, Matrix]:
    shot = start(posture=posture)
    return shot.belief, shot.joints


def frame_of(belief: Belief, joints: Matrix) -> Matrix:
    """Axes of a face that is at a slant to the beam."""
    z = -belief.beam(joints)[1] + np.array([0.2, -0.3, 0.1])
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.3, 1.0, 0.2])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def with_limits(belief: Belief, lower: Matrix, upper: Matrix) -> Belief:
    robot = belief.problem.robot
    joints = tuple(
        replace(joint, lower=low, upper=high)
        for joint, low, high in zip(robot.joints, lower, upper, strict=True)
    )
    return replace(belief, problem=replace(belief.problem, robot=replace(robot, joints=joints)))


def test_the_spots_jacobian_is_exact() -> None:
    """J = B' (I - d n' / (d'n)) (dp/dq + t dd/dq), against central differences of the beam itself; without
    its second term it is far off."""
    belief, joints = believed()
    frame = frame_of(belief, joints)

    def met(there: Matrix) -> Matrix:
        origin, direction = belief.beam(there)
        normal = frame[:, 2]
        length = normal @ (belief.target - origin) / (normal @ direction)
        return frame[:, :2].T @ (origin + length * direction - belief.target)

    spot, exact = belief.spot(joints, frame)
    np.testing.assert_allclose(spot, met(joints), atol=1e-9)
    ways = 1e-6 * np.eye(6)
    differences = np.column_stack([(met(joints + way) - met(joints - way)) / 2e-6 for way in ways])
    np.testing.assert_allclose(exact, differences, atol=1e-4)
    _, direction = belief.beam(joints)
    across = np.eye(3) - np.outer(direction, frame[:, 2]) / (direction @ frame[:, 2])
    moving = np.column_stack(
        [(belief.beam(joints + way)[0] - belief.beam(joints - way)[0]) / 2e-6 for way in ways]
    )
    assert np.abs(frame[:, :2].T @ across @ moving - exact).max() > 500


def test_directions_are_turned_into_the_flange() -> None:
    belief, joints = believed()
    rotation, place = belief.flange(joints)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    points = np.random.default_rng(0).normal(size=(4, 3)) * 300
    for point in points:
        (seen,) = belief.call("seen", joints, point)
        np.testing.assert_allclose((point - place) @ rotation, seen, atol=1e-9)
    origin = belief.call("seen", joints, np.zeros(3))[0]
    np.testing.assert_allclose(
        belief.turned(joints, points), [belief.call("seen", joints, p)[0] - origin for p in points], atol=1e-9
    )


def test_another_target_leaves_the_rest() -> None:
    belief, _ = believed()
    other = belief.with_target(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(other.target, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(other.delta, belief.delta)
    assert (other.x != belief.x).sum() == 3


def test_the_wrist_is_turned_onto_a_target_or_not_at_all() -> None:
    belief, joints = believed()
    aside = belief.with_target(belief.target + np.array([40.0, -30.0, 60.0]))
    found = aside.onto_target(joints)
    origin, direction = aside.beam(found)
    assert np.linalg.norm(np.cross(aside.target - origin, direction)) < 1e-5
    np.testing.assert_array_equal(found[:3], joints[:3])
    held = with_limits(aside, joints - 1e-3, joints + 1e-3)
    assert held.onto_target(joints) is None


def test_a_step_takes_the_error_away_with_the_smallest_turn() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([3.0, -2.0])
    turn = step(belief, joints, jacobian, error, LARGEST) - joints
    assert (turn[:3] == 0).all()
    np.testing.assert_allclose(turn[3:], -np.linalg.pinv(jacobian[:, 3:]) @ error, atol=1e-5)
    np.testing.assert_allclose(jacobian @ turn, -error, atol=1e-3)


def test_no_joint_turns_by_more_than_the_bound() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([300.0, -200.0])
    turn = step(belief, joints, jacobian, error, LARGEST) - joints
    assert np.abs(turn).max() == pytest.approx(LARGEST)
    # As far as it goes it goes the right way.
    way = jacobian @ turn
    assert way @ error == pytest.approx(-np.linalg.norm(way) * np.linalg.norm(error))


def test_a_step_across_a_singular_direction_is_short() -> None:
    """Both rows of the Jacobian nearly alike: undamped it would turn by a radian and more."""
    belief, joints = believed()
    jacobian = np.zeros((2, 6))
    jacobian[:, 3:] = [[1000.0, 500.0, 200.0], [1000.0, 500.0, 200.001]]
    across = np.array([1.0, -1.0])
    assert np.abs(np.linalg.pinv(jacobian) @ across).max() > 100
    assert np.abs(step(belief, joints, jacobian, across, np.inf) - joints).max() < 1e-3


def test_a_joint_at_its_limit_is_left_there_and_the_others_do_its_part() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([3.0, -2.0])
    free = step(belief, joints, jacobian, error, LARGEST) - joints
    most = int(np.argmax(np.abs(free)))
    lower, upper = belief.problem.robot.lower.copy(), belief.problem.robot.upper.copy()
    (lower if free[most] < 0 else upper)[most] = joints[most]
    turn = step(with_limits(belief, lower, upper), joints, jacobian, error, LARGEST) - joints
    assert turn[most] == 0
    np.testing.assert_allclose(jacobian @ turn, -error, atol=1e-2)


def test_a_wrist_that_cannot_is_a_reason() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    held = with_limits(belief, joints - 1e-6, joints + 1e-6)
    with pytest.raises(MeasurementRefused) as refused:
        step(held, joints, jacobian, np.array([3.0, -2.0]), LARGEST)
    assert refused.value.reason == RefusalReason.LIMIT


def stood(rig: WatchedRig, joints: Matrix, first: Matrix) -> Matrix:
    rig.move(first)
    rig.move(joints)
    return rig.link() - joints


def test_a_stand_come_to_from_below_has_the_play_always_on_one_side() -> None:
    shot = start(exact=True, arm={"backlash_deg": 0.02})
    rig, joints = shot.rig, shot.joints
    play = np.radians(0.02)
    for aside in (-0.1, 0.1):
        rig.move(joints + aside)
        come_to(rig, shot.belief, joints)
        np.testing.assert_allclose(rig.link() - joints, -play / 2, atol=1e-12)
    # The control: come to straight, it depends on the side.
    below, above = stood(rig, joints, joints - 0.1), stood(rig, joints, joints + 0.1)
    np.testing.assert_allclose(above - below, play, atol=1e-12)


def test_a_stand_near_a_lower_limit_is_come_to_within_the_limits() -> None:
    shot = start(exact=True)
    robot = plan().robot
    joints = shot.joints.copy()
    joints[3] = robot.lower[3] + np.radians(FROM_BELOW) / 2
    come_to(shot.rig, shot.belief, joints)
    assert shot.rig.moves[-2][3] == robot.lower[3]
    np.testing.assert_array_equal(shot.rig.moves[-1], joints)


def on_face(shot: Start) -> bool:
    return bool(np.abs(shot.rig.hit()).max() < shot.psd.size / 2 + 1)


def turned(deg: float, **more: Any) -> Start:
    """The PSD turned about its normal by `deg` against what is stated."""
    return start(60.0, 4, exact=True, psd={"placed": {"misturned_deg": [0, 0, deg]}}, **more)


def reason(shot: Start) -> RefusalReason:
    with pytest.raises(MeasurementRefused) as refused:
        shot.search().run()
    return refused.value.reason


def seen_led(shot: Start, joints: np.ndarray) -> np.ndarray:
    """(2,) px of the LED to the left in a picture, the arm at `joints`."""
    shot.rig.move(joints)
    return np.array(min((blob.x, blob.y) for blob in blobs(shot.rig.image())))


def test_the_image_jacobian_is_that_of_pictures() -> None:
    """By central differences of centroids in pictures of a LED, of which the noise is below 0.05 px."""
    shot = start(40.0, exact=True, camera={"noise_grey": 0.3})
    search, camera = shot.search(), shot.rig.camera
    assert camera is not None
    leds = shot.rig.centre() + shot.psd.markers @ shot.rig.face().T
    pixels = search._pixels(camera, leds)
    search.belief = shot.belief.with_target(leds[np.argmin(pixels[:, 0])])
    exact, step = search._image_jacobian(camera), np.radians(1.0)
    differences = np.column_stack(
        [
            (seen_led(shot, shot.joints + way) - seen_led(shot, shot.joints - way)) / (2 * step)
            for way in step * np.eye(6)
        ]
    )
    # Differences of 1 degree are off by a share of 5e-5 (third order) of some 700 px/rad, and by the noise.
    bound = 0.05 / (np.sqrt(2) * step) * 4 + 2e-3 * np.abs(exact).max()
    assert np.abs(exact).max() > 600
    np.testing.assert_allclose(differences, exact, atol=bound)
    # The control: seen by a camera that is not turned on the flange.
    seen, by_joints = shot.belief.call("sighted", shot.joints, search.belief.target)
    wrong = camera.project_jacobian(camera.from_flange(seen[None]))[0] @ by_joints
    assert np.abs(wrong - exact).max() > 10 * bound


def test_the_image_jacobian_is_exact() -> None:
    shot = start(40.0, exact=True)
    search, camera = shot.search(), shot.rig.camera
    assert camera is not None
    exact, step = search._image_jacobian(camera), 1e-5
    for k, way in enumerate(step * np.eye(6)):
        there = []
        for sign in (1, -1):
            search.joints = shot.joints + sign * way
            there.append(search._pixels(camera, shot.belief.target[None])[0])
        np.testing.assert_allclose((there[0] - there[1]) / (2 * step), exact[:, k], atol=1e-4)


def test_the_centre_is_placed_from_the_leds() -> None:
    """To a pixel's tenth across the sight; along it as far as 0.1 px of the LEDs' distance tell."""
    shot = start(50.0, exact=True)
    search = shot.search()
    search.run()
    off = search.belief.target - shot.rig.centre()
    _, direction = shot.belief.beam(search.joints)
    far = np.linalg.norm(search.belief.target - shot.belief.beam(search.joints)[0])
    apart = 70 * 700 / far
    assert np.linalg.norm(np.cross(off, direction)) < 0.1 * far / 700 * 3
    assert abs(off @ direction) < 3 * far * 0.1 / apart
    assert np.linalg.norm(shot.belief.target - shot.rig.centre()) == pytest.approx(50.0)


@pytest.mark.parametrize("deg", [-60.0, -25.0, 25.0, 60.0])
@pytest.mark.parametrize("slant", [None, 45.0])
def test_a_psd_that_is_turned_is_seen_to_be(deg: float, slant: float | None) -> None:
    shot = turned(deg, slant_deg=slant)
    search = shot.search()
    search.run()
    between = np.degrees(np.arccos(np.clip(search.frame()[:, 0] @ shot.rig.face()[:, 0], -1, 1)))
    assert between < 1.0  # 0.2 px of 40 are 0.3 degrees
    assert search.left is None
    assert on_face(shot)
    # Where it stands does not suffer: the beam is within the servo's 1.5 px of the centre, and some noise.
    assert np.linalg.norm(shot.rig.hit()) < 6.0


def test_without_a_camera_a_turned_psd_is_taken_as_stated() -> None:
    shot = turned(60.0, camera=None)
    search = shot.search()
    search.run()
    between = np.degrees(np.arccos(search.frame()[:, 0] @ shot.rig.face()[:, 0]))
    assert between == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_pictures_bring_the_beam_onto_the_face(seed: int) -> None:
    shot = start(150.0, seed)
    search = shot.search()
    search.run()
    assert search.left is None
    assert on_face(shot)
    assert len(shot.rig.moves) <= 2 + 6  # two of them to the posture


def test_markers_out_of_view_are_looked_for_around() -> None:
    """Half a picture is 24.6 degrees wide and 18.9 high."""
    shot = start(600.0, 0)
    search = shot.search()
    assert not blobs(shot.rig.image())
    search.run()
    assert search.left is None
    assert on_face(shot)


@pytest.mark.long
def test_what_is_found_by_nothing_is_a_reason() -> None:
    turned_away = {"placed": {"misturned_deg": [180.0, 0.0, 0.0]}}  # no markers
    assert reason(start(20.0, 3, psd=turned_away)) == RefusalReason.OUT_OF_VIEW
    assert reason(start(220.0, 1, camera=None)) == RefusalReason.OFF_FACE  # too far off for the spiral


def test_an_occluded_led_leaves_the_spiral() -> None:
    shot = start(20.0, 1, faults=[{"kind": "led-occluded", "shot": 1}])
    search = shot.search()
    search.run()
    assert search.left.reason == RefusalReason.OUT_OF_VIEW
    assert on_face(shot)


HAND_EYE: dict[str, Any] = {"slant_deg": 0, "camera": {"misturned_deg": [0.0, 1.2, 0.0]}}


def test_a_hand_eye_error_is_made_good_by_the_spot(monkeypatch: pytest.MonkeyPatch) -> None:
    """1.2 degrees are some 45 mm at 2.2 m: beside the face, on the housing."""
    shot = start(30.0, 1, **HAND_EYE)
    search = shot.search()
    search.run()
    assert search.left is None
    assert on_face(shot)
    monkeypatch.setattr(Search, "_by_spot", lambda *_: False)
    monkeypatch.setattr(Search, "_by_spiral", lambda *_: False)
    assert reason(start(30.0, 1, **HAND_EYE)) == RefusalReason.OFF_FACE


def test_a_reflection_in_the_picture_is_not_taken_for_the_spot(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is nearer to where the beam should be than the spot is, and bright."""
    monkeypatch.setattr(Search, "_by_spiral", lambda *_: False)
    reflection = {"kind": "reflection", "shot": 1, "at_mm": [-16.0, 14.0], "light": 0.9}
    shot = start(30.0, 1, **HAND_EYE, faults=[reflection])
    search = shot.search()
    search.run()
    assert on_face(shot)
    # To the posture, by the markers, after the reflection, onto the face: who follows it goes on for long.
    assert len(shot.rig.moves) <= 2 + 2 + 1 + 2


@pytest.mark.parametrize("black", [True, False])
def test_the_beam_alone_finds_the_face(black: bool) -> None:
    own: dict[str, Any] = {"faults": [{"kind": "camera-black", "shot": 1}]} if black else {"camera": None}
    shot = start(30.0, 1, **own)
    search = shot.search()
    search.run()
    assert on_face(shot)
    assert (search.left is not None and search.left.reason == RefusalReason.CAMERA) == black


def test_a_camera_that_goes_black_later_leaves_the_laser_on_for_the_spiral() -> None:
    shot = start(0.0, 1, camera={"misturned_deg": [0.0, 1.2, 0.0]})
    search = shot.search()
    pictures = 0
    image = shot.rig.image

    def fails() -> np.ndarray:
        nonlocal pictures
        pictures += 1
        return image() if pictures <= 2 else np.zeros((480, 640), np.uint8)

    shot.rig.image = fails  # type: ignore[method-assign]
    search.run()
    assert pictures > 2
    assert search.left.reason == RefusalReason.CAMERA
    assert on_face(shot)


def test_the_spiral_has_no_hole_on_a_face_at_a_slant() -> None:
    for seed in range(3):
        shot = start(30.0, seed, slant_deg=55.0, camera=None)
        shot.search().run()
        assert on_face(shot)


FAINT = {"noise_mm": 1e-7, "resolution_mm": 1e-7, "nonlinearity": 0.0}


def reason_of_centring(shot: Start, frame: Matrix | None = None) -> RefusalReason:
    with pytest.raises(MeasurementRefused) as refused:
        shot.centred(frame)
    return refused.value.reason


def watch_plateau(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps go on at the floor: neither good enough nor out of patience."""
    monkeypatch.setattr(steering, "ENOUGH_MM", 0.0)
    monkeypatch.setattr(steering, "_PATIENCE", 100)


@pytest.mark.parametrize("seed", range(3))
def test_the_spot_is_brought_to_the_centre(seed: int) -> None:
    shot = start(7.0, seed)
    off = shot.centred().off_mm
    assert 4 < off[0] < 25
    assert off[-1] <= steering.ENOUGH_MM
    assert np.linalg.norm(shot.rig.hit()) < steering.ENOUGH_MM + 0.001


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
    assert off[-1] <= steering.ENOUGH_MM  # as it follows it is put right

    def without_turn(self: Belief, joints: Matrix, frame: Matrix) -> tuple[Matrix, Matrix]:
        moving = [
            (self.beam(joints + way)[0] - self.beam(joints - way)[0]) / 2e-6 for way in 1e-6 * np.eye(6)
        ]
        return np.zeros(2), frame[:, :2].T @ np.column_stack(moving)

    monkeypatch.setattr(Belief, "spot", without_turn)
    assert reason_of_centring(start(7.0, 3, exact=True, psd=FAINT, slant_deg=20)) == RefusalReason.OFF_FACE


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
        steering.centre(
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
    assert max(shot[-1] for shot in off) <= steering.ENOUGH_MM
    monkeypatch.setattr(steering, "come_to", lambda rig, belief, joints: rig.move(joints))
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
    assert reason_of_centring(start(off_mm, seed, **cell)) == expected


def test_a_laser_that_is_a_little_too_bright_will_do() -> None:
    assert start(2.0, 2, laser={"light": 1.05}).centred().off_mm[-1] <= steering.ENOUGH_MM


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
