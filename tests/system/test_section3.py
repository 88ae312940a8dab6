"""Section 3 of the paper with its numbers: patterns, joint 1, a laser that was not calibrated, eq. 12-16."""

import functools
import itertools
import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cells import OPEN_LASER, good_plan, header, irb1600, pattern_plan, plan_of
from scripts import BENCHMARKS, load_script
from study_text import words

from zerobeam.analysis.observability.aim import aim
from zerobeam.analysis.observability.check import Check, CheckedParameter, check
from zerobeam.experiments.plans.patterns import Line, pattern
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.cell import paper_plan
from zerobeam.experiments.studies.data_sets import laser_header
from zerobeam.experiments.studies.sweeps.grid_answer import GridCase
from zerobeam.experiments.studies.sweeps.study_file import SettingsStudy, built_in_study, read_study
from zerobeam.experiments.studies.sweeps.sweep import _planned, judged, studied_case, sweep
from zerobeam.experiments.studies.table2 import EXPERIMENTS, OFFSETS, Prediction, scatter, unevenness
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.studies.sweep_figures import axes_picture
from zerobeam.words import numbers
from zerobeam.words.observability import direction_remedy, reason

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
JITTER_DEG = 0.01
AXIS_2_MM = 486.5  # height of joint 2's axis: d1 of Table 1


def named(answer: Check, name: str) -> CheckedParameter:
    return next(row for row in answer.parameters if row.name == name)


def offsets(answer: Check) -> dict[str, CheckedParameter]:
    return {row.name: row for row in answer.parameters if row.group == "offset" and not row.held}


# --- 3.2: X-Pattern and Y-Pattern -----------------------------------------------------------------------


def test_x_pattern_with_the_psd_straight_ahead() -> None:
    answer = check(pattern_plan("x"))
    delta2 = named(answer, "delta2")
    assert (delta2.status, delta2.data_std, delta2.std) == ("unidentifiable", None, None)
    assert delta2.cause is not None
    assert reason(delta2.cause).startswith("joint 1 does not change over the measurements")
    (null,) = [
        d for d in answer.identifiability.null_space if "delta2" in d.combination and d.kind == "exact"
    ]
    assert direction_remedy(null) == (
        "vary joint 1 by 90° (rotated by −45°, 45° and 0° in turn, and aimed anew); predicted U: delta2 not"
        " determined → 0.27° (still weakly observable); then plan more measurements"
    )
    # The others are told, if poorly.
    for name in ("delta3", "delta4", "delta5", "delta6"):
        assert named(answer, name).data_std == pytest.approx(0.1, abs=0.25)


def jittered(plan: Plan, seed: int) -> Plan:
    rng = np.random.default_rng(seed)
    postures = plan.postures.copy()
    postures[:, 0] += np.radians(JITTER_DEG) * rng.normal(size=len(postures))
    return plan_of(plan.header, postures)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.one_in(4)
def test_a_jitter_of_joint_1_is_no_information(seed: int) -> None:
    """What varies by its noise alone is at rest: the gauge of the paper, exactly."""
    answer = check(jittered(pattern_plan("x"), seed))
    delta2 = named(answer, "delta2")
    assert (delta2.status, delta2.data_std, delta2.std) == ("unidentifiable", None, None)
    (null,) = [d for d in answer.identifiability.null_space if d.combination.get("delta2") == 1.0]
    assert null.kind == "exact"
    assert "joint 1 varies by only" in reason(null.cause)


def straight_ahead(height: float, jitter_deg: float, seed: int = 1) -> Plan:
    """Seven postures in the plane of y = 0 that hit a PSD at (900, 0, height) mm; joint 1 is jittered by far
    more than its noise."""
    rng = np.random.default_rng(seed)
    shots = 7
    postures = np.radians(
        [[0.0, lift, elbow, 0.0, -60.0, 0.0] for lift, elbow in zip(
            np.linspace(-25, 15, shots), np.linspace(-30, 5, shots) + rng.normal(size=shots), strict=True
        )]
    )  # fmt: skip
    own = header(target=(900.0, 0.0, height), joint_deg=JITTER_DEG / 10)
    problem = Problem.from_plan(plan_of(own, postures))
    only_wrist = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    aimed = aim(problem, problem.nominal(), only_wrist)
    assert aimed.hit.all()
    postures = aimed.problem.joints.copy()
    postures[:, 0] += np.radians(jitter_deg) * np.array([1, -1, 0.5, 0.2, -0.7, 0.9, -0.4])
    return plan_of(own, postures)


