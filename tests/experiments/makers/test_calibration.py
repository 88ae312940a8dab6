"""What of a run is exported: what `analyse` calls identified, and nothing else unasked."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import (
    LASER,
    OPEN_LASER,
    OPEN_PROBE,
    good_plan,
    header,
    pattern_plan,
    plan_of,
    run_of,
    simulated,
    varied_postures,
)
from export_runs import STATED, TRUTH, arm_run, hostile
from messages_so_far import message_so_far

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.estimation.fit import LikelihoodFit, Optimum, fit_likelihood
from zerobeam.analysis.posterior.posterior import PosteriorSummary
from zerobeam.analysis.solution import solve
from zerobeam.experiments.demos import demo_runs
from zerobeam.experiments.makers.calibration import NO_ROBOT, calibration
from zerobeam.experiments.makers.maker import one_line
from zerobeam.model.errors import BadInput, FitFailed
from zerobeam.model.files.header import Header, header_content
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.message import message

Refused = Callable[..., BadInput]


def x_pattern() -> Run:
    """δ2 is a gauge there, others are weak."""
    return simulated(pattern_plan("x"), TRUTH, 2)[1]


RUNS: dict[str, Callable[[], Run]] = {
    "good": lambda: simulated(good_plan(10), TRUTH, 2)[1],
    "estimated scale": lambda: simulated(good_plan(8, noise={"scale": "estimated"}), TRUTH, 2)[1],
    "open laser": lambda: simulated(good_plan(16, tool=OPEN_LASER), {}, 2)[1],
    "x-pattern": x_pattern,
    # The Jacobian promises 0.07 degrees of delta5 there, the mode's curvature 0.09: it is weak.
    "x-pattern, 0.08": lambda: simulated(pattern_plan("x", tolerance={"offset_deg": 0.08}), TRUTH, 2)[1],
}


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.one_in(5)
def test_offsets_are_those_of_analyse(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to rounding, which is another in Python's climb than in C's; without the sampling."""
    run = RUNS[name]()
    told = calibration(run, allow_weak=True, without=["delta2"] if "x-pattern" in name else [])
    unsampled = PosteriorSummary(False, "not asked for", 0, 0, 0, None, None, None, 0.0, None)
    monkeypatch.setattr("zerobeam.analysis.analyse.sample_posterior", lambda *_, **__: (unsampled, None))
    rows = [row for row in analyse(run).result.parameters if row.group == "offset"]
    assert len(rows) == len(told.offsets) == 6
    for offset, row in zip(told.offsets, rows, strict=True):
        told_row, own = asdict(offset.row), asdict(replace(row, midpoint=None))
        for key, value in own.items():
            if isinstance(value, float | tuple):
                assert told_row[key] == pytest.approx(value, rel=1e-8, abs=1e-9)
            else:
                assert told_row[key] == value


def test_held_ones_are_said_to_be_held_at_zero() -> None:
    first, *_, last = calibration(RUNS["open laser"]()).offsets
    for offset in (first, last):
        assert (offset.status, offset.exported, offset.applied) == ("held", False, 0.0)
        assert "HELD at 0" in offset.sentence
    assert "defines the base frame" in first.sentence
    assert "equivalent to one of the uncalibrated tool" in last.sentence


def said_of(run: Run) -> str:
    """What is to be done by the run's message."""
    return message_so_far(solve(Problem.from_run(run)), run.path.name, run.header).action.text.removesuffix(
        "."
    )


def test_an_unidentifiable_one_is_refused_by_name_with_its_reason(refused: Refused) -> None:
    error = refused(calibration, x_pattern(), allow_weak=True)
    assert error.what.startswith("delta2 cannot be exported")
    assert "joint 1 varies by only" in str(error.found)
    assert error.remedy == f"{said_of(x_pattern())}; or exclude by name: --without delta2"
    told = calibration(x_pattern(), allow_weak=True, without=["delta2"])
    second = told.offsets[1]
    assert (second.row.estimate, second.row.std, second.applied, second.exported) == (None, None, 0.0, False)
    assert "UNIDENTIFIABLE, excluded" in second.sentence


def test_a_weak_one_asks_to_be_allowed_and_is_marked(refused: Refused) -> None:
    error = refused(calibration, x_pattern(), without=["delta2"])
    assert "delta3" in error.what
    # What to do is of the offsets that are left: more of the same measurements would not do.
    assert error.remedy.startswith("Enter nothing yet: ")
    assert error.remedy.endswith("; or --allow-weak; or exclude by name: --without delta3")
    assert "record more measurements" not in error.remedy
    allowed = {o.name: o for o in calibration(x_pattern(), allow_weak=True, without=["delta2"]).offsets}
    assert allowed["delta3"].applied == allowed["delta3"].row.estimate != 0
    assert "WEAK" in allowed["delta3"].sentence
    weak = [name for name, offset in allowed.items() if offset.status == "weak"]
    others = calibration(x_pattern(), without=["delta2", *weak])
    assumed = [name for name, offset in allowed.items() if offset.status == "assumed"]
    not_known = {"delta1", "delta2", *weak, *assumed}
    assert {o.name for o in others.offsets if o.exported} == set(allowed) - not_known
    assert all(o.applied == 0 for o in others.offsets if o.name in weak)


