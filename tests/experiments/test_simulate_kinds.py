"""Simulated measurements of every kind of instrument, by the noise that their header states."""

from dataclasses import replace

import numpy as np
import pytest
from measured_arms import CELLS, Cell
from scipy import stats

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.experiments.recording import RunRequest, record
from zerobeam.experiments.simulate import Truth, simulated_readings, simulated_shots
from zerobeam.model.files.plan import Means, Plan, read_plan, write_plan
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.likelihood.problem import Problem

STATIONS = [name for name in CELLS if "laser" not in name and name not in ("probe", "cube")]
LOWER, UPPER = [-60, -20, -40, -90, -60, -120], [60, 50, 30, 90, 60, 120]


def plan_of_cell(cell: Cell, tmp_path, count=12, seed=0) -> Plan:
    """`count` random postures, each with all that the cell reads in one turn."""
    rng = np.random.default_rng(seed)
    own = cell.header(geometry="exact", joint_deg=0.005, limits="warn")
    rows, targets, means = [], [], []
    for i in range(count):
        turn = cell.turns[i % len(cell.turns)]
        posture = rng.uniform(LOWER, UPPER)
        for label, variant, target in turn:
            rows.append(posture)
            targets.append(target)
            named = label if len(own.labels) > 1 else None
            means.append(Means(named, variant or None, i if len(turn) > 1 else None))
    write_plan(tmp_path / "plan.yaml", own, rows, targets, means=means)
    return read_plan(tmp_path / "plan.yaml")


def run_of_plan(plan: Plan, truth: Truth, seed: int) -> Run:
    shots = list(simulated_shots(truth, np.random.default_rng(seed)))
    return Run.of_shots(plan.header, plan.robot, shots, "run")


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.one_in(3)
def test_readings_are_as_noisy_as_stated(name, tmp_path):
    """At the truth the whitened residuals of what was read are unit normals."""
    plan = plan_of_cell(CELLS[name], tmp_path)
    whitened = []
    for seed in range(12):
        truth = Truth.drawn(plan, np.random.default_rng(seed), offset_deg=0.3)
        problem = Problem.from_run(run_of_plan(plan, truth, seed))
        read = problem.whiten(truth.x).residual.reshape(problem.active.shape)[problem.active > 0]
        whitened.extend(read)
    whitened = np.array(whitened)
    low, high = stats.chi2.ppf([0.0005, 0.9995], whitened.size)
    assert low < (whitened**2).sum() < high
    assert stats.kstest(whitened, "norm").pvalue > 1e-3


def test_noise_that_is_not_as_stated_shows(tmp_path):
    """The control of the test above."""
    plan = plan_of_cell(CELLS["tracker"], tmp_path)
    understated = CELLS["tracker"].header(geometry="exact", joint_deg=0.0025, understated=2, limits="warn")
    truth = Truth.drawn(plan, np.random.default_rng(0), offset_deg=0.3)
    shots = list(simulated_shots(truth, np.random.default_rng(0)))
    problem = Problem.from_run(Run.of_shots(understated, plan.robot, shots, "run"))
    read = problem.whiten(truth.x).residual.reshape(problem.active.shape)[problem.active > 0]
    assert (read**2).sum() > stats.chi2.ppf(1 - 1e-9, read.size)


@pytest.mark.parametrize("name", ["tracker", "plane", "tracker + plane + ballbar"])
def test_many_runs_side_by_side_are_as_one(name, tmp_path):
    """`simulated_readings` gives runs as `simulated_shots` does: unit normals at each one's truth."""
    plan = plan_of_cell(CELLS[name], tmp_path, count=8)
    truths = [Truth.drawn(plan, np.random.default_rng(seed), offset_deg=0.3) for seed in range(10)]
    problem = truths[0].problem
    made = simulated_readings(problem, np.array([t.x for t in truths]), np.random.default_rng(1))
    assert made.met.all()
    whitened = []
    for truth, joints, spots, readings in zip(truths, made.joints, made.spots, made.readings, strict=True):
        # A spot is what a residual is less; the readings are those without noise.
        touched = np.where(problem.met > 0, 0.0, spots)
        run = replace(problem.moved(joints, touched), readings=readings)
        whitened.extend(run.whiten(truth.x).residual.reshape(run.active.shape)[run.active > 0])
    assert stats.kstest(whitened, "norm").pvalue > 1e-3
    assert 0.8 < np.std(whitened) < 1.2


def test_a_frame_stands_somewhere_and_is_level(tmp_path):
    plan = plan_of_cell(CELLS["tracker"], tmp_path)
    problem = Problem.from_plan(plan)
    block = problem.parameters.block("frame")
    frames = np.array([Truth.drawn(plan, np.random.default_rng(seed)).x[block] for seed in range(40)])
    assert np.linalg.norm(frames[:, :3], axis=1).min() > 2000
    assert np.abs(frames[:, 5]).std() > 0.5  # turned anyhow
    assert np.linalg.norm(frames[:, :3].std(axis=0)) < 400


@pytest.mark.long
@pytest.mark.parametrize("name", ["tracker", "tracker + plane + ballbar"])
@pytest.mark.at_length(r"^(?!tracker$)")
def test_a_plan_is_rehearsed_from_the_file_to_the_file(name, tmp_path):
    plan = plan_of_cell(CELLS[name], tmp_path, count=10)
    events = []
    ended = record(plan, tmp_path / "run.jsonl", RunRequest("simulated"), events.append)
    run = read_run(tmp_path / "run.jsonl")
    assert len(run.shots) == len(plan.postures) == len(ended.shots)
    assert run.header.provenance["origin"] == "simulated"
    assert [shot.reflector for shot in run.shots] == [means.reflector for means in plan.means]
    assert [event.target for event in events if event.event == "recorded"] == list(plan.called)


def test_digits_of_what_is_recorded(tmp_path):
    plan = plan_of_cell(CELLS["pose"], tmp_path, count=3)
    truth = Truth.drawn(plan, np.random.default_rng(0))
    for shot in simulated_shots(truth, np.random.default_rng(0)):
        assert len(shot.measured_mm) == 3
        assert np.linalg.norm(shot.measured_quat) == pytest.approx(1, abs=1e-11)


def test_the_arm_is_found_again(tmp_path):
    """A known frame determines the first offset too; the last is known as its reflectors are."""
    cell = CELLS["tracker, frame known"]
    plan = plan_of_cell(cell, tmp_path, count=20)
    truth = Truth.drawn(plan, np.random.default_rng(3), offset_deg=0.3)
    fit = fit_likelihood(Problem.from_run(run_of_plan(plan, truth, 1)), starts=0)
    offsets = truth.problem.parameters.block("offset")
    assert np.degrees(np.abs(fit.x - truth.x)[offsets][:5]).max() < 0.03