def test_how_much_a_jitter_tells_depends_on_the_height_of_the_psd() -> None:
    """Joint 1 turned by e moves what a turn about joint 2 does to the target by e times the target's height
    over the axis of joint 2: data_std goes with one over both."""

    def std(height: float, jitter_deg: float) -> float:
        delta2 = named(check(straight_ahead(height, jitter_deg)), "delta2")
        assert delta2.status == "unidentifiable"
        assert delta2.data_std is not None
        return delta2.data_std

    at_the_floor = std(0.0, JITTER_DEG)
    near = {height: std(height, JITTER_DEG) for height in (400.0, 450.0, 480.0)}
    products = [value * (AXIS_2_MM - height) for height, value in near.items()]
    np.testing.assert_allclose(products, products[0], rtol=0.1)
    assert near[480.0] > 1000 > 300 > at_the_floor
    # Twice the jitter, half the std.
    assert std(0.0, 2 * JITTER_DEG) == pytest.approx(at_the_floor / 2, rel=0.05)


def test_x_pattern_with_the_psd_aside() -> None:
    """Joint 1 changes by a degree or two: a number, but no knowledge."""
    for aside in (200.0, 600.0):
        plan = pattern_plan("x", aside)
        assert 0.5 < np.degrees(np.ptp(plan.postures[:, 0])) < 3
        delta2 = named(check(plan), "delta2")
        assert (delta2.status, delta2.std) == ("unidentifiable", None)
        assert delta2.data_std is not None
        assert 5 < delta2.data_std < 20


def test_y_pattern() -> None:
    """Free from the issue, as the paper says: every offset is told, delta2 to about a degree."""
    plan = pattern_plan("y")
    assert np.degrees(np.ptp(plan.postures[:, 0])) > 80
    answer = check(plan)
    assert answer.verdict == "weak"
    assert {row.status for row in offsets(answer).values()} <= {"identified", "weak", "assumed"}
    told, by_x = (
        named(answer, "delta2").data_std,
        named(check(jittered(pattern_plan("x", joint_deg=JITTER_DEG / 10), 0)), "delta2").data_std,
    )
    assert told is not None
    assert by_x is not None
    assert told < 2 < by_x / 10


@pytest.mark.parametrize(("which", "aside_m"), [("x", 0.4), ("y", 0.0)])
def test_the_table_of_docs_paper(which: str, aside_m: float) -> None:
    made = load_script(BENCHMARKS, "pattern_table").row(which, aside_m)
    assert made in PAGE


def test_the_table_of_docs_paper_is_whole() -> None:
    rows = re.findall(r"^\| ([XY]) \| (0\.\d) \|", PAGE, flags=re.MULTILINE)
    script = load_script(BENCHMARKS, "pattern_table")
    assert rows == [(w.upper(), f"{a:.1f}") for w in script.PATTERNS for a in script.ASIDE_M]


# --- Table 2 and the Y-Patterns ---------------------------------------------------------------------------


BESIDE = (
    "usual Y-Pattern",
    "usual, a 13th of the noise",
    "usual, with tolerances",
    "best Y-Pattern",
    "best, with tolerances",
    "X-Pattern",
    "optimal",
    "optimal, PSD at 800 mm",
    "optimal, with tolerances",
)


@functools.cache
def patterns_study() -> SettingsStudy:
    return read_study(built_in_study("patterns"))


def test_every_case_beside_is_on_the_page() -> None:
    assert tuple(case.words for case in patterns_study().beside) == BESIDE


def row_of(case: GridCase) -> str:
    """The row of docs/paper.md of a case beside the grid."""
    cells = [
        "not determined" if one.std is None else numbers.spread(one.std)
        for one in case.parameters
        if one.group == "offset"
    ]
    return f"| {case.words} | {' | '.join(cells)} |"


