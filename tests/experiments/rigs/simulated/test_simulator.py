"""The simulated rig: the same seed the same shots, sensors that see what is there, and a clock."""

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from cells import good_plan, plan_of
from numpy.polynomial.legendre import leggauss
from scipy import stats

from zerobeam.experiments.procedure.steering import Belief
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import (
    ELECTRONS,
    SLOPE,
    PictureScene,
    SimulatedPsd,
    SimulatedRig,
    caught,
    harmonic_measures,
    render,
)
from zerobeam.experiments.sensors.detectors import Camera, Psd, PsdKind
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem

# Nothing is wrong with it, and its face is turned towards each beam: it reads across the beam.
EXACT_PSD = {"noise_mm": 1e-9, "resolution_mm": 1e-9, "nonlinearity": 0, "ambient": 0, "lost": 0}
FACING = {"normal": "beam", "misturned_deg": [0, 0, 0], "centre_mm": [900, 0, 0]}


@cache
def plan() -> Plan:
    return good_plan(4)


def exact(
    *,
    arm: dict[str, Any] | None = None,
    laser: dict[str, Any] | None = None,
    psd: dict[str, Any] | None = None,
    placed: dict[str, Any] | None = None,
    faults: list[dict[str, Any]] | None = None,
    camera: dict[str, Any] | None = None,
    seed: int = 0,
    of: Plan | None = None,
) -> SimulatedRig:
    content = {
        "arm": {"offsets_deg": {"delta2": 1.0}, "repeatability_deg": 0, "resolution_deg": 0, **(arm or {})},
        "laser": {"wander_mm": 0, **(laser or {})},
        "psd": {**EXACT_PSD, "placed": {"psd": {**FACING, **(placed or {})}}, **(psd or {})},
        "camera": camera,
        "faults": faults or [],
    }
    return SimulatedRig(of or plan(), CellFile.model_validate(content), seed)


def on_target(rig: SimulatedRig, shot: int = 0, off: Matrix | None = None) -> Matrix:
    """(n,) joints with which a beam as the truth has it hits its PSD's centre, or (3,) mm beside it."""
    truth = rig._parts.truth
    belief = Belief(truth.problem.select(np.array([shot])), truth.x)
    joints = belief.with_target(belief.target + (np.zeros(3) if off is None else off)).onto_target(
        plan().postures[shot]
    )
    assert joints is not None
    return joints


def beam(rig: SimulatedRig, shot: int, joints: Matrix) -> tuple[Matrix, Matrix]:
    """(3,) mm origin and (3,) direction of the beam of the truth."""
    truth = rig._parts.truth
    return Belief(truth.problem.select(np.array([shot])), truth.x).beam(joints)


def spot(rig: SimulatedRig, shot: int = 0, joints: Matrix | None = None) -> tuple[Matrix, float]:
    """(2,) mm what the PSD reads in a shot, and its light."""
    rig.begin(shot, "psd", None)
    rig.move(on_target(rig, shot) if joints is None else joints)
    rig.laser(True)
    currents = rig.currents(1)[0]
    psd = rig.psds["psd"]
    return psd.position(currents), float(psd.light(currents))


def recorded(shot: int, seconds: float = 100.0) -> Shot:
    degrees = tuple(float(v) for v in np.degrees(plan().postures[shot]))
    return Shot(shot=shot, target="psd", joints_deg=degrees, time_s=seconds)


def told(rig: SimulatedRig, shot: int, last: Shot | None) -> bytes:
    """All that a rig tells in a shot."""
    rig.begin(shot, "psd", last)
    rig.move(plan().postures[shot])
    rig.laser(True)
    values = [rig.now(), rig.joints(), rig.currents(30), rig.image(), rig.now()]
    return b"".join(np.asarray(value).tobytes() for value in values)


def test_what_follows_a_begin_depends_on_seed_shot_and_last_shot_alone() -> None:
    fresh, used = SimulatedRig(plan(), CellFile(), 4), SimulatedRig(plan(), CellFile(), 4)
    for shot in (0, 3, 0):
        told(used, shot, None)
    assert told(used, 1, recorded(0)) == told(fresh, 1, recorded(0))
    again = told(fresh, 1, recorded(0))
    assert again == told(fresh, 1, recorded(0))
    assert again != told(fresh, 1, recorded(2))
    assert again != told(fresh, 1, recorded(0, 200.0))
    assert again != told(fresh, 2, recorded(0))
    assert again != told(SimulatedRig(plan(), CellFile(), 5), 1, recorded(0))


