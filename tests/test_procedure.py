"""A run that is carried out: recorded shot by shot, with the truth and the seed, never over another file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import OPEN_LASER, good_plan
from command_line import plan_file

from zerobeam.experiments import procedure
from zerobeam.experiments.procedure import carry_out
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.plan import Plan, read_plan
from zerobeam.model.problem import Problem
from zerobeam.model.run import Shot, read_run


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("plan")
    return read_plan(plan_file(folder / "plan.yaml", good_plan(8, provenance={"robot serial": "16-00042"})))


def silent(stage: str, share: float) -> None:
    pass


def test_the_file_grows_shot_by_shot_and_the_share_is_told(tmp_path: Path, plan: Plan) -> None:
    file = tmp_path / "run.jsonl"
    recorded: list[int] = []
    shares: list[float] = []

    def told(stage: str, share: float) -> None:
        assert stage == "shots"
        shares.append(share)
        recorded.append(len(read_run(file).shots))

    assert carry_out(plan, "simulated", file, 4, told) == 8
    assert recorded == list(range(1, 9))
    np.testing.assert_allclose(shares, np.arange(1, 9) / 8)


def test_the_header_is_the_plans_with_the_truth_in_its_provenance(tmp_path: Path, plan: Plan) -> None:
    file = tmp_path / "run.jsonl"
    carry_out(plan, "simulated", file, 4, silent)
    run = read_run(file)
    run.require_analysable()
    provenance = dict(run.header.provenance)
    assert provenance.pop("robot serial") == "16-00042"
    assert provenance.pop("origin") == "simulated"
    assert provenance.pop("seed") == 4
    assert list(provenance) == [f"true delta{i} (deg)" for i in range(1, 7)]
    assert provenance["true delta1 (deg)"] == 0.0  # held, as the base frame
    assert all(isinstance(value, float) and abs(value) < 5 for value in provenance.values())
    assert len(set(provenance.values())) == 6
    assert run.header.model_copy(update={"provenance": {}, "schema_": None}) == plan.header.model_copy(
        update={"provenance": {}, "schema_": None}
    )


def test_the_truth_of_the_provenance_is_that_of_the_shots(tmp_path: Path, plan: Plan) -> None:
    """At the stated true offsets the shots miss by their noise; without them by what a degree makes."""
    file = tmp_path / "run.jsonl"
    carry_out(plan, "simulated", file, 4, silent)
    run = read_run(file)
    problem = Problem.from_run(run)

    def chi2(x: np.ndarray) -> float:
        residual = problem.whiten(x).residual
        return float(residual @ residual)

    x = problem.supposed()
    without = chi2(x)
    for i in range(6):
        x[i] = np.radians(float(run.header.provenance[f"true delta{i + 1} (deg)"]))
    # 16 numbers whose squares sum to a chi-squared: below 40 but for one time in a thousand.
    assert chi2(x) < 40
    assert without > 1000


def test_an_open_tool_is_off_too_and_the_provenance_says_by_what(tmp_path: Path) -> None:
    plan = read_plan(plan_file(tmp_path / "plan.yaml", good_plan(8, tool=OPEN_LASER)))
    carry_out(plan, "simulated", tmp_path / "run.jsonl", 1, silent)
    provenance = read_run(tmp_path / "run.jsonl").header.provenance
    assert provenance["true delta6 (deg)"] == 0.0  # held with an uncalibrated tool
    names = ["tool.tilt1 (deg)", "tool.tilt2 (deg)", "tool.shift1 (mm)", "tool.shift2 (mm)"]
    assert all(provenance[f"true {name}"] != 0 for name in names)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_arm(tmp_path: Path, plan: Plan) -> None:
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        carry_out(plan, "simulated", tmp_path / name, seed, silent)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    a, c = (read_run(tmp_path / name) for name in "ac")
    assert a.header.provenance["true delta2 (deg)"] != c.header.provenance["true delta2 (deg)"]
    assert a.shots[0].joints_deg != c.shots[0].joints_deg


def test_a_file_that_exists_is_refused_and_left_as_it_is(tmp_path: Path, plan: Plan) -> None:
    file = tmp_path / "run.jsonl"
    file.write_text("mine")
    with pytest.raises(BadInput, match="exists already"):
        carry_out(plan, "simulated", file, 0, silent)
    assert file.read_text() == "mine"


def test_a_fault_of_the_rig_leaves_the_shots_so_far(
    tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(truth: Truth, rng: np.random.Generator) -> Iterator[Shot]:
        for shot in simulated_shots(truth, rng):
            if shot.shot == 5:
                raise RigFault("the motors are off")
            yield shot

    file = tmp_path / "run.jsonl"
    monkeypatch.setattr(procedure, "simulated_shots", breaks)
    with pytest.raises(RigFault, match="motors"):
        carry_out(plan, "simulated", file, 4, silent)
    run = read_run(file)
    run.require_analysable()
    assert [shot.shot for shot in run.shots] == [0, 1, 2, 3, 4]
    assert run.warnings == ()
    assert all(json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
