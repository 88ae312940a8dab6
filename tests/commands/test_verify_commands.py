"""`zerobeam plan verify` and `zerobeam verify` as a person calls them."""

import pytest
from command_line import zerobeam

from zerobeam.experiments.demos import demo_runs
from zerobeam.model.files.plan import read_plan

GOOD, X_PATTERN = demo_runs()[0].path, demo_runs()[1].path


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "verify.yaml"
    told = zerobeam("plan", "verify", GOOD, "-o", path)
    assert told.status == 0, told.err
    assert "Probability of noticing an error" in told.out
    return path


def rehearsed(plan, tmp_path, offsets):
    cell = tmp_path / "cell.yaml"
    cell.write_text(f"schema: zerobeam/cell/1\narm: {{offsets_deg: {{{offsets}}}}}\n")
    new = tmp_path / "new.jsonl"
    how = ["--rig", "simulated", "--no-camera", "--cell", cell, "--seed", 5, "-o", new, "--force"]
    assert zerobeam("run", plan, *how).status in (0, 1)
    return zerobeam("verify", GOOD, new)


def test_a_corrected_robot_passes_and_one_that_is_not_fails(plan, tmp_path):
    assert len(read_plan(plan).postures) < 7
    told = rehearsed(plan, tmp_path, "")
    assert (told.status, told.out.partition(".")[0]) == (0, "Pass")
    assert "against an error of the tolerance in each offset." in " ".join(told.out.split())
    told = rehearsed(plan, tmp_path, "delta2: -1.2168")
    assert (told.status, told.out.partition(".")[0]) == (1, "Fail")
    assert "J2 (δ2) had been left at the old value" in " ".join(told.out.split())


def test_what_determines_too_little_has_no_acceptance_test(tmp_path):
    said = zerobeam("plan", "verify", X_PATTERN, "-o", tmp_path / "verify.yaml").refused()
    assert "delta2: unidentifiable" in said
    assert not (tmp_path / "verify.yaml").exists()


def test_a_run_of_another_plan_is_refused(tmp_path):
    assert "not recorded with the plan" in zerobeam("verify", GOOD, GOOD).refused()
    asked = ["plan", "verify", GOOD, "-o", tmp_path / "verify.yaml"]
    assert "fewer postures" in zerobeam(*asked, "--shots", 8).refused()
    assert "no --header or --target" in zerobeam(*asked, "--target", "1,2,3").refused()
    assert "takes --header and --target" in zerobeam("plan", "y", "-o", tmp_path / "y.yaml").refused()