def test_a_resumed_rig_is_the_same_cell() -> None:
    whole, resumed = SimulatedRig(plan(), CellFile(), 4), SimulatedRig(plan(), CellFile(), 4, resumed=True)
    assert told(resumed, 1, recorded(0)) == told(whole, 1, recorded(0))
    assert resumed.provenance() == whole.provenance()
    assert whole.provenance()["origin"] == "simulated"
    assert whole.provenance()["seed"] == 4


def test_a_beam_that_the_truth_puts_on_the_centre_is_read_there() -> None:
    position, light = spot(exact())
    assert np.abs(position).max() < 1e-5
    assert light == pytest.approx(1.0, abs=1e-9)
    # The control: without the offset that is stated in the cell it would be beside it by centimetres.
    plain = on_target(exact(arm={"offsets_deg": {}}))
    assert spot(exact(psd={"size_mm": 100}), joints=plain)[1] == pytest.approx(1.0)
    assert np.linalg.norm(spot(exact(psd={"size_mm": 100}), joints=plain)[0]) > 5.0


def test_a_shifted_or_tilted_beam_is_read_so() -> None:
    """By the shift, and by tan of the tilt times the way from the TCP to the PSD."""
    shifted, _ = spot(exact(laser={"shift_mm": [3.0, -4.0]}))
    assert np.linalg.norm(shifted) == pytest.approx(5.0, abs=1e-5)
    rig = exact()
    tilted, _ = spot(exact(laser={"tilt_deg": [0.1, 0]}))
    origin, _ = beam(rig, 0, on_target(rig))
    way = float(np.linalg.norm(origin - [900, 0, 0]))
    assert np.linalg.norm(tilted) == pytest.approx(np.tan(np.radians(0.1)) * way, rel=1e-5)


def test_a_drifting_beam_moves_with_the_clock() -> None:
    rig = exact(laser={"drift_deg_min": [0.01, 0]})
    spot(rig)
    still = exact()
    spot(still)
    moved = []
    for _ in range(2):
        moved.append(rig.psds["psd"].position(rig.currents(1)[0]))
        rig.wait(60.0 - 1 / 200)  # a sample takes 5 ms
    way = np.linalg.norm(moved[1] - moved[0])
    tilted = np.linalg.norm(spot(exact(laser={"tilt_deg": [0.01, 0]}))[0])
    assert way == pytest.approx(tilted, rel=1e-4)
    standing = still.currents(1)
    still.wait(60.0)
    np.testing.assert_allclose(still.currents(1), standing, atol=1e-8)


@pytest.mark.long
def test_the_beam_wanders_from_shot_to_shot_by_the_plans_spot_noise() -> None:
    """300 shots: the squares across the beam are chi-squared, of the plan's noise or of what is stated."""
    for stated, std in ((None, 0.05), (0.2, 0.2)):
        rig = exact(laser={"wander_mm": stated})
        joints = on_target(rig)
        spots = np.array([spot(rig, shot, joints)[0] for shot in range(300)])
        low, high = stats.chi2.ppf([0.0005, 0.9995], spots.size)
        assert low < (spots**2).sum() / std**2 < high
        assert np.abs(spots.mean(axis=0)).max() < 4 * std / np.sqrt(300)
        assert abs(np.corrcoef(spots.T)[0, 1]) < 4 / np.sqrt(300)


def test_within_a_shot_the_beam_does_not_wander() -> None:
    rig = exact(laser={"wander_mm": 0.2})
    first, _ = spot(rig)
    np.testing.assert_allclose(rig.psds["psd"].position(rig.currents(1)[0]), first, atol=1e-6)


@pytest.mark.parametrize(
    ("stated", "deg"), [(None, 0.01), (0.03, 0.03), ([0.01, 0.02, 0.03, 0.04, 0.05, 0.06], None)]
)
@pytest.mark.one_in(3)
def test_the_joints_stand_off_by_the_plans_noise_or_by_what_is_stated(stated: Any, deg: float | None) -> None:
    """300 shots: each joint's errors are chi-squared with 300 degrees of freedom."""
    rig = exact(arm={"repeatability_deg": stated})
    std = np.radians(stated if deg is None else deg) * np.ones(6)
    if stated is None:
        np.testing.assert_array_equal(std, Problem.from_plan(plan()).noise.joint)
    errors = []
    for shot in range(300):
        rig.begin(shot, "psd", None)
        errors.append(rig._arm.link() - rig.joints() - rig._parts.arm.offsets)
    low, high = stats.chi2.ppf([0.0001, 0.9999], 300)
    squares = (np.array(errors) ** 2).sum(axis=0) / std**2
    assert ((low < squares) & (squares < high)).all()