@pytest.mark.parametrize("name", BESIDE)
@pytest.mark.at_length(r"^(usual, with|best, with|optimal)")
def test_the_plans_beside_the_y_patterns_of_docs_paper(name: str) -> None:
    (case,) = (case for case in patterns_study().beside if case.words == name)
    assert row_of(studied_case(case, 0)) in PAGE


def test_the_scatter_of_table_2_of_docs_paper() -> None:
    cells = " | ".join(numbers.spread(std) for std in EXPERIMENTS.std(axis=0, ddof=1))
    assert f"| *scatter of Table 2* | {cells} |" in PAGE


def test_one_noise_does_not_explain_table_2() -> None:
    """The p-value that docs/paper.md quotes; the studies' seed is another."""
    truth = dict(zip(OFFSETS, EXPERIMENTS.mean(axis=0).tolist(), strict=True))
    prediction = Prediction(paper_plan(laser_header(0.01, 0.001)), truth)
    covariance = prediction.covariance(0.01)
    normal = np.random.default_rng(0).normal(size=(9999, *EXPERIMENTS.shape))
    simulated = scatter(normal @ np.linalg.cholesky(covariance).T)
    observed = unevenness(covariance, scatter(EXPERIMENTS)[None], 2)[0]
    p_value = (1 + (unevenness(covariance, simulated, 2) >= observed).sum()) / (1 + len(normal))
    assert "(p = 0.006 by `zerobeam study table2`)" in PAGE
    assert p_value == pytest.approx(0.006, abs=0.002)


def test_what_repeats_does_not_scatter() -> None:
    """Errors of 0.01° that belong to the postures: three runs of the same postures agree as in Table 2, and
    all three are wrong by far more; of runs without such errors the scatter is the error."""
    (case,) = (case for case in patterns_study().beside if case.words == "usual Y-Pattern")
    problem = _planned(case, 0)
    x, free = problem.nominal(), problem.parameters.free
    whitened = problem.whiten(x)
    gain = np.linalg.pinv(whitened.jacobian[:, free])
    delta2 = np.flatnonzero(free).tolist().index(problem.parameters.index("delta2"))
    scale = problem.parameters.prior_std[free][delta2]

    def estimate(error: Matrix) -> float:
        """Of delta2, deg: what joints read with this error (shots, n) deg shift it by, to first order."""
        residual = problem.moved(problem.joints + np.radians(error)).whiten(x).residual
        return float(np.degrees(scale * (gain @ -(residual - whitened.residual))[delta2]))

    rng = np.random.default_rng(2)
    shape, sets = problem.joints.shape, 200
    repeats, errors, fresh = [], [], []
    for _ in range(sets):
        of_posture = 0.01 * rng.normal(size=shape)
        runs = [estimate(of_posture + 0.01 / 13 * rng.normal(size=shape)) for _ in range(3)]
        repeats.append(np.var(runs, ddof=1))
        errors.append(np.mean(runs) ** 2)
        fresh.append(estimate(0.01 * rng.normal(size=shape)) ** 2)
    scattered, wrong, other = (float(np.sqrt(np.mean(squares))) for squares in (repeats, errors, fresh))
    assert scattered == pytest.approx(wrong / 13, rel=0.2)
    assert wrong == pytest.approx(other, rel=0.2)
    assert 0.05 < scattered < 0.1
    assert wrong > 0.7


