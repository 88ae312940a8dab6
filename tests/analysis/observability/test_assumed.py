"""What only an assumption makes identifiable is `assumed`: never identified, never entered unasked."""

import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, PROBE, good_plan, header, irb1600, pattern_plan, run_of, simulated, simulated_problem
from measured_arms import CELLS, KNOWN_FRAME, STATED_FRAME, Cell, recorded

from zerobeam.analysis.diagnostics.values_to_enter import entered, offsets_to_enter
from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.analysis.observability.causes import AsGoodAs
from zerobeam.analysis.observability.check import Check
from zerobeam.analysis.observability.geometry_result import bases
from zerobeam.analysis.observability.identifiability import Identified, identify
from zerobeam.analysis.solution import Solution, solve
from zerobeam.analysis.status import has_numbers, known, verdict_of
from zerobeam.experiments.makers.calibration import calibration
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import Run
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import reason, remedy
from zerobeam.words.trust import trusted

# An ordinary arm (J2 0.62, J3 -0.35, J4 0.21, J5 -0.48, J6 0.15 deg) whose laser is 1 deg off about axis 6.
BEAM_1_DEG = """
-93.511,-20.819,52.475,113.209,18.540,-71.615
-99.839,-62.164,-115.380,6.359,-55.420,137.275
-5.824,106.378,-194.624,-48.325,-87.631,-193.481
98.562,-51.611,-24.397,-135.899,83.653,35.866
-13.848,-19.992,-144.734,-162.328,-112.043,-165.144
-20.525,-3.731,-63.169,53.757,57.238,-22.120
-6.649,69.723,-38.957,94.675,65.967,-67.876
154.883,-62.800,-166.349,-16.714,37.075,-112.496
158.216,89.777,-189.743,188.655,25.674,3.604
"""
CLOSE, EXACT = (
    {**LASER, "sigma": {"tilt_deg": deg, "shift_mm": mm}} for deg, mm in ((0.005, 0.02), (1e-6, 1e-4))
)
STATED = {**LASER, "sigma": {"tilt_deg": 0.05, "shift_mm": 0.1}}


def beam_run(tool: dict[str, Any] = LASER) -> Run:
    rows = [tuple(map(float, line.split(","))) for line in BEAM_1_DEG.split()]
    shots = [Shot(shot=i, target="psd", joints_deg=row) for i, row in enumerate(rows)]
    return run_of(header(tool, target=None, geometry=None, limits="warn"), shots)


@cache
def beam_solution(stated: bool = False) -> Solution:
    return solve(Problem.from_run(beam_run(STATED if stated else LASER)))


def test_a_turned_laser_passes_without_joint_6() -> None:
    """It came out as identified, 1.15 deg +- 0.10 deg, where 0.15 deg is true."""
    solution = beam_solution()
    row = solution["delta6"]
    assert (solution.verdict, row.status) == ("pass", "assumed")
    assert [solution[f"delta{i}"].status for i in range(2, 6)] == ["identified"] * 4
    assert row.estimate is not None
    assert row.estimate > 1
    assert row.std is not None
    assert row.std < 0.1
    assert isinstance(row.cause, AsGoodAs)
    assert not row.cause.by_header
    assert reason(row.cause) == "as good as the laser's mounting: 0.05° is assumed, not stated or measured"
    assert remedy(row.cause) == "measure the laser's mounting and state tool.sigma.tilt_deg"
    first, second, _ = entered(solution)
    assert first is not None
    assert set(first.values) == {"delta2", "delta3", "delta4", "delta5"}
    assert second is not None
    assert "delta6" not in second.values
    assert "delta6" in offsets_to_enter(solution, assumed=True)