def test_a_link_that_is_not_as_drawn_moves_the_beam() -> None:
    """The whole arm 3 mm higher: the spot moves by what of that is across the beam."""
    rig, higher = exact(), exact(arm={"geometry": [{"joint": 1, "xyz_mm": [0, 0, 3.0]}]})
    joints = on_target(rig)
    _, direction = beam(rig, 0, joints)
    across = np.linalg.norm(np.cross([0, 0, 3.0], direction))
    assert across > 0.5
    assert np.linalg.norm(spot(higher, joints=joints)[0]) == pytest.approx(across, abs=1e-4)


def test_a_face_is_turned_towards_each_beam_or_stands() -> None:
    turned, fixed, faces = exact(), exact(placed={"normal": [0, 0, 1]}), set()
    for shot in range(3):
        for rig in (turned, fixed):
            joints = on_target(rig, shot)
            spot(rig, shot, joints)
            _, direction = beam(rig, shot, joints)
        faces.add(tuple(turned._face[:, 2].round(3)))
        np.testing.assert_allclose(turned._face[:, 2], -direction, atol=1e-6)
        np.testing.assert_allclose(fixed._face[:, 2], [0, 0, 1], atol=1e-12)
        assert np.linalg.norm(fixed._face[:, 2] + direction) > 0.01
    assert len(faces) == 3


def test_a_face_does_not_turn_while_the_laser_is_on() -> None:
    rig = exact()
    spot(rig)
    before = rig._face.copy()
    rig.move(on_target(rig, off=np.array([0, 5.0, 0])))
    np.testing.assert_array_equal(rig._face, before)


def test_a_psd_that_is_truly_turned_away_gets_no_light_and_shows_no_marker() -> None:
    """The beam meets its back, and so does the camera; a face that is turned to them is lit, and seen."""
    quiet = {"noise_grey": 0, "ambient_grey": 0}
    for turn, seen in ((0, True), (180, False)):
        rig = exact(placed={"misturned_deg": [turn, 0, 0]}, camera=quiet)
        _, light = spot(rig)
        assert light == pytest.approx(1.0 if seen else 0.0, abs=1e-9)
        assert bool(rig.image().any()) == seen


def test_the_beam_beside_the_face_gives_no_light() -> None:
    rig = exact()
    off = on_target(rig, off=np.array([0, 40.0, 0]))
    assert spot(rig, joints=off)[1] == pytest.approx(0.0, abs=1e-9)


def test_a_psd_that_no_beam_meets_is_refused_before_anything_moves(refused: Callable[..., BadInput]) -> None:
    assert "deg off the beams" in str(refused(exact, placed={"centre_mm": [-900, 0, 3000]}))
    assert "turned away from all beams" in str(refused(exact, placed={"normal": [0, 0, -1]}))


def test_a_psd_in_view_of_four_postures_will_do() -> None:
    """The fewest that the method can tell anything from; the others are refused when they come."""
    away = plan().postures[0].copy()
    away[5] -= np.copysign(np.pi, away[5])  # the beam comes out of the flange's other side
    there = plan().postures[1]
    exact(of=plan_of(plan().header, np.array([away, there, there, there, there])))
    with pytest.raises(BadInput, match="out of view in 2 of the plan's 5 postures"):
        exact(of=plan_of(plan().header, np.array([away, there, away, there, there])))


def test_each_target_has_its_own_psd() -> None:
    places = {"left": [900.0, 150.0, 0.0], "right": [900.0, -150.0, 0.0]}
    own = plan().header.model_copy(update={"targets": {}})
    two = plan_of(own, np.tile(plan().postures[:1], (2, 1)), ["left", "right"])
    placed = {name: {**FACING, "centre_mm": place} for name, place in places.items()}
    rig = exact(of=two, psd={"placed": placed})
    truth = rig._parts.truth
    assert set(rig.psds) == set(places)
    for shot, name in enumerate(places):
        joints = Belief(truth.problem.select(np.array([shot])), truth.x).onto_target(two.postures[shot])
        assert joints is not None
        light = {}
        for target in places:
            rig.begin(shot, target, None)
            rig.move(joints)
            rig.laser(True)
            light[target] = rig.psds[target].light(rig.currents(1)[0])
        assert light == {other: pytest.approx(float(other == name), abs=1e-6) for other in places}


