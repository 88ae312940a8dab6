"""What a command loads: a library that is not used costs the time of one that is."""

import subprocess
import sys
from pathlib import Path

import pytest
from cells import good_plan
from command_line import plan_file
from exact_runs import demo_runs

GOOD = next(run.path for run in demo_runs() if run.name == "good")
LOADED = """
import sys
from zerobeam.cli import run
sys.argv = ["zerobeam", *sys.argv[1:]]
assert run() < 2
print("loaded:", *sys.modules)
"""


def loaded(*arguments: object) -> set[str]:
    """The modules that one command has loaded when it is done, none of a maker of arms among them."""
    command = [sys.executable, "-c", LOADED, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = set(done.stdout.rpartition("loaded:")[2].split())
    assert [name for name in names if name.startswith("zerobeam.experiments.makers")] == []
    return names


def with_special_functions() -> set[str]:
    """What scipy.special loads by itself: scipy.linalg too, in older versions."""
    done = subprocess.run(
        [sys.executable, "-c", "import sys, scipy.special; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())


@pytest.mark.long
def test_check_loads_special_functions_no_sampler_and_no_figures(tmp_path: Path) -> None:
    names = loaded("check", plan_file(tmp_path / "plan.yaml", good_plan(7)))
    assert "numpy" in names
    unused = {
        "scipy.stats",
        "scipy.linalg",
        "h5py.h5",
        "emcee",
        "h5py",
        "matplotlib",
        "jinja2",
        "typst",
        "rich.progress",
    }
    assert names & (unused - with_special_functions()) == set()


def test_analyse_loads_what_it_computes_with_and_no_figures() -> None:
    names = loaded("analyse", GOOD, "--ess", 100)
    assert "scipy.special" in names
    assert "emcee" in names
    unused = {
        "matplotlib",
        "jinja2",
        "typst",
        "rich.progress",
        "arviz_stats",
        "xarray",
        "pandas",
        "scipy.stats",
        "scipy.linalg",
        "h5py.h5",
        "numpy.f2py.f2py2e",
        "numpy.testing._private",
    }
    assert names & (unused - with_special_functions()) == set()


@pytest.mark.parametrize("word", ["--help", "--version", "nothing"])
@pytest.mark.one_in(3)
def test_without_a_command_all_are_there(word: str) -> None:
    command = [sys.executable, "-c", "from zerobeam.cli import main; main()", word]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert {"--help": "study", "--version": "zerobeam 0", "nothing": "No such command"}[word] in said