def test_what_better_knowledge_would_leave_weak_is_said_and_no_remedy_alone() -> None:
    """In the Y-Pattern joint 6 is weak however well the mounting is known: as with one that is."""
    plans = [pattern_plan("y", geometry=None, tool=tool) for tool in (LASER, CLOSE, EXACT)]
    rows = [Check.of(aim_plan(plan)).parameters.named("delta6") for plan in plans]
    assumed, close, exact = rows
    assert isinstance(assumed.cause, AsGoodAs)
    assert assumed.cause.weak
    assert assumed.status == "assumed"
    assert (close.status, exact.status) == ("weak", "weak")
    assert exact.data_std == pytest.approx(assumed.data_std, rel=0.1)
    assert remedy(assumed.cause) == "plan other postures; measure and state tool.sigma.tilt_deg"
    assert reason(assumed.cause).endswith("; weakly observable however well that is known")
    k, tolerances = 2.0, {"deg": 0.1}
    assert trusted(assumed, k, tolerances) == "no: weak, mounting assumed 0.05°"
    cause = beam_solution()["delta6"].cause
    assert isinstance(cause, AsGoodAs)
    assert not cause.weak


def test_a_stated_mounting_identifies_it() -> None:
    """Negative control: the same numbers, stated in the header."""
    row = beam_solution(stated=True)["delta6"]
    assert row.status == "identified"
    assert isinstance(row.cause, AsGoodAs)
    assert row.cause.by_header
    assert reason(row.cause) == "by the stated mounting of the laser: 0.05°"


def test_exports_leave_it_out_unless_asked() -> None:
    run = beam_run()
    left_out = calibration(run).offsets[5]
    assert (left_out.exported, left_out.applied, left_out.applied_u) == (False, 0.0, None)
    assert "ASSUMED (as good as the laser's mounting: 0.05 deg is assumed" in left_out.sentence
    assert "not applied" in left_out.sentence
    asked = calibration(run, allow_assumed=True).offsets[5]
    assert asked.exported
    assert asked.applied > 1
    assert "ASSUMED" in asked.sentence


def test_each_number_of_an_export_has_its_own_uncertainty() -> None:
    """u of the value to enter is up to ten times that of the estimate."""
    made = calibration(beam_run())
    fifth = made.offsets[4]
    assert fifth.applied_u is not None
    assert fifth.row.std is not None
    assert fifth.applied_u > 5 * fifth.row.std
    assert f"to enter: {fifth.applied:+.6f} deg, u {fifth.applied_u:.2g} deg" in fifth.sentence
    assert f"deg, u {fifth.row.std:.2g} deg, identified" in fifth.sentence
    # Its own u says how well it is known, whatever the offset is.
    assert (fifth.status, fifth.applied_status) == ("identified", "weak")
    assert fifth.sentence.endswith("deg, WEAK: weakly observable")
    assert any("delta5 is only weakly observable" in text for text in made.warnings)


# Every instrument


def judged(kind: str, geometry: str | None = "exact", held: list[str] | None = None, **changes: Any) -> Any:
    """The judgement of 24 measurements by an instrument of the kind, whose entries have these changes."""
    cell = CELLS[kind]
    arm = recorded(cell, 24, np.random.default_rng(3), exact=True, joint_deg=0.002)
    entries, tool = copy.deepcopy(cell.instruments), copy.deepcopy(cell.tool)
    for entry in [*entries.values(), *([] if tool is None else [tool])]:
        entry.update(changes)
    own = Cell(entries, cell.targets, cell.turns, tool).header(geometry=geometry, joint_deg=0.002)
    if held is not None:
        content = own.model_dump(mode="json", by_alias=True, exclude_unset=True)
        own = Header.model_validate({**content, "held": held})
    problem = Problem.of_measured(own, irb1600(), arm.joints, arm.measured)
    answer: Identified = identify(problem, problem.nominal())
    return dict(zip(problem.parameters.names, answer.status, strict=True)), answer.rests_on


TIPS = ["plane", "sphere", "ballbar", "dial"]