def test_a_move_beyond_a_limit_is_refused_and_the_arm_stays() -> None:
    rig = exact()
    rig.begin(0, "psd", None)
    before, time = rig.joints(), rig.now()
    beyond = plan().postures[0].copy()
    beyond[4] = plan().robot.upper[4] + 0.01
    with pytest.raises(RigFault, match="joint 5 would leave its limits"):
        rig.move(beyond)
    np.testing.assert_array_equal(rig.joints(), before)
    assert rig.now() == time


def test_every_use_takes_its_time() -> None:
    rig = exact(arm={"latency_s": 0.3, "speed": 0.5}, psd={"rate_hz": 50}, camera={"image_s": 0.7})
    rig.begin(0, "psd", recorded(1, 12.0))

    def took(use: Callable[[], object]) -> float:
        before = rig.now()
        use()
        return rig.now() - before

    assert rig.now() == 12.0
    # From where the last shot was recorded: a way of 1 rad of joint 1, at half its 150 deg/s, by 300 deg/s^2.
    way = plan().postures[1] + np.array([np.copysign(1.0, -plan().postures[1][0]), 0, 0, 0, 0, 0])
    top = np.radians(75.0)
    assert took(lambda: rig.move(way)) == pytest.approx(0.3 + 1 / top + top / np.radians(300.0))
    assert took(lambda: rig.currents(25)) == pytest.approx(0.5)
    assert took(rig.image) == pytest.approx(0.7)
    assert took(lambda: rig.wait(2.5)) == pytest.approx(2.5)
    assert took(rig.joints) == 0.0
    assert 0 < took(lambda: rig.laser(True)) < 1


def test_a_cell_without_a_camera_has_no_picture() -> None:
    rig = exact()
    assert rig.camera is None
    with pytest.raises(RigFault, match="no camera"):
        rig.image()


def test_stopping_puts_the_laser_out() -> None:
    rig = exact()
    assert spot(rig)[1] == pytest.approx(1.0)
    rig.stop()
    rig.stop()
    assert rig.psds["psd"].light(rig.currents(1)[0]) == pytest.approx(0.0, abs=1e-9)


def test_a_bumped_psd_stands_elsewhere_from_its_shot_on() -> None:
    rig = exact(faults=[{"kind": "psd-bump", "shot": 2, "shift_mm": [0, 3.0, 0]}])
    for shot in range(4):
        joints = on_target(rig, shot)
        _, direction = beam(rig, shot, joints)
        across = np.linalg.norm(np.cross([0, 3.0, 0], direction)) if shot >= 2 else 0.0
        assert np.linalg.norm(spot(rig, shot, joints)[0]) == pytest.approx(across, abs=1e-5)


def test_a_reflection_adds_its_light_where_the_beam_does_not_point() -> None:
    stated = {"kind": "reflection", "shot": 0, "at_mm": [4.0, -3.0], "light": 0.8}
    rig = exact(faults=[stated])
    position, light = spot(rig)
    assert light == pytest.approx(1.8)
    np.testing.assert_allclose(position, np.array([4.0, -3.0]) * 0.8 / 1.8, atol=1e-4)
    # Beside the face the beam gives none of its own, wherever it is: by its light this is a weak beam.
    for aside in (20.0, 40.0):
        position, light = spot(rig, joints=on_target(rig, off=np.array([0, aside, 0])))
        assert light == pytest.approx(0.8)
        np.testing.assert_allclose(position, [4.0, -3.0], atol=1e-4)
    # It is a reflection of the laser: without it there is none.
    rig.laser(False)
    assert rig.psds["psd"].light(rig.currents(1)[0]) == pytest.approx(0.0, abs=1e-9)
    dim = exact(faults=[stated], laser={"light": 0.5})
    assert spot(dim)[1] == pytest.approx(0.9)


def test_a_reflection_is_in_the_picture_wherever_the_beam_is() -> None:
    quiet = {"noise_grey": 0, "ambient_grey": 0}
    rig = exact(camera=quiet, faults=[{"kind": "reflection", "shot": 0}])
    spot(rig, joints=on_target(rig, off=np.array([0, 80.0, 0])))  # beyond the housing
    lit = rig.image().sum(dtype=np.int64)
    rig.laser(False)
    assert lit > rig.image().sum(dtype=np.int64)