@pytest.mark.long
def test_the_y_patterns_of_docs_paper() -> None:
    """The whole study: what docs/paper.md says of it, within bounds and by its printed numbers."""
    study = sweep(patterns_study(), Engine(0, processes=2))
    rows = {row.name: row for row in study.over_cases()}
    for i, row in enumerate(rows.values(), start=2):
        figures = [numbers.spread(std, "deg") for std in (row.least, row.median, row.largest) if std]
        assert f"| δ{i} | {' | '.join(figures)} | in {row.without} of {row.cases} |" in PAGE
    delta2 = rows["delta2"]
    assert delta2.least is not None
    assert delta2.median is not None
    assert 0.03 < delta2.least < 0.08 < 0.5 < delta2.median < 1.5
    (usual,) = (case for case in study.beside if case.words == "usual Y-Pattern")
    assert usual.worst_std is not None
    assert 11 < usual.worst_std / EXPERIMENTS.std(axis=0, ddof=1)[0] < 15
    low = [one for one in study.parameters if one.name == "delta2" and (one.std or 9) <= 0.0804]
    assert f"{len(low)} in {delta2.cases} have a u(δ2) of 0.08° or less" in PAGE
    (on_the_floor,) = (row for row in study.over_cases(0, 0) if row.name == "delta2")
    assert on_the_floor.least is not None
    assert on_the_floor.least > 0.2
    best = min(study.cases, key=lambda case: case.worst_std or 9)
    (named,) = (case for case in study.beside if case.words == "best Y-Pattern")
    assert named.worst_std == pytest.approx(best.worst_std, rel=1e-9)
    picture = axes_picture(study)
    assert picture is not None
    assert words(picture.svg) == words((ROOT / "docs" / "pictures" / "patterns.svg").read_text("utf-8"))


@pytest.mark.long
def test_the_best_y_pattern_scatters_as_predicted() -> None:
    """300 simulated runs, each of an arm and a place of the PSD of its own: δ2 scatters as predicted, and all
    offsets as their own fits state (4 standard errors of 300 runs are 16 %)."""
    (case,) = (case for case in patterns_study().beside if case.words == "best Y-Pattern")
    settings = case.settings.model_copy(update={"runs": 300})
    (studied,) = judged([studied_case(replace(case, settings=settings), 0)])
    errors = {one.name: one.likelihood for one in studied.parameters}
    assert errors["delta2"] is not None
    assert errors["delta2"].agrees
    for one in errors.values():
        assert one is not None
        assert one.rms_in_stds == pytest.approx(1, abs=0.16)


@pytest.mark.long
@pytest.mark.parametrize("height", [0.0, 800.0])
def test_no_x_pattern_has_a_number_for_delta2(height: float) -> None:
    """With the PSD straight ahead, wherever its line lies, as long as joint 1 stays where it is."""
    target = np.array([900.0, 0.0, height])
    found = 0
    for distance, over, width in itertools.product((600.0, 900.0, 1100.0), (500.0, 800.0), (300.0, 600.0)):
        own = header(target=target)
        try:
            postures = pattern(own, irb1600(), target, "x", line=Line(distance, over, width))
        except BadInput:
            continue
        if np.ptp(postures[:, 0]) > 1e-6:
            continue  # found beside the plane of the line and the target, or over the shoulder
        delta2 = named(check(plan_of(own, postures)), "delta2")
        assert (delta2.status, delta2.std) == ("unidentifiable", None)
        found += 1
    assert found >= 3


# --- 3.3 and 3.1 ------------------------------------------------------------------------------------------


def test_delta1_is_the_base_frame() -> None:
    held, freed = check(good_plan()), check(good_plan(held=[]))
    assert (named(freed, "delta1").status, named(freed, "delta1").data_std) == ("unidentifiable", None)
    (null,) = freed.identifiability.null_space
    assert null.kind == "exact"
    assert "base frame" in reason(null.cause)
    # Freeing it takes nothing from the others, and holding it gives them nothing.
    for name, row in offsets(held).items():
        assert named(freed, name).data_std == pytest.approx(row.data_std, rel=1e-6)


def test_an_uncalibrated_laser_with_delta6_held() -> None:
    answer = check(good_plan(12, 5, OPEN_LASER))
    assert answer.verdict == "pass"
    assert (named(answer, "delta6").status, named(answer, "delta6").data_std) == ("held", None)
    assert named(answer, "tool.tilt1").status == "identified"


