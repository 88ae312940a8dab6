"""Fits whose noise or geometry the data cannot decide: no number stands for it, and a misfit is said."""

import json
from pathlib import Path
from typing import Any

import pytest
from cells import good_plan
from command_line import zerobeam
from exact_runs import demo_runs

from zerobeam.analysis import ladder
from zerobeam.analysis.analyse import analyse
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem

GOOD = next(run.path for run in demo_runs() if run.name == "good")


def changed(path: Path, swapped: tuple[int, int] | None = None, **header: Any) -> Path:
    """The good demo run with other keys in its header, and two columns of joints exchanged."""
    head, *shots = map(json.loads, GOOD.read_text(encoding="utf-8").splitlines())
    if swapped is not None:
        one, other = swapped
        for shot in shots:
            joints = shot["joints_deg"]
            joints[one], joints[other] = joints[other], joints[one]
    path.write_text("\n".join(map(json.dumps, [head | header, *shots])) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("swapped", [(0, 2), (1, 3)])
@pytest.mark.long
def test_of_exchanged_columns_with_geometry_the_misfit_is_said(
    tmp_path: Path, swapped: tuple[int, int]
) -> None:
    """u at twice the tolerances was nan, and the whole result refused as unsound."""
    run = changed(tmp_path / "run.jsonl", swapped, geometry={}, limits="warn")
    answer = zerobeam("analyse", run, "--ess", 100, "--json")
    assert answer.status == 1, answer.err
    assert answer.json["verdict"] == "misfit"
    assert all(u is None or 0 < u < 5 for u in answer.json["geometry"]["at_twice"].values())
    actual = zerobeam("analyse", run, "--ess", 100)
    assert actual.status == 1
    assert "None" not in actual.out
    assert "nan" not in actual.out


def test_what_the_geometry_can_fit_exactly_says_nothing_of_the_noise(tmp_path: Path) -> None:
    """Its scale went to 0, and the curvature could not be inverted."""
    noise = json.loads(GOOD.read_text().splitlines()[0])["noise"] | {"scale": "estimated"}
    run = read_run(changed(tmp_path / "run.jsonl", noise=noise, geometry={}))
    with pytest.raises(BadInput, match="noise scale cannot be estimated") as caught:
        analyse(run, ess=100)
    assert caught.value.found == (
        "14 numbers from 7 measurements for 8 unknowns, and 37 parameters of geometry and tool deviate within"
        " their tolerances"
    )
    assert caught.value.allowed == "more numbers than unknowns and deviations: 23 measurements"
    assert caught.value.remedy is not None
    assert "separate" in caught.value.remedy
    plan = good_plan(23, geometry=None, noise={"scale": "estimated"})
    assert Problem.from_plan(plan).noise_estimable


@pytest.mark.parametrize(("divisor", "dof"), [(1.5, 1), (1.7, 0)])
def test_correlated_measurements_may_count_for_too_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, divisor: float, dof: int
) -> None:
    """The variance of the noise factor was 1 over no degree of freedom."""
    noise = json.loads(GOOD.read_text().splitlines()[0])["noise"] | {"scale": "estimated"}
    run = read_run(changed(tmp_path / "run.jsonl", noise=noise, geometry="exact"))
    real = ladder.effective

    def fewer(*arguments: Any) -> Any:
        result = real(*arguments)

        class Fewer:
            def __getattr__(self, name: str) -> Any:
                return divisor if name == "divisor" else getattr(result, name)

        return Fewer()

    monkeypatch.setattr(ladder, "effective", fewer)
    problem = Problem.from_run(run)
    if dof:
        assert ladder.solve_run(problem, run.header).dof == dof
    else:
        with pytest.raises(BadInput, match="noise scale cannot be estimated"):
            ladder.solve_run(problem, run.header)


@pytest.mark.parametrize("robot", ["irb1600", pytest.param("irb120", marks=pytest.mark.long)])
def test_residuals_beyond_rounding_are_no_convergence(tmp_path: Path, robot: str) -> None:
    """The information was not positive definite to rounding, and the run ended in a LinAlgError."""
    noise = {"joint_deg": 1e-11, "spot_mm": 1e-11}
    run = changed(tmp_path / "run.jsonl", robot=robot, noise=noise, limits="warn")
    answer = zerobeam("analyse", run, "--ess", 100, "--json")
    assert answer.status == 3, answer.err
    assert answer.json["verdict"] == "degenerate"
    assert not answer.json["fits"]["likelihood"]["converged"]
    assert "not positive definite" in answer.json["fits"]["likelihood"]["reason"]
    assert all(row["estimate"] is None or row["held"] for row in answer.json["parameters"])
    assert answer.json["geometry"]["ladder"] == []