def test_a_stuck_encoder_shows_in_the_reading_and_not_in_the_arm() -> None:
    rig = exact(faults=[{"kind": "encoder-glitch", "shot": 0, "joint": 3, "deg": 0.5, "lasts": 1}])
    rig.begin(0, "psd", None)
    wrong, right = rig.joints(), rig.joints()
    np.testing.assert_allclose(np.degrees(wrong - right), [0, 0, 0.5, 0, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(right, rig._arm.read())


def test_what_does_not_arrive_is_not_a_number() -> None:
    rig = exact(psd={"lost": 0.3}, faults=[{"kind": "psd-dropout", "shot": 1, "lasts": 1}])
    spot(rig)
    lost = np.isnan(rig.currents(2000))
    assert (lost.all(axis=1) == lost.any(axis=1)).all()  # a sample is lost as a whole
    # Of 2000 samples, four stds of a binomial about 600.
    assert abs(lost[:, 0].sum() - 600) < 4 * np.sqrt(2000 * 0.3 * 0.7)
    rig.begin(1, "psd", None)
    assert np.isnan(rig.currents(5)).all()
    assert np.isfinite(rig.currents(50)).any()


SIZE = 20.0
KINDS: tuple[PsdKind, ...] = ("duo-lateral", "tetra-lateral")
QUIET = 1e-15  # mm of noise: none


def device(
    kind: PsdKind = "duo-lateral",
    *,
    noise: float = QUIET,
    saturation: float = 10.0,
    beam: float = 0.8,
    nonlinearity: float = 0.0,
    ambient: float = 0.0,
    resolution: float = 0.0,
) -> SimulatedPsd:
    psd = Psd(SIZE, kind, 200.0, noise, saturation, np.zeros((2, 3)), None, 0.0)
    return SimulatedPsd(psd, beam, nonlinearity, ambient, resolution)


def currents(
    own: SimulatedPsd, *hit: float, share: float = 1.0, samples: int = 1, seed: int = 0
) -> np.ndarray:
    return own.currents(np.array(hit) if hit else None, share, samples, np.random.default_rng(seed))


def reading(own: SimulatedPsd, *hit: float, share: float = 1.0) -> np.ndarray:
    return own.psd.position(currents(own, *hit, share=share))[0]


def hits(count: int) -> np.ndarray:
    """Where all of the beam is on the face: 7.5 of its stds from an edge or more."""
    return np.random.default_rng(3).uniform(-7, 7, (count, 2))


def test_a_truncated_beam_against_numerical_integration() -> None:
    """Within the face, across an edge, across a corner, beside it: 400 x 400 Gauss-Legendre nodes."""
    size, beam = 10.0, 4.0
    nodes, weights = leggauss(400)
    x, y = np.meshgrid(nodes * size / 2, nodes * size / 2, indexing="ij")
    for hit in ([0.3, -0.2], [4.5, 1.0], [-5.5, 4.9], [-9.0, 0.0], [0.0, 12.0]):
        density = 2 / (np.pi * beam**2) * np.exp(-2 * ((x - hit[0]) ** 2 + (y - hit[1]) ** 2) / beam**2)
        light = np.outer(weights, weights) * (size / 2) ** 2 * density
        share, spot = caught(np.array(hit), beam, size)
        assert share == pytest.approx(light.sum(), rel=1e-9)
        np.testing.assert_allclose(spot, [(light * x).sum(), (light * y).sum()] / light.sum(), atol=1e-9)


def test_a_beam_far_off_leaves_no_light() -> None:
    for far in (30.0, 300.0, 3e6):
        share, spot = caught(np.array([far, -far]), 1.0, SIZE)
        assert 0 <= share < 1e-300
        assert (np.abs(spot) <= SIZE / 2).all()
        assert spot[0] > 0.99 * SIZE / 2 > 0 > spot[1]


def test_a_beam_across_an_edge_is_weak_and_read_at_its_centroid() -> None:
    own = device(beam=2.0)
    row = currents(own, SIZE / 2, 0.0)
    assert own.psd.light(row)[0] == pytest.approx(0.5)
    # Half a normal of std beam / 2 = 1 mm: its mean is sqrt(2 / pi) from the edge.
    np.testing.assert_allclose(own.psd.position(row)[0], [SIZE / 2 - np.sqrt(2 / np.pi), 0.0], atol=1e-9)


def series(x: float, y: float) -> float:
    """Harmonic measure of the edge x = 1: cos(a y) sinh(a (x + 1)) / sinh(2 a), a = k pi / 2, k odd."""
    k = np.arange(1, 2001, 2)
    a = k * np.pi / 2
    rise = np.exp(a * (x - 1)) * (1 - np.exp(-2 * a * (x + 1))) / (1 - np.exp(-4 * a))
    return float((4 / (k * np.pi) * (-1.0) ** (k // 2) * np.cos(a * y) * rise).sum())


def test_harmonic_measures_against_the_fourier_series() -> None:
    """Up to 0.02 half sizes from an edge: the series' 1001st term is below exp(-2000 pi 0.01) = 1e-27."""
    for x, y in np.random.default_rng(4).uniform(-0.98, 0.98, (300, 2)):
        np.testing.assert_allclose(
            harmonic_measures(np.array([x, y])),
            [series(x, y), series(-x, y), series(y, x), series(-y, x)],
            atol=1e-11,
        )


def test_harmonic_measures_that_are_known() -> None:
    np.testing.assert_allclose(harmonic_measures(np.zeros(2)), 0.25, atol=1e-15)
    # On a diagonal the two edges at its end are alike, and so are the other two.
    for u in (-0.7, 0.2, 0.9):
        right, left, top, bottom = harmonic_measures(np.array([u, u]))
        assert right == pytest.approx(top, abs=1e-12)
        assert left == pytest.approx(bottom, abs=1e-12)
    # On an edge all of the current is that edge's.
    for i, end in enumerate(([1, 0], [-1, 0.3], [0, 1], [-0.6, 1], [0.3, -1])):
        edge = (0, 1, 2, 2, 3)[i]
        np.testing.assert_allclose(harmonic_measures(np.array(end, float)), np.eye(4)[edge], atol=1e-12)


def test_a_duo_lateral_psd_is_linear() -> None:
    own = device()
    for hit in hits(50):
        np.testing.assert_allclose(reading(own, *hit), hit, atol=1e-12)
        assert own.psd.light(currents(own, *hit, share=0.4))[0] == pytest.approx(0.4)


@pytest.mark.parametrize("kind", KINDS)
def test_nonlinearity_grows_with_the_cube(kind: PsdKind) -> None:
    bent, straight = device(kind, nonlinearity=0.02), device(kind)
    for hit in hits(20):
        u = hit / (SIZE / 2)
        np.testing.assert_allclose(
            reading(bent, *hit), reading(straight, *(u - 0.02 * u**3) * SIZE / 2), atol=1e-12
        )
    duo = device(nonlinearity=0.02)
    assert reading(duo, 0.75 * SIZE / 2, 0.0)[0] == pytest.approx((0.75 - 0.02 * 0.75**3) * SIZE / 2)


def test_a_tetra_lateral_psd_is_right_near_its_centre_alone() -> None:
    """The relative error is of second order: twice as far off, four times as large. Far out it is gross."""
    own = device("tetra-lateral")
    errors = [reading(own, u * SIZE / 2, 0.0)[0] / (u * SIZE / 2) - 1 for u in (0.005, 0.01, 0.02)]
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1]), 4.0, rtol=1e-3)
    assert abs(errors[0]) < 1e-4
    assert reading(own, 0.7 * SIZE / 2, 0.0)[0] < 0.9 * 0.7 * SIZE / 2
    # The rule of the other kind is wrong at the centre already.
    duo = device()
    assert duo.psd.position(currents(own, 0.1, 0.0))[0, 0] > 1.5 * 0.1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [1.0, 0.2])
def test_noise_is_as_stated_and_grows_as_light_falls(kind: PsdKind, share: float) -> None:
    own = device(kind, noise=2e-3)
    positions = own.psd.position(currents(own, 0.0, 0.0, share=share, samples=20_000))
    low, high = np.sqrt(stats.chi2.ppf([0.0005, 0.9995], 20_000) / 20_000)
    for std in positions.std(axis=0, mean=np.zeros((1, 2))) * share / 2e-3:
        assert low < std < high
    assert np.abs(positions.mean(axis=0)).max() < 4 * 2e-3 / share / np.sqrt(20_000)
    # The two directions and successive samples have nothing to do with each other: 4 / sqrt(20,000).
    assert abs(np.corrcoef(positions.T)[0, 1]) < 4 / np.sqrt(20_000)
    assert abs(np.corrcoef(positions[1:, 0], positions[:-1, 0])[0, 1]) < 4 / np.sqrt(19_999)


@pytest.mark.parametrize("kind", KINDS)
def test_the_reading_goes_in_steps(kind: PsdKind) -> None:
    """Of the stated size at most, and never off by more than half of it (but for the pair's rounded sum)."""
    step = 0.001
    coarse, fine = device(kind, resolution=step), device(kind)
    x = np.linspace(-0.005, 0.005, 201)
    read = np.array([reading(coarse, at, 0.0)[0] for at in x])
    # The sum of a pair is right to two steps of a current, in a reading of 5 steps.
    slack = 5 * step * 2 * (step / 2 / coarse.psd.reach) / 0.5
    assert np.abs(read - x).max() < step / 2 + slack
    assert np.abs(read - x).max() > step / 5
    halves = read / (step / 2)
    assert np.abs(halves - np.round(halves)).max() < slack / (step / 2)
    steps = np.diff(read)
    assert (steps > -slack).all()
    assert steps.max() < step + slack
    assert (np.abs(steps) < slack).sum() > 150
    assert np.abs([reading(fine, at, 0.0)[0] - at for at in x]).max() < 1e-8


def test_ambient_light_pulls_to_the_centre_until_it_is_subtracted() -> None:
    own = device(ambient=0.25)
    dark = currents(own, share=0.0)
    assert own.psd.light(dark)[0] == pytest.approx(0.25)
    for hit in hits(10):
        row = currents(own, *hit)
        np.testing.assert_allclose(own.psd.position(row)[0], hit / 1.25, atol=1e-12)
        np.testing.assert_allclose(own.psd.position(row - dark)[0], hit, atol=1e-12)
    np.testing.assert_allclose(own.psd.position(dark), 0.0, atol=1e-12)


def test_ambient_light_on_a_tetra_lateral_psd() -> None:
    """Near the centre the same share; taken off, the reading is that in the dark wherever the spot is."""
    own, alone = device("tetra-lateral", ambient=0.25), device("tetra-lateral")
    dark = currents(own, share=0.0)
    assert own.psd.light(dark)[0] == pytest.approx(0.25)
    assert reading(own, 0.01, 0.0)[0] == pytest.approx(0.01 / 1.25, rel=1e-5)
    for hit in hits(10):
        corrected = own.psd.position(currents(own, *hit) - dark)[0]
        np.testing.assert_allclose(corrected, reading(alone, *hit), atol=1e-12)
        assert np.abs(reading(own, *hit) - corrected).max() > 0.01


def test_no_beam_and_no_light_is_no_position() -> None:
    own = device()
    np.testing.assert_allclose(currents(own), 0.0, atol=1e-15)
    exact = dataclasses.replace(own, psd=dataclasses.replace(own.psd, noise=0.0))
    assert np.isnan(exact.psd.position(currents(exact))).all()
    assert np.isnan(exact.psd.position(currents(exact, 1.0, 2.0, share=0.0))).all()


def test_saturation_is_flagged_and_misleads() -> None:
    """At u = 0.6 an electrode of two layers has 0.8 of the light, more than 0.7; at 0.3 it has 0.65."""
    for resolution in (0.0, 0.01):
        own = device(saturation=0.7, resolution=resolution)
        row = currents(own, 0.6 * SIZE / 2, 0.0)
        assert own.psd.saturated(row).all()
        assert row.max() == 0.7
        assert abs(own.psd.position(row)[0, 0] - 0.6 * SIZE / 2) > 0.1
        assert not own.psd.saturated(currents(own, 0.3 * SIZE / 2, 0.0)).any()
        assert not own.psd.saturated(currents(own, 0.6 * SIZE / 2, 0.0, share=0.8)).any()


DARK: dict[str, Any] = {"exposure": 1.0, "ambient": 0.0, "noise": 0.0, "psf": 1.2}


def camera(width: int = 96, height: int = 64) -> Camera:
    middle = ((width - 1) / 2, (height - 1) / 2)
    return Camera(width, height, (800.0, 800.0), middle, (0.0,) * 5, np.eye(4))


def scene(*points: tuple[float, float, float], brightness: float = 2000.0, size: float = 0.0) -> PictureScene:
    count = len(points)
    return PictureScene(np.array(points).reshape(-1, 3), np.full(count, brightness), np.full(count, size))


def picture(lights: PictureScene, seed: int = 0, view: Camera | None = None, **other: Any) -> np.ndarray:
    return render(view or camera(), lights, rng=np.random.default_rng(seed), **{**DARK, **other})


def mean_picture(lights: PictureScene, count: int = 100, first: int = 0, **other: Any) -> np.ndarray:
    return np.mean([picture(lights, seed, **other) for seed in range(first, first + count)], axis=0)


def test_light_falls_where_the_point_projects_to_and_as_wide_as_stated():
    """A mean of 100 pictures over a background, which keeps the noise whole on both sides."""
    view, lights = camera(), scene((7.3, -4.1, 900.0), size=1.5)
    background = mean_picture(scene(), first=100, ambient=20.0, noise=1.0)
    image = mean_picture(lights, ambient=20.0, noise=1.0) - background
    rows, columns = np.mgrid[: view.height, : view.width]
    total = image.sum()
    expected = 2000 / (0.9**2 + (7.3**2 + 4.1**2) / 1e6)
    # Each mean has per pixel (1 + 20/40 + 1/12) / 100, the light (total / 40) / 100 on top.
    each = 2 * (1.0 + 20 * (1 + SLOPE) / ELECTRONS + 1 / 12) / 100
    assert abs(total - expected) < 4 * np.sqrt(each * image.size + total / ELECTRONS / 100)
    x, y = view.project(lights.points)[0]
    near = np.hypot(rows - y, columns - x) < 10
    weight = np.where(near, image, 0.0)
    sigma = np.hypot(800 * 1.5 / 900, 1.2)
    # Of a sum over π 10² pixels, x² is 10²/4 on average and (x² - sigma²)² some 10⁴/8.
    lever = np.sqrt(each * np.pi * 100 * 25) / expected
    assert abs((weight * columns).sum() / weight.sum() - x) < 4 * lever + 1e-3
    assert abs((weight * rows).sum() / weight.sum() - y) < 4 * lever + 1e-3
    spread = (weight * ((columns - x) ** 2 + (rows - y) ** 2)).sum() / weight.sum() / 2
    assert abs(spread - sigma**2 - 1 / 12) < 4 * np.sqrt(each * np.pi * 100 * 1250) / expected


def test_light_falls_with_the_square_of_the_distance_and_grows_with_exposure():
    peak = {}
    for distance, exposure in ((1000.0, 1.0), (2000.0, 1.0), (2000.0, 4.0)):
        image = mean_picture(scene((0.0, 0.0, distance)), 50, exposure=exposure, ambient=10.0)
        peak[distance, exposure] = image[28:36, 44:52].sum() - 64 * 10
    # 64 pixels of background and 2,000 (or 500) grey values of light, 50 pictures: 1.1 of noise.
    assert peak[1000, 1] / peak[2000, 1] == pytest.approx(4, rel=0.02)
    assert peak[1000, 1] == pytest.approx(peak[2000, 4], rel=0.01)


def test_noise_is_as_stated():
    """Variance of a pixel: read noise, shot noise and rounding, at two levels."""
    for ambient, noise in ((20.0, 2.0), (120.0, 1.0)):
        one, other = (picture(scene(), seed, ambient=ambient, noise=noise).astype(float) for seed in (1, 2))
        squares = ((one - other) ** 2).sum() / 2
        low, high = stats.chi2.ppf([0.0005, 0.9995], one.size)
        expected = noise**2 + ambient / ELECTRONS + 1 / 12
        assert low < squares / expected < high
        assert not low < squares / (noise**2 + 1 / 12) < high  # control: shot noise left out


def test_the_background_slopes_gently():
    image = mean_picture(scene(), 50, ambient=100.0)
    corners = [image[:4, :4].mean(), image[-4:, -4:].mean(), image[30:34, 46:50].mean()]
    assert corners == pytest.approx([100 * (1 - SLOPE), 100 * (1 + SLOPE), 100], abs=1.5)


def test_lights_behind_or_beside_are_not_drawn():
    nothing = picture(scene(), ambient=10.0, noise=1.0)
    aside = scene((0.0, 0.0, -1000.0), (500.0, 0.0, 1000.0), (0.0, -500.0, 1000.0), (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(picture(aside, ambient=10.0, noise=1.0), nothing)
    assert (picture(scene((0.0, 0.0, 1000.0)), ambient=10.0, noise=1.0) != nothing).any()


@pytest.mark.parametrize("out", [-0.5, 0.8, 3.0])
def test_a_light_at_the_edge_is_cut_off(out):
    """What is in the picture is what a larger picture has there, wherever the centre is."""
    view = camera()
    wide = Camera(128, 64, view.focal, (view.centre[0] + 32, view.centre[1]), view.distortion, np.eye(4))
    x = (-out - view.centre[0]) / 800 * 1000
    lights = scene((x, 0.0, 1000.0), (0.0, 0.0, 1000.0))
    cut = mean_picture(lights, 40, ambient=10.0)
    whole = mean_picture(lights, 40, view=wide, ambient=10.0)[:, 32:]
    light = np.clip(cut - 10, 0, None)
    # The slope of the background differs between the two by a few tenths of a grey value.
    assert np.abs(cut - whole).max() < 1.0 + 5 * np.sqrt(2 * (light.max() + 10) / ELECTRONS / 40)
    assert light[:, 0].sum() > 20  # it is not left out


def test_a_bright_light_saturates():
    image = picture(scene((0.0, 0.0, 1000.0), brightness=1e4), ambient=10.0)
    assert image.dtype == np.uint8
    assert (image == 255).sum() > 9
    assert image[:, 0].max() < 30
