"""The app's first rehearsal: the plan of a new calibration by its defaults, and a simulated run of it."""

from pathlib import Path

import pytest
from command_line import zerobeam

from zerobeam.analysis.ladder import solve_run
from zerobeam.experiments.demos import example_files
from zerobeam.experiments.plans.new_calibration import new_calibration, place_of
from zerobeam.experiments.recording import RunRequest, record
from zerobeam.model.files.header import Header, write_header
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem

ARMS = ("irb120", "ur5e", "kr6_r900", "lrmate_200id")  # besides the irb1600 of the example
SEEDS = 20
MOST = 1  # of a hundred runs


def misfits(plan: Path, folder: Path, seeds: range) -> int:
    """How many simulated runs of a plan, of arms as its header says, are called a misfit."""
    found = 0
    for seed in seeds:
        file = folder / f"{plan.stem}-{seed}.jsonl"
        record(read_plan(plan), file, RunRequest(rig="simulated", seed=seed), lambda event: None)
        run = read_run(file)
        found += solve_run(Problem.from_run(run), run.header).misfit is not None
    return found


def planned(robot: str, folder: Path) -> Path:
    """The plan that the app makes of a new calibration by a laser."""
    arm = load_robot(robot, folder)
    new = new_calibration("laser", arm, place_of("front", arm, None), (-0.5, 0.0, 1.0), None, {})
    header = folder / f"{robot}.yaml"
    write_header(header, Header.model_validate({"robot": robot, **new.header}))
    plan = folder / f"{robot}-plan.yaml"
    answer = zerobeam("plan", "optimal", f"--header={header}", f"--out={plan}", *new.options)
    assert plan.is_file(), answer.err
    return plan


@pytest.mark.long
def test_the_example_is_no_misfit(tmp_path: Path) -> None:
    """With the seed 0, of which it was said that the zero of J3 had jumped."""
    assert misfits(example_files()["plan.yaml"], tmp_path, range(1)) == 0


@pytest.mark.long
def test_at_most_one_of_a_hundred_first_rehearsals_is_a_misfit(tmp_path: Path) -> None:
    plans = [example_files()["plan.yaml"], *(planned(robot, tmp_path) for robot in ARMS)]
    assert sum(misfits(plan, tmp_path, range(SEEDS)) for plan in plans) <= MOST
