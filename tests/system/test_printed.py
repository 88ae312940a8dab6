"""What the commands print of real runs and plans, word for word: a sentence changes on purpose only.

All numbers follow from fits of simulated measurements, rounded as people read them. What depends on the draws
of the sampler, which are others on another machine, is left out. The arm is a typical one, unless a case is
about residuals, which seven measurements of such an arm hardly have: then it is exact.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cells import PROBE, good_plan, header, pattern_plan, plan_of
from command_line import WIDTH, plan_file, zerobeam
from exact_runs import demo_runs
from golden_files import assert_golden, without_draws

from zerobeam.model.files.run import read_run

GOOD, X_PATTERN, UNCALIBRATED = (case.path for case in demo_runs())
Made = Callable[[Path], tuple[object, ...]]


def rows(file: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Header and measurements of a run."""
    top, *shots = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    return top, shots


def analysed(top: dict[str, Any], shots: list[dict[str, Any]], *options: str) -> Made:
    def made(folder: Path) -> tuple[object, ...]:
        file = folder / "run.jsonl"
        file.write_text("".join(json.dumps(row) + "\n" for row in (top, *shots)), encoding="utf-8")
        return "analyse", file, "--ess", 100, *options

    return made


def good(*options: str, **changes: Any) -> Made:
    """The built-in good run with other keys in its header."""
    top, shots = rows(GOOD)
    return analysed({**top, **changes}, shots, *options)


def pushed() -> Made:
    top, shots = rows(GOOD)
    shots[2]["spot_mm"] = [1.5, -1.0]
    return analysed({**top, "geometry": "exact"}, shots, "--robust", "huber")


def two_targets() -> Made:
    top, shots = rows(GOOD)
    near = [{**shot, "target": "near"} for shot in shots]
    far = [{**shot, "shot": len(shots) + i, "target": "far"} for i, shot in enumerate(shots)]
    return analysed(top, [*near, *far], "--hold-out", "far")


def checked(plan: Callable[[], Any]) -> Made:
    return lambda folder: ("check", plan_file(folder / "plan.yaml", plan()))


def carried(plan: Callable[[], Any], *options: object, cell: dict[str, Any] | None = None) -> Made:
    def made(folder: Path) -> tuple[object, ...]:
        (folder / "cell.yaml").write_text(json.dumps({"schema": "zerobeam/cell/1", **(cell or {})}))
        asked = ("--cell", folder / "cell.yaml", "-o", folder / "run.jsonl", "--no-camera", "--seed", 3)
        return "run", plan_file(folder / "plan.yaml", plan()), *asked, *options

    return made


def typical() -> Any:
    """The postures of the built-in good run, of a typical arm."""
    return plan_of(header(target=(950.0, 150.0, 100.0), geometry=None), read_run(GOOD).joints)


def separate() -> Any:
    return good_plan(14, joint_deg=0.05, noise={"scale": "separate"})


def away() -> Any:
    return plan_of(header(PROBE, target=(5000.0, 0.0, 0.0)), good_plan(4).postures)


NOISE = rows(GOOD)[0]["noise"]
UNDERSTATED = {**NOISE, "joint_deg": 0.001, "spot_mm": 0.005}
SILENT = {"faults": [{"kind": "psd-dropout", "shot": 2}]}
BUMPED = {"faults": [{"kind": "psd-bump", "shot": 3, "shift_mm": [1.8, 2.4, 0.0]}]}
CASES: dict[str, tuple[Made, int]] = {
    # name: (command, exit status)
    "analyse_good": (good(), 0),
    "analyse_x_pattern": (analysed(*rows(X_PATTERN)), 1),
    "analyse_uncalibrated": (analysed(*rows(UNCALIBRATED)), 0),
    "analyse_joint_1_free": (good(held=[]), 1),
    "analyse_noise_understated": (good(noise=UNDERSTATED, geometry="exact"), 1),
    "analyse_noise_estimated": (good(noise={**NOISE, "scale": "estimated"}, geometry="exact"), 0),
    "analyse_tolerance_missed": (good(tolerance={"offset_deg": 0.005}), 1),
    "analyse_pushed": (pushed(), 1),
    "analyse_two_targets": (two_targets(), 0),
    "check_good": (checked(typical), 0),
    "check_weak": (checked(lambda: good_plan(8, geometry=None)), 1),
    "check_x_pattern": (checked(lambda: pattern_plan("x", geometry=None)), 1),
    "check_y_pattern_aside": (checked(lambda: pattern_plan("y", 100.0)), 1),
    "check_noise_factors": (checked(separate), 1),
    "check_out_of_reach": (checked(away), 2),
    "run_good": (carried(typical), 0),
    "run_x_pattern": (carried(lambda: pattern_plan("x", geometry=None)), 1),
    "run_adaptive": (carried(lambda: good_plan(8), "--adaptive", "--tolerance", "2"), 0),
    "run_refused": (carried(lambda: good_plan(5), cell=SILENT), 1),
    "run_bumped": (carried(lambda: good_plan(7, joint_deg=0.002), cell=BUMPED), 1),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.at_length(r"^(analyse_(joint|noise|tolerance|pushed|two|uncal)|run_(x|adaptive|bumped))")
def test_it_is_printed_word_for_word(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, status = CASES[name]
    command, *arguments = made(tmp_path)
    if command == "analyse":  # its commands name the run as it was typed
        monkeypatch.chdir(tmp_path)
        arguments[0] = Path(str(arguments[0])).name
    told = zerobeam(command, *arguments)
    printed = (told.out + told.err).replace(str(tmp_path), "FOLDER")
    assert_golden(f"printed/{name}.txt", without_draws(printed))
    assert told.status == status
    assert (told.err == "") == (status != 2)
    assert status == 2 or max(len(line) for line in printed.splitlines()) <= WIDTH


def test_draws_are_masked_and_nothing_else() -> None:
    text = "n  curvature  profile  posterior\nδ3  −0.99 to 0.27°  −0.98 to 0.28°  −0.98 to 0.30°\n"
    whole = f"δ2  1 to 2°\n95 % intervals by three methods\n{text}Posterior:\nδ2  1 to 2°\n"
    left = "n  curvature  profile  …\nδ3  −0.99 to 0.27°  −0.98 to 0.28°  …\n"
    assert without_draws(whole) == whole.replace(text, left)
    assert without_draws("1 to 2\u00a0mm  3 to 4\u00a0mm") == "1 to 2\u00a0mm  3 to 4\u00a0mm"
    assert (
        without_draws("converged (R-hat 1.02,\nsmallest effective sample size 270).")
        == "converged (R-hat …)."
    )
    assert without_draws("agree: R-hat 1.001, at least\n4091 effective draws.") == "agree: R-hat …."