@pytest.mark.parametrize("geometry", ["exact", None])
@pytest.mark.parametrize(
    ("kind", "stated"),
    [
        ("laser", {"sigma": {"tilt_deg": 0.02, "shift_mm": 0.05}}),
        ("probe", {"sigma": {"shift_mm": 0.05}}),
        *((kind, {"tip_sigma_mm": 0.05}) for kind in TIPS),
    ],
)
@pytest.mark.at_length(r"(plane|ballbar|dial|probe|None-sphere|sphere-.*-None)")
def test_what_only_the_default_of_a_tool_identifies(
    kind: str, stated: dict[str, Any], geometry: str | None
) -> None:
    status, rests_on = judged(kind, geometry)
    assert status["delta6"] == "assumed"
    assert {name for name, each in status.items() if each == "assumed"} == {"delta6"} == set(rests_on)
    assert not any(one.stated for one in rests_on["delta6"])
    status, rests_on = judged(kind, geometry, **stated)
    assert known(status["delta6"])
    assert all(one.stated for one in rests_on["delta6"])


def test_a_weak_last_offset_is_assumed_by_plan_and_run_alike() -> None:
    """A deviating arm breaks the gauge of joint 6 and the dial's tip a little: 0.7° by the tip, 51° without.
    It was assumed in the plan, which passed, and weak in its run."""
    arm = recorded(CELLS["dial"], 24, np.random.default_rng(3), exact=False, joint_deg=0.01)
    own = CELLS["dial"].header(geometry=None, joint_deg=0.01)
    problem = Problem.of_measured(own, irb1600(), arm.joints, arm.measured)
    for x in (problem.nominal(), solve(problem).fit.x):
        answer = identify(problem, x)
        assert answer.status[problem.parameters.index("delta6")] == "assumed"
        assert answer.still_weak == {"delta6"}
        # Negative control: the others are known by the measurements, whatever the tip is.
        assert (set(answer.rests_on), set(answer.weak_on)) == ({"delta6"}, set())


def test_what_only_a_known_frame_identifies() -> None:
    """Nobody states how well the frame of a tracker is known. Its reflectors are stated, to 0.05 mm."""
    status, rests_on = judged("tracker, frame known")
    assert (status["delta1"], status["delta6"]) == ("assumed", "identified")
    cause = AsGoodAs(rests_on["delta1"])
    assert reason(cause) == (
        "as good as the frame of leica: that it is exactly as stated is assumed, not measured"
    )
    assert remedy(cause) == (
        "measure the frame of leica and state instruments.leica.frame.sigma_deg and"
        " instruments.leica.frame.sigma_mm, or state it as free and hold the first offset"
    )
    assert reason(AsGoodAs(rests_on["delta6"])).startswith("by the stated R1 of leica")


@pytest.mark.parametrize("kind", ["tracker", "pose"])
def test_a_frame_whose_sigma_is_stated(kind: str) -> None:
    """δ1 is known as well as the frame's orientation, and by nothing better."""
    status, rests_on = judged(kind, frame=STATED_FRAME)
    assert status["delta1"] == "identified"
    label = CELLS[kind].instruments.copy().popitem()[0]
    assert reason(AsGoodAs(rests_on["delta1"])) == f"by the stated frame of {label}: 0.02° and 0.3\u00a0mm"


def test_how_well_a_frame_is_known_is_said_whole() -> None:
    with pytest.raises(ValueError, match="sigma_deg is missing"):
        judged("tracker", frame={**KNOWN_FRAME, "sigma_mm": 0.3})


def test_what_is_stated_in_part() -> None:
    """A stated tilt of a laser is what joint 6 rests on, whatever its shift is assumed to be."""
    status, rests_on = judged("laser", None, sigma={"tilt_deg": 0.02})
    assert status["delta6"] == "identified"
    assert [one.std for one in rests_on["delta6"]] == [pytest.approx(0.02)]
    status, _ = judged("laser", None, sigma={"shift_mm": 0.02})
    assert status["delta6"] == "assumed"