def test_an_uncalibrated_laser_with_delta6_freed() -> None:
    """ "The identified offset of joint 6 is meaningless": it and the tool turn together."""
    answer = check(good_plan(12, 5, OPEN_LASER, held=["delta1"]))
    assert (named(answer, "delta6").status, named(answer, "delta6").data_std) == ("unidentifiable", None)
    (null,) = answer.identifiability.null_space
    assert null.kind == "exact"
    assert "last joint is equivalent to one of the uncalibrated tool" in reason(null.cause)
    # The turn by delta6 is undone by the tool's own parameters alone.
    assert set(null.combination) <= {"delta6", "tool.tilt1", "tool.tilt2", "tool.shift1", "tool.shift2"}
    for name in ("delta2", "delta3", "delta4", "delta5"):
        assert named(answer, name).status == "identified"


# --- eq. 12-16 --------------------------------------------------------------------------------------------


def position(theta: Matrix, point: Matrix) -> Matrix:
    """A point (3,) mm in the frame of joint 2 (eq. 13), in the base frame at theta (2,), by Table 1."""
    arm = irb1600()
    # Up to the frame of joint 2 in the sense of eq. 1: with the link that the file puts before joint 3.
    upper = Robot("upper arm", arm.joints[:2], arm.joints[2].fixed)
    angles = ca.SX.sym("theta", 2)
    pose = ca.Function("pose", [angles], list(upper.flange_pose(angles)))
    rotation, translation = (np.array(value) for value in pose(theta))
    return np.asarray(rotation @ point + translation[:, 0])


def test_eq_12_is_one_point_for_all_shots() -> None:
    """The spot, as far before each laser as the target, is the same point in the base frame."""
    plan = good_plan()
    problem = Problem.from_plan(plan)
    x = problem.nominal()
    origin, direction = problem.beams(x)
    targets = problem.split(x).targets
    along = ((targets[0] - origin) * direction).sum(axis=1)
    spots = origin + along[:, None] * direction
    np.testing.assert_allclose(spots, np.tile(targets[0], (len(spots), 1)), atol=1e-6)


def test_eq_14_as_docs_paper_corrects_it() -> None:
    rng = np.random.default_rng(14)
    for _ in range(5):
        angles, (x, y, z) = rng.uniform(-1.5, 1.5, 2), rng.uniform(-500, 500, 3)
        found = position(angles, np.array([x, y, z]))
        (c1, c2), (s1, s2) = np.cos(angles), np.sin(angles)
        corrected = [
            x * c1 * s2 + y * c1 * c2 - z * s1 + 700 * c1 * s2 + 150 * c1,
            x * s1 * s2 + y * s1 * c2 + z * c1 + 700 * s1 * s2 + 150 * s1,
            x * c2 - y * s2 + 700 * c2 + 486.5,
        ]
        np.testing.assert_allclose(found, corrected, atol=1e-9)
        printed_y = -x * s1 * c2 + y * s1 * c2 + z * c1 + 700 * s1 * s2 + 150 * s1
        printed_z = x * c2 - y * s2 + 700 * c2 + 150 * s1
        assert abs(found[1] - printed_y) > 1e-3
        assert abs(found[2] - printed_z) > 1e-3


def test_eq_15_and_16_as_docs_paper_corrects_them() -> None:
    """For theta1 = 0 and p_y = 0: the distance from the axis of joint 2 does not depend on theta2."""
    rng = np.random.default_rng(16)
    for _ in range(5):
        x, y = rng.uniform(-500, 500, 2)
        theta2, turned = rng.uniform(-1.5, 1.5, 2)
        found = position(np.array([0.0, theta2]), np.array([x, y, 0.0]))
        c2, s2 = np.cos(theta2), np.sin(theta2)
        eq15 = [x * s2 + y * c2 + 700 * s2, 0.0, x * c2 - y * s2 + 700 * c2]
        np.testing.assert_allclose(found, np.add(eq15, [150.0, 0.0, 486.5]), atol=1e-9)
        eq16 = x**2 + 1400 * x + y**2 + 700**2
        for place in (found, position(np.array([0.0, turned]), np.array([x, y, 0.0]))):
            assert (place[0] - 150) ** 2 + (place[2] - 486.5) ** 2 == pytest.approx(eq16)
        # As printed, about the base's origin, it is not true.
        assert abs(float(found @ found) - eq16) > 1.0