def test_a_weak_one_that_only_an_assumption_determines_asks_for_both(refused: Refused) -> None:
    """Where the laser may be mounted anyhow, the X-Pattern says next to nothing of joints 3 and 5."""
    run = read_run(next(run.path for run in demo_runs() if run.name == "x-pattern"))
    error = refused(calibration, run, allow_weak=True, without=["delta2"])
    assert error.what.startswith("delta3 and delta5 cannot be exported as weak")
    assert error.found == "assumed: the laser's mounting, 0.05°"
    assert error.remedy is not None
    assert error.remedy.endswith("or --allow-assumed; or exclude by name: --without delta3 --without delta5")
    assert refused(calibration, run, allow_assumed=True, without=["delta2"]).what.endswith(
        "weakly observable"
    )
    both = calibration(run, allow_weak=True, allow_assumed=True, without=["delta2"]).offsets
    assert [offset.exported for offset in both] == [False, False, True, True, True, True]
    # Negative control: what the header states of the mounting is no assumption.
    content = header_content(run.header, "zerobeam/run/1")
    tool = {**LASER, "sigma": {"tilt_deg": 0.05, "shift_mm": 0.1}}
    stated = replace(run, header=Header.model_validate({**content, "tool": tool}))
    assert calibration(stated, allow_weak=True, without=["delta2"]).offsets[2].exported


def test_the_last_joint_of_a_probe_with_a_free_tip(refused: Refused) -> None:
    run = simulated(good_plan(12, tool=OPEN_PROBE), {}, 2)[1]
    assert refused(calibration, run, allow_weak=True).what.startswith("delta6 cannot be exported")
    assert not calibration(run, allow_weak=True, without=["delta6"]).offsets[5].exported


def test_names_to_leave_out_are_checked(refused: Refused) -> None:
    run = RUNS["good"]()
    error = refused(calibration, run, without=["delta22"])
    assert error.remedy == "did you mean 'delta2'?"
    assert refused(calibration, run, without=["delta1"]).allowed == "delta2, delta3, delta4, delta5, delta6"
    everything = [f"delta{i}" for i in range(2, 7)]
    assert "nothing to export" in refused(calibration, run, without=everything).what


def test_shots_that_contradict_the_model_are_refused(refused: Refused) -> None:
    """Misses ten times the stated noise are; a scale that is to be estimated cannot be contradicted."""
    run = RUNS["good"]()
    rng = np.random.default_rng(0)

    def off(shot: Shot) -> Shot:
        joints = np.array(shot.joints_deg) + rng.normal(0, 0.1, 6)
        return shot.model_copy(update={"joints_deg": tuple(joints.tolist())})

    bad = replace(run, shots=tuple(off(shot) for shot in run.shots))
    error = refused(calibration, bad)
    assert (error.exit_status, "(misfit)" in error.what) == (1, True)
    assert "noise.scale" not in error.remedy
    assert "--unvalidated" in error.remedy
    # As data the offsets are written with their status, and nothing is applied; if asked for, all of it is.
    data, wanted = calibration(bad, as_data=True), calibration(bad, unvalidated=True)
    for told, applied in ((data, False), (wanted, True)):
        assert told.misfit
        assert [o.status for o in told.offsets] == ["held"] + ["unvalidated"] * 5
        assert [o.exported for o in told.offsets] == [False] + [applied] * 5
        assert any(o.applied != 0 for o in told.offsets) == applied
        assert all("UNVALIDATED" in o.sentence for o in told.offsets[1:])
        assert any("Lack of fit" in warning for warning in told.warnings)
    noise = bad.header.noise.model_copy(update={"scale": "estimated", "plausible_factor": 30.0})
    freed = replace(bad, header=bad.header.model_copy(update={"noise": noise}))
    told = calibration(freed, allow_weak=True)
    assert not told.misfit
    for wide, narrow in zip(told.offsets, calibration(run).offsets, strict=True):
        assert narrow.row.std is None or (wide.row.std is not None and wide.row.std > 3 * narrow.row.std)


def test_of_a_nominal_arm_with_a_factory_calibration_nothing_is_applied() -> None:
    """As data the offsets are written, with their u and status, and the file says why none is applied."""
    own = header(LASER, target=(500.0, 100.0, 200.0), robot="ur5e")
    arm = load_robot("ur5e")
    plan = plan_of(own, varied_postures(own, arm, (500.0, 100.0, 200.0), 12, 5), robot=arm)
    run = simulated(plan, {f"delta{i}": TRUTH[f"delta{i}"] for i in (2, 3)}, 2)[1]
    data, other = calibration(run, as_data=True), calibration(run)
    assert [o.status for o in data.offsets] == [o.status for o in other.offsets]
    assert not any(o.exported or o.applied or o.applied_u or o.applied_status for o in data.offsets)
    assert any(o.exported for o in other.offsets)
    (note,) = (text for text in data.warnings if "apply that calibration twice" in text)
    assert note.startswith("nothing is to be applied, as the message of the run says: Enter nothing yet")
    # Negative control: a simulated arm has no controller.
    made = replace(run, header=run.header.model_copy(update={"provenance": {"origin": "simulated"}}))
    assert any(o.exported for o in calibration(made, as_data=True).offsets)


