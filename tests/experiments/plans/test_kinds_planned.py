"""Plans for every kind of instrument, and for mixes: what is chosen, what is refused, what is kept to."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from plan_requests import plan_request

from zerobeam.analysis.observability.check import check
from zerobeam.analysis.observability.clearance import Clearance
from zerobeam.experiments.plans.candidates import Planned, candidates
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.experiments.plans.make import Portion, make_plan
from zerobeam.experiments.plans.optimal import Planner
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Box, Means, Obstacles, Plan, read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.likelihood.problem import Problem

LASER = {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
TIP = {"tip_mm": [40, 0, 120], "sigma_mm": 0.02}
STAND = [3000, 500, 800]
TRACKER = {
    "kind": "tracker",
    "guess_mm": STAND,
    "sigma_mm": 0.03,
    "reflectors": {
        "R1": {"guess_mm": [50, 0, 30], "direction": [0, 0, 1], "acceptance_deg": 40},
        "R2": {"guess_mm": [-50, 40, 30]},
    },
}
FACES = {
    "top": {"kind": "plane", "normal": [0, 0, 1], "guess_mm": [900, 0, 300], "sigma_mm": 5},
    "side": {"kind": "plane", "normal": [-1, 0, 0], "guess_mm": [850, 0, 250], "sigma_mm": 5},
}
BALL = {"ball": {"kind": "sphere", "diameter_mm": 40, "guess_mm": [900, 100, 400], "sigma_mm": 5}}
SOCKET = {"s1": {"guess_mm": [900, 200, 100], "sigma_mm": 5}}
INSTRUMENTS = {
    "tracker": (TRACKER, {}),
    "pose": ({"kind": "pose", "sigma_mm": 0.03, "sigma_deg": 0.01, "guess_mm": STAND}, {}),
    "plane": ({"kind": "plane", "tip_diameter_mm": 6, **TIP}, FACES),
    "sphere": ({"kind": "sphere", "tip_diameter_mm": 6, **TIP}, BALL),
    "ballbar": ({"kind": "ballbar", "range_mm": [300, 420], **TIP}, SOCKET),
    "dial": ({"kind": "dial", "direction": [0, 0, 1], **TIP}, FACES),
}


def header_of(*kinds: str, geometry: str | None = "exact", tool: bool = False, **more: object) -> Header:
    targets = {name: target for kind in kinds for name, target in INSTRUMENTS[kind][1].items()}
    if tool:
        targets["psd"] = {"guess_mm": [900, 0, 0]}
    content = {
        "robot": "irb1600",
        "noise": {"joint_deg": 0.005, **({"spot_mm": 0.05} if tool else {})},
        "instruments": {kind: INSTRUMENTS[kind][0] for kind in kinds},
        "targets": targets,
        **({"tool": LASER} if tool else {}),
        **({"geometry": geometry} if geometry else {}),
        **more,
    }
    return Header.model_validate({key: value for key, value in content.items() if value})


def made(own: Header, **changes: object) -> Plan:
    settings = {"target": None, "shots": 12, "candidates": 150, **changes}
    plan = make_plan(plan_request(header=own, **settings), None, lambda stage, share: None).plan
    assert plan is not None
    return plan


@pytest.mark.long
@pytest.mark.parametrize("kind", INSTRUMENTS)
@pytest.mark.at_length(r"^(?!plane$)")
def test_a_plan_keeps_to_what_its_instrument_can_measure(kind):
    """Chosen for it, it is found sound by `check`; postures at random are not (the control)."""
    plan = made(header_of(kind))
    assert len(plan.postures) == 12
    assert not check_plan(plan).violations
    rng = np.random.default_rng(0)
    rows = rng.uniform([-60, -20, -40, -90, -60, -120], [60, 50, 30, 90, 60, 120], (12, 6))
    means = [Means(None, "R1")] * 12 if kind == "tracker" else ()
    random = Plan.of_postures(plan.header, plan.robot, rows, plan.targets, "random", plan.constraints, means)
    if kind != "pose":
        assert any(each.condition == "unfit" for each in check_plan(random).violations)


@pytest.mark.parametrize("kind", ["plane", "sphere", "ballbar"])
@pytest.mark.long
def test_it_determines_more_than_postures_at_random(kind):
    own = header_of(kind)
    robot = load_robot("irb1600", Path("."))
    planned = Planned(kind, target=next(iter(INSTRUMENTS[kind][1])))
    pool = candidates(own, robot, None, 200, obstacles=Obstacles(), seed=1, planned=planned)
    planner = Planner(own, robot, {}, [pool])
    best = planner.optimal(10)
    assert best.bound <= best.value
    # The same criterion of ten of the candidates at random, by the planner's own Jacobians.
    inverse = np.linalg.inv(planner.candidates.information(np.arange(10)))
    columns = np.flatnonzero(planner.candidates.offsets)
    unit = np.mean([(item.prior_std * item.display) ** 2 for item in planner._offsets])
    assert best.value < 0.7 * np.mean(np.diag(inverse)[columns]) * unit


@pytest.mark.long
def test_the_touch_is_on_the_face():
    """Tips of the plan touch within the radius of each face, from outside."""
    own = header_of("plane")
    plan = made(own)
    problem = Problem.from_plan(plan)
    poses = problem.poses(problem.nominal())
    tips = poses[:, :3, :3] @ np.array(TIP["tip_mm"]) + poses[:, :3, 3]
    for tip, pose, name in zip(tips, poses, plan.targets, strict=True):
        face = FACES[name]
        normal, beside = np.array(face["normal"]), tip - np.array(face["guess_mm"])
        assert beside @ normal == pytest.approx(3.0, abs=1e-3)
        assert np.linalg.norm(beside - (beside @ normal) * normal) < 50 + 1e-3
        assert (pose[:3, 3] - tip) @ normal > 0


CUBE = [{"between": ["top", "side"], "deg": 90, "sigma_deg": 0.003}]


@pytest.mark.long
def test_the_right_angles_of_a_cube_count_in_a_plan():
    """By the planner's information the offsets are as uncertain as by the full Jacobian with its ties."""
    robot, loose = load_robot("irb1600", Path(".")), {}
    for name, face in FACES.items():
        loose[name] = {**face, "sigma_mm": 100}
    tied = header_of("plane", targets=loose, angles=CUBE)
    pools = [
        candidates(tied, robot, None, 40, seed=i, planned=Planned("plane", target=name))
        for i, name in enumerate(FACES)
    ]
    rows = np.arange(0, 80, 5)

    def planned(header: Header) -> np.ndarray:
        chosen = Planner(header, robot, {}, pools).candidates
        return np.diag(np.linalg.inv(chosen.information(rows)))[chosen.offsets]

    postures = np.concatenate([pool.postures for pool in pools])[rows]
    measured = [[Measurement(*pools[row // 40].planned, {})] for row in rows]
    problem = Problem.of_measured(tied, robot, postures, measured, planned=True)
    free = problem.parameters.free
    jacobian = problem.at_predicted(problem.nominal()).whiten(problem.nominal()).jacobian[:, free]
    assert len(jacobian) == len(rows) + 1
    variances = np.diag(np.linalg.inv(jacobian.T @ jacobian + np.eye(free.sum())))
    np.testing.assert_allclose(planned(tied), variances[problem.parameters.group("offset")[free]], rtol=1e-6)
    without = planned(header_of("plane", targets=loose))
    assert (without / planned(tied)).max() > 1.1  # the control: the angle says something of the offsets


@pytest.mark.long
def test_a_cube_is_planned():
    plan = made(header_of("plane", angles=CUBE), candidates=60)
    assert set(plan.targets) == set(FACES)
    assert not check_plan(plan).violations


@pytest.mark.long
def test_a_face_with_an_angle_that_the_best_plan_leaves_out_is_named(refused):
    far = {"far": {**FACES["side"], "guess_mm": [850, 0, 250], "sigma_mm": 5000, "sigma_deg": 60}}
    header = header_of("plane", targets=FACES | far, angles=[{**CUBE[0], "between": ["top", "far"]}])
    request = plan_request(header=header, target=None, shots=2, candidates=60)
    assert "leaves out" in str(refused(make_plan, request, None, lambda stage, share: None))


@pytest.mark.long
def test_a_reflector_faces_the_tracker():
    """Candidates for R1 have it within its acceptance; for R2, which is turned by hand, anyhow."""
    own, robot = header_of("tracker"), load_robot("irb1600", Path("."))
    largest = []
    for name in ("R1", "R2"):
        planned = Planned("tracker", name)
        pool = candidates(own, robot, None, 100, seed=1, planned=planned)
        means = [Means(None, name, None)] * len(pool.postures)
        rows = np.degrees(pool.postures)
        problem = Problem.from_plan(Plan.of_postures(own, robot, rows, [None] * len(rows), "p", means=means))
        poses = problem.poses(problem.nominal())
        points = poses[:, :3, :3] @ np.array([50.0, 0, 30]) + poses[:, :3, 3]
        way = np.array(STAND) - points
        cosine = (poses[:, :3, 2] * way).sum(axis=1) / np.linalg.norm(way, axis=1)
        largest.append(float(np.degrees(np.arccos(cosine)).max()))
    assert largest[0] <= 40.001 < 90 < largest[1]


@pytest.mark.long
def test_what_stands_in_the_line_of_sight_is_seen():
    """A box before the tracker leaves no posture; one behind it changes nothing."""
    own, robot = header_of("tracker"), load_robot("irb1600", Path("."))
    wall = Box(name="wall", min_mm=(2400, -3000, -1000), max_mm=(2450, 3000, 4000))
    behind = Box(name="wall", min_mm=(3400, -3000, -1000), max_mm=(3450, 3000, 4000))
    pools = [
        candidates(own, robot, None, 50, obstacles=Obstacles(boxes=[box]), planned=Planned("tracker", "R2"))
        for box in (wall, behind)
    ]
    assert [len(pool.postures) for pool in pools] == [0, 50]
    assert "line of sight" in pools[0].in_words()


def test_the_arm_itself_stands_in_the_line_of_sight():
    """By a second way: points along the line within the radius of a link."""
    own, robot = header_of("tracker"), load_robot("irb1600", Path("."))
    rng = np.random.default_rng(1)
    joints = rng.uniform(-1.5, 1.5, (60, 6))
    planned = Plan.of_postures(
        own, robot, np.degrees(joints), [None] * 60, "p", means=[Means(None, "R2", None)] * 60
    )
    problem = Problem.from_plan(planned)
    clearance = Clearance(problem, Obstacles())
    origins, _ = problem.beams(problem.nominal())
    end = np.array([0.0, 0.0, 300.0])  # in the arm's column: nearly all lines meet the arm
    found = clearance.in_the_way(joints, origins, end, beam=False)
    points, radius = clearance._standing(joints), clearance._radius
    flange = problem.poses(problem.nominal())[:, :3, 3]
    for row, blocked in enumerate(found.blocked):
        along = origins[row] + np.linspace(0, 1, 2000)[:, None] * (end - origins[row])
        further = along[np.linalg.norm(along - origins[row], axis=1) >= 2 * radius]
        spare = []
        for a, b in itertools.pairwise(points[row]):
            if np.linalg.norm(b - a) < 1e-6:
                continue
            carried = [np.linalg.norm(p - flange[row]) < 1e-6 or p is points[row, -1] for p in (a, b)]
            carried[1] |= bool(np.allclose(b, points[row, -1]))
            whole = along if not any(carried) else further
            spare.append(_apart(whole, a, b) - radius)
            if any(carried):
                near = (0.5 if all(carried) else 0.9) * _apart(origins[row][None], a, b)
                spare.append(_apart(along, a, b) - min(radius, near))
        assert blocked == (min(spare) < 0) or abs(min(spare)) < 1
    assert 10 < found.blocked.sum() <= 60


def _apart(points, a, b):
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return float(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1).min())


@pytest.mark.long
def test_seven_psd_measurements_and_four_tracker_points(tmp_path):
    own = header_of("tracker", tool=True)
    file = tmp_path / "mix.yaml"
    request = plan_request(
        header=own,
        target=None,
        shots=None,
        candidates=400,
        measure={"tool": Portion(7), "tracker": Portion(4)},
    )
    answer = make_plan(request, file, lambda stage, share: None)
    plan = read_plan(file)
    labels = [means.instrument for means in plan.means]
    assert (labels.count("tool"), labels.count("tracker")) == (7, 4)
    assert 0.3 < answer.proposal.efficiency <= 1
    # `check` predicts what the planner does, and the mix more than its laser alone.
    checked = {row.name: row.std for row in check(plan).parameters}
    for name, std in answer.proposal.std.items():
        if checked[name] is not None:
            assert checked[name] == pytest.approx(std, rel=0.02)
    laser = made(header_of(tool=True), shots=7, target=None)
    alone = {row.name: row.std for row in check(laser).parameters}
    assert checked["delta2"] < alone["delta2"]


@pytest.mark.long
def test_a_mix_is_the_best_of_so_many_of_each():
    """Of few candidates all choices are compared, by the information of their Jacobians."""
    own, robot = header_of("tracker", tool=True), load_robot("irb1600", Path("."))
    pools = [
        candidates(own, robot, None, 8, seed=1, planned=Planned("tool", "", "psd")),
        candidates(own, robot, None, 6, seed=2, planned=Planned("tracker", "R2")),
    ]
    planner = Planner(own, robot, {}, pools)
    chosen = planner.optimal({"tool": 3, "tracker": 2})
    roots, offsets = planner.candidates.roots, planner.candidates.offsets

    def value(rows):
        whole = np.eye(roots.shape[2]) + np.einsum("cdf,cdg->fg", roots[rows], roots[rows])
        return np.trace(np.linalg.inv(whole)[np.ix_(offsets, offsets)]) / offsets.sum()

    best = min(
        value([*a, *b])
        for a in itertools.combinations(range(8), 3)
        for b in itertools.combinations(range(8, 14), 2)
    )
    unit = chosen.value / planner._design({"tool": 3, "tracker": 2}, "A", 0, 16).value
    assert chosen.value / unit <= best * 1.001
    assert chosen.bound / unit <= best * (1 + 1e-9)


@pytest.mark.parametrize(
    ("kinds", "changes", "what"),
    [
        (("tracker",), {"target": (900.0, 0.0, 0.0)}, "position of a target is stated for a tracker"),
        (("plane",), {"target": (900.0, 0.0, 0.0)}, "position of a target is stated for a plane"),
        (("tracker", "plane"), {}, "it is not said how many measurements each instrument makes"),
        (("tracker", "plane"), {"measure": {"tracker": Portion(4)}}, "it is not said how many"),
        (("plane",), {"measure": {"plane": Portion(4, ("roof",))}}, "cannot be planned to measure roof"),
        (("tracker",), {"measure": {"tracker": Portion(4, ("psd",))}}, "measures no target"),
    ],
)
def test_what_cannot_be_planned_is_said(kinds, changes, what, refused):
    settings = {"target": None, "shots": None, "candidates": 20, **changes}
    request = plan_request(header=header_of(*kinds), **settings)
    assert what in str(refused(make_plan, request, None, lambda stage, share: None))


@pytest.mark.long
def test_targets_that_two_instruments_could_measure_are_named(refused):
    own = header_of("ballbar", tool=True)
    shares = {"tool": Portion(4), "ballbar": Portion(4)}
    request = plan_request(header=own, target=None, shots=None, candidates=40, measure=shares)
    assert "which targets tool measures" in str(refused(make_plan, request, None, lambda stage, share: None))
    shares = {"tool": Portion(4, ("psd",)), "ballbar": Portion(4, ("s1",))}
    plan = made(own, shots=None, candidates=100, measure=shares)
    assert {(means.instrument, target) for means, target in zip(plan.means, plan.targets, strict=True)} == {
        ("tool", "psd"),
        ("ballbar", "s1"),
    }


@pytest.mark.parametrize(
    ("entry", "what"),
    [
        ({"range_mm": [5, 2]}, "range_mm: the readings are out of order"),
        ({"range_mm": [5]}, "range_mm"),
    ],
)
def test_a_range_that_is_none(entry, what, refused):
    bar = {"kind": "ballbar", **TIP, **entry}
    content = {"robot": "irb1600", "noise": {"joint_deg": 0.005}, "instruments": {"bar": bar}}
    with pytest.raises(ValueError, match=what):
        Header.model_validate(content)


def test_a_stand_is_guessed_of_a_free_frame_alone():
    known = {**TRACKER, "frame": {"xyz_mm": [0, 0, 0], "quat": [1, 0, 0, 0]}}
    with pytest.raises(ValueError, match="guess_mm is stated of an instrument whose frame is known"):
        Header.model_validate(
            {"robot": "irb1600", "noise": {"joint_deg": 0.005}, "instruments": {"leica": known}}
        )