def test_what_is_free_rests_on_nothing() -> None:
    for kind in ("tracker", "pose"):
        status, rests_on = judged(kind)
        assert "assumed" not in status.values()
        assert not rests_on
        status, _ = judged(kind, held=["delta1"])
        assert status["delta6"] == "unidentifiable"


def test_a_pose_with_a_known_frame() -> None:
    status, _ = judged("pose", frame=KNOWN_FRAME)
    assert status["delta1"] == "assumed"


# Statuses


def test_it_has_numbers_and_is_no_part_of_a_verdict() -> None:
    assert has_numbers("assumed")
    assert not known("assumed")
    assert verdict_of(["held", "identified", "assumed"]) == "pass"
    assert verdict_of(["weak", "assumed"]) == "weak"
    assert verdict_of(["held", "assumed"]) == "weak"  # there is nothing that a pass could be of
    assert verdict_of(["assumed", "unidentifiable"]) == "degenerate"


def test_nothing_is_exported_of_assumptions_alone(tmp_path: Path) -> None:
    plan = good_plan(8, geometry="exact", held=[f"delta{i}" for i in range(1, 6)])
    _, run = simulated(plan)
    with pytest.raises(BadInput, match="as good as what is assumed"):
        calibration(run)


# Page one


def test_each_assumption_says_what_it_does() -> None:
    solution = beam_solution()
    own = beam_run().header
    rows = bases(solution.problem, solution.fit.covariance, solution.status, own)
    mounting, links = rows
    assert (mounting.of, mounting.part, mounting.stated, links.part, links.stated) == (
        "tool",
        "mounting",
        False,
        "links",
        False,
    )
    assert [(size.std, size.unit) for size in mounting.sizes] == [
        (pytest.approx(0.05), "deg"),
        (pytest.approx(0.1), "mm"),
    ]
    assert mounting.offset == "delta6"
    assert mounting.u is not None
    assert mounting.u_if_exact is not None
    # By a second fit, of a tool that is as good as exact.
    sure = {**LASER, "sigma": {"tilt_deg": 1e-6, "shift_mm": 1e-6}}
    exact = solve(Problem.from_run(beam_run(sure)))["delta6"].std
    assert mounting.u_if_exact == pytest.approx(exact, rel=0.02)
    assert mounting.u > 3 * mounting.u_if_exact


# By simulation


def misjudged(arms: range, off_deg: float) -> tuple[int, int]:
    """How many of the arms pass, and how many of these with joint 6 as known, with a laser so far off about
    axis 6."""
    passed = wrong = 0
    for seed in arms:
        plan = good_plan(20 + seed % 5, seed=seed, geometry=None)
        rng = np.random.default_rng(seed)
        offsets = {
            f"delta{i}": float(value) for i, value in zip(range(2, 7), rng.normal(size=5) * 0.5, strict=True)
        }
        _, problem = simulated_problem(plan, {**offsets, "tool.tilt1": off_deg}, seed)
        solution = solve(problem, starts=0)
        passed += solution.verdict == "pass"
        wrong += solution.verdict == "pass" and known(solution["delta6"].status)
    return passed, wrong


@pytest.mark.parametrize("off_deg", [0.3, 1.0])
def test_no_pass_has_the_joint_that_the_laser_turns_with(off_deg: float) -> None:
    passed, wrong = misjudged(range(3), off_deg)
    assert passed > 0
    assert wrong == 0


@pytest.mark.long
@pytest.mark.parametrize("off_deg", [0.3, 1.0])
def test_no_pass_of_two_hundred_has_it(off_deg: float) -> None:
    passed, wrong = misjudged(range(100), off_deg)
    assert passed > 50
    assert wrong == 0


def test_a_probe_is_judged_likewise() -> None:
    """Its last offset is weak by what is assumed of the tip alone. Joint 2 is weak whatever the tip is."""
    _, problem = simulated_problem(good_plan(10, tool=PROBE, geometry=None))
    solution = solve(problem, starts=0)
    assert (solution["delta2"].status, solution["delta6"].status) == ("weak", "assumed")
    assert solution.verdict == "weak"