def test_a_target_that_has_moved_is_refused_or_told(refused: Refused) -> None:
    plan = good_plan(24, joint_deg=0.002, noise={"scale": "estimated"})
    before, after = (
        simulated(plan, {**TRUTH, "psd.x": 900.0, "psd.y": 0.0, "psd.z": z}, 2)[1] for z in (0.0, 3.0)
    )
    assert calibration(before).offsets[1].exported
    moved = replace(before, shots=before.shots[:12] + after.shots[12:])
    error = refused(calibration, moved, allow_weak=True)
    assert "(misfit)" in error.what
    assert "Target psd seems to have" in str(error.found)
    told = calibration(moved, allow_weak=True, unvalidated=True)
    assert any("note: Target psd seems to have" in line for line in told.head)
    assert not calibration(before, allow_displaced=True).warnings


def changed(monkeypatch: pytest.MonkeyPatch, **how: Any) -> None:
    def fit(*args: Any, **more: Any) -> LikelihoodFit:
        return replace(fit_likelihood(*args, **more), **how)

    monkeypatch.setattr("zerobeam.analysis.ladder.fit_likelihood", fit)


def test_a_fit_that_did_not_converge_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    changed(monkeypatch, converged=False, reason="out of patience")
    with pytest.raises(FitFailed, match="did not converge \\(out of patience\\): nothing can be exported"):
        calibration(RUNS["good"]())


def test_two_answers_are_none(monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    other = Optimum(np.zeros(1), np.ones(1), 10.0)
    changed(monkeypatch, others=(other, other))
    assert "several sets of offsets" in refused(calibration, RUNS["good"]()).what


def test_an_outlier_is_exported_by_nothing(refused: Refused) -> None:
    """What the message says to enter nothing by is in no file: `may.export` and the exporters are one."""
    run = simulated(good_plan(16, geometry={}), TRUTH, 2)[1]
    joints = np.add(run.shots[4].joints_deg, [0, 0, 0, 0.13, 0, 0])
    off = run.shots[4].model_copy(update={"joints_deg": tuple(joints.tolist())})
    error = refused(calibration, run_of(run.header, [*run.shots[:4], off, *run.shots[5:]]))
    assert "speak against the values" in error.what
    assert "Outlying: measurement 4" in error.found
    assert "remove them, or repeat them" in error.remedy


def test_a_run_that_is_not_predicted_is_exported_by_nothing(refused: Refused) -> None:
    """By `--hold-out`, as `analyse` judges it; the same arm again is predicted."""
    plan, other_arm = good_plan(10), TRUTH | {"delta3": TRUTH["delta3"] + 0.4}
    run = simulated(plan, TRUTH, 2)[1]
    same, other = (replace(simulated(plan, truth, 5)[1], sha256="1" * 64) for truth in (TRUTH, other_arm))
    assert calibration(run, held_out=same).offsets
    assert "is predicted with errors" in refused(calibration, run, held_out=other).found


def test_a_file_says_what_the_message_says_where_nothing_may_be_entered() -> None:
    """A UR whose run was analysed with the nominal arm; other arms, and what no robot was measured for."""
    target = (500.0, 100.0, 200.0)

    def run(robot: str, **provenance: str) -> Run:
        own = header(STATED, target=target, robot=robot, geometry="exact", provenance=provenance)
        arm = load_robot(robot)
        return simulated(plan_of(own, varied_postures(own, arm, target, 12, 5), robot=arm), TRUTH, 2)[1]

    nominal = run("ur5e")
    (said,) = calibration(nominal).warnings
    content = message(analyse(nominal, sampling="never").result)
    assert not content.may.enter
    assert said == f"exported although the message of the run says: {content.action.text}"
    assert "apply that calibration twice" in said
    head = " ".join(line.strip() for line in calibration(nominal).head)
    assert f"note: {said}" in head
    assert calibration(run("ur5e", origin="simulated")).warnings == (NO_ROBOT,)
    assert calibration(nominal, holds="postures").warnings == ()
    assert calibration(run("irb120")).warnings == ()


def test_names_stay_on_one_line_of_ascii(tmp_path: Path) -> None:
    told = calibration(hostile(arm_run(tmp_path)))
    for line in told.head:
        assert line.isascii()
        assert line.isprintable()
    assert "delta1" in "".join(told.head)
    assert one_line("χ² of δ5 → 3°") == "chi2 of delta5 -> 3 deg"
    assert one_line("a\nb\u2028é\x7f") == "a\\nb\\u2028\\xe9\\x7f"
