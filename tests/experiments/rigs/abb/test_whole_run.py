"""An ABB robot driven as a person does: plan, command line, controller, run file, report."""

import base64
import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, quote_plus

import numpy as np
import pypdf
import pytest
from abb_controller.sensor_server import CellSensors
from abb_controller.service import SimulatedController
from cells import good_plan
from child import ABB_CONTROLLER, ZEROBEAM, child
from command_line import plan_file, zerobeam
from controllers import UNLIMITED, Watched, quick, unhurried
from scipy import stats

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.experiments.recording import Controller, RunRequest, record
from zerobeam.experiments.rigs.abb.driver import AbbRig
from zerobeam.experiments.rigs.abb.rws_client import PASSWORD, USER, Caution, find_access
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem

pytest.importorskip("abb_robot_client")

WORD, NAME = "Gr8-Pass:wort/é", "some.body"
FAST = 5
SEEDS, MANY = (1, 2), range(1, 25)
OFFSETS = 5  # delta1 cannot be told from the target's place and is held
CELL = {
    "schema": "zerobeam/cell/1",
    "camera": None,
    "arm": {"drawn_deg": 0.3},
    "psd": {"rate_hz": 20_000.0, "placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the cell and plans of so many shots."""
    folder = tmp_path_factory.mktemp("abb")
    (folder / "cell.yaml").write_text(json.dumps(CELL))
    for shots in (1, 2, 4):
        plan_file(folder / f"plan{shots}.yaml", good_plan(shots, joint_deg=0.005))
    return folder


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    quick(monkeypatch)
    unhurried(monkeypatch)


@contextmanager
def controller(plan: Plan, seed: int, **options: Any) -> Iterator[SimulatedController]:
    options = {"speed_up": FAST, "requests_a_second": UNLIMITED, **options}
    with SimulatedController(plan, CellFile.model_validate(CELL), seed, **options) as made:
        yield made


def offsets(file: Path) -> tuple[Matrix, Matrix]:
    """(5,) rad the offsets of a run, and (5, 5) their covariance."""
    problem = Problem.from_run(read_run(file))
    fit = fit_likelihood(problem, starts=0)
    free = problem.parameters.free
    scale = problem.parameters.prior_std[free]
    own = problem.parameters.group("offset")[free]
    return fit.x[free][own], (fit.covariance * np.outer(scale, scale))[np.ix_(own, own)]


def both(folder: Path, out: Path, seed: int) -> list[tuple[Matrix, Matrix]]:
    """The offsets by the simulated cell, and by the controller with the same cell behind it."""
    plan = read_plan(folder / "plan4.yaml")
    cell, by_abb = out / f"{seed}-cell.jsonl", out / f"{seed}-abb.jsonl"
    record(plan, cell, RunRequest("simulated", seed=seed, cell=folder / "cell.yaml"), lambda event: None)
    with controller(plan, seed) as there:
        access = find_access({PASSWORD: "robotics"}, host="127.0.0.1", port=there.port)
        caution = Caution(lambda text: True, share=1.0, egm_port=there.egm_port)
        reached = Controller(access, CellSensors(there.irc5), caution)
        record(plan, by_abb, RunRequest("abb", controller=reached), lambda event: None)
        truth = there.irc5.cell.provenance()
    told = read_run(cell).header.provenance
    assert {key: told[key] for key in truth if key.startswith("true ")} == {
        key: value for key, value in truth.items() if key.startswith("true ")
    }
    return [offsets(file) for file in (cell, by_abb)]


def apart(one: tuple[Matrix, Matrix], other: tuple[Matrix, Matrix]) -> float:
    """Chi-squared of the difference of two independent answers, of as many degrees of freedom as offsets."""
    difference = one[0] - other[0]
    assert len(difference) == OFFSETS
    return float(difference @ np.linalg.solve(one[1] + other[1], difference))


@pytest.mark.long
@pytest.mark.usefixtures("_quick")
def test_the_controller_gives_the_offsets_that_the_cell_gives(folder: Path, tmp_path: Path) -> None:
    """Each difference within what has a chance of 1e-4; those of another truth are told apart."""
    limit = stats.chi2.isf(1e-4, OFFSETS)
    found = [both(folder, tmp_path, seed) for seed in SEEDS]
    assert all(apart(cell, by_abb) < limit for cell, by_abb in found)
    for (cell, _), (_, by_abb) in itertools.permutations(found, 2):
        assert apart(cell, by_abb) > 2 * limit


@pytest.mark.long
@pytest.mark.usefixtures("_quick")
def test_differences_are_as_large_as_the_noise_makes_them(folder: Path, tmp_path: Path) -> None:
    """Over many truths: Kolmogorov and Smirnov's test of the chi-squared, with a chance of 1e-3."""
    found = [apart(*both(folder, tmp_path, seed)) for seed in MANY]
    assert stats.kstest(found, stats.chi2(OFFSETS).cdf).pvalue > 1e-3
    assert stats.kstest(np.multiply(found, 2.5), stats.chi2(OFFSETS).cdf).pvalue < 1e-3


def holds(content: bytes, word: str) -> bool:
    """Whether a password stands there: as it is, broken into lines, escaped, or in base64 with the user."""
    text = re.sub(r"\s", "", content.decode("utf-8", "replace"))
    pairs = (word, f"{NAME}:{word}", f"Default User:{word}")
    coded = [base64.b64encode(pair.encode()).decode().rstrip("=") for pair in pairs]
    return any(form in text for form in (word, json.dumps(word)[1:-1], quote(word), quote_plus(word), *coded))


@pytest.mark.parametrize("form", ["{}", '"{}"', "…{}…"])
def test_a_password_that_is_planted_is_found(form: str) -> None:
    planted = form.format(WORD)
    assert holds(planted.encode(), WORD)
    assert holds(f"{planted[:8]}\n    {planted[8:]}".encode(), WORD)
    assert holds(json.dumps({"url": planted}).encode(), WORD)
    assert holds(f"http://{quote_plus(NAME)}:{quote_plus(WORD)}@127.0.0.1/".encode(), WORD)
    assert holds(b"Authorization: Basic " + base64.b64encode(f"{NAME}:{WORD}".encode()), WORD)
    assert not holds(f"{NAME} Gr8-Pass 127.0.0.1".encode(), WORD)


def pdf_text(file: Path) -> bytes:
    return "\n".join(page.extract_text() for page in pypdf.PdfReader(file).pages).encode()


@pytest.mark.parametrize("reported", [False, pytest.param(True, marks=pytest.mark.long)])
@pytest.mark.usefixtures("_quick")
@pytest.mark.long
def test_a_stopped_run_is_resumed_and_the_password_is_in_no_output(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    reported: bool,
) -> None:
    """By the command line: refused, broken, stopped by an emergency stop, resumed, reported."""
    caplog.set_level("DEBUG")
    plan, file = folder / "plan2.yaml", tmp_path / "run.jsonl"
    monkeypatch.setenv(USER, NAME)
    told: dict[str, Any] = {}
    with controller(read_plan(plan), 1, users={NAME: WORD}) as there:
        ports = ("--port", there.port, "--egm-port", there.egm_port, "--sensor-port", there.sensor_port)
        command = ("run", plan, "--rig", "abb", "--host", "127.0.0.1", *ports, "--yes", "-o", file)
        monkeypatch.delenv(PASSWORD, raising=False)
        told["refused"] = zerobeam(*command, "--password", f"{WORD}{WORD}")
        assert told["refused"].status == 3
        assert not file.exists()
        with pytest.MonkeyPatch.context() as broken:
            broken.setattr(AbbRig, "begin", lambda rig, *_: rig.nothing_of_this_name)
            told["broken"] = zerobeam(*command, "--password", WORD)
        assert "Traceback" in told["broken"].err
        file.unlink()
        monkeypatch.setenv(PASSWORD, WORD)
        # The arm stands before the second posture in good time, and is guided from then on.
        pressed = Watched(there)
        pressed.lookers.append(
            lambda now: (
                there.irc5.press_emergency_stop()
                if file.exists() and file.read_bytes().count(b"\n") == 2 and there.irc5.egm.active
                else None
            )
        )
        told["stopped"] = zerobeam(*command, "--json-lines")
        pressed.lookers.clear()
        assert "an emergency stop is pressed" in told["stopped"].err
        assert [shot.shot for shot in read_run(file).shots] == [0]
        there.irc5.release_emergency_stop()
        with there.irc5.lock:
            there.irc5.set_state("motoron")
        told["resumed"] = zerobeam(*command, "--resume", "--password", WORD, "--json-lines")
    recorded = [json.loads(line) for line in told["resumed"].out.splitlines()]
    assert [event["shot"] for event in recorded if event["event"] == "recorded"] == [1]
    assert [shot.shot for shot in read_run(file).shots] == [0, 1]
    searched = ["run"]
    outputs = {"log": caplog.text.encode(), "run": file.read_bytes()}
    if reported:
        told["report"] = zerobeam("report", file, "-o", tmp_path / "report", "--ess", 100)
        assert told["report"].status in (0, 1), told["report"].err
        searched += ["report.html", "report.pdf", "result.json"]
        for path in (tmp_path / "report").rglob("*"):
            if path.is_file():
                outputs[path.name] = pdf_text(path) if path.suffix == ".pdf" else path.read_bytes()
    outputs |= {name: (answer.out + answer.err).encode() for name, answer in told.items()}
    assert [name for name, content in outputs.items() if holds(content, WORD)] == []
    for word in (NAME, "127.0.0.1"):
        assert word not in file.read_text() + told["stopped"].out
    # There was something to be found, of the robot and of what was asked.
    assert all(b"irb1600" in outputs[name] for name in searched)
    assert b"/rw/panel/ctrlstate" in outputs["log"]
    assert all(outputs.values())


LISTENER = """
import os, sys

def hook(event, arguments):
    names = ("getaddrinfo", "gethostbyname", "gethostbyaddr", "getnameinfo")
    if event in ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"):
        told = arguments[1]
    elif event in ["socket." + name for name in names]:
        told = arguments[0]
    else:
        return
    with open(os.environ["HEARD"], "a") as heard:
        heard.write(f"{event} {told!r}\\n")

sys.addaudithook(hook)
"""


def heard(file: Path) -> dict[str, set[str]]:
    """The addresses that a process used, by event."""
    found: dict[str, set[str]] = {}
    for line in file.read_text().splitlines():
        event, _, address = line.partition(" ")
        host = re.match(r"\(?'([^']*)'", address)
        found.setdefault(event, set()).add(host[1] if host else address)
    return found


@pytest.mark.long
def test_two_processes_talk_on_loopback_alone(folder: Path, tmp_path: Path) -> None:
    """The controller and `zerobeam run` as they are, at the controller's own pace."""
    (tmp_path / "sitecustomize.py").write_text(LISTENER)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONUNBUFFERED": "1", PASSWORD: "robotics"}
    plan, file = folder / "plan1.yaml", tmp_path / "run.jsonl"
    asked = [str(plan), "--cell", str(folder / "cell.yaml"), "--seed", "7"]
    there_too = {**environment, "HEARD": str(tmp_path / "controller")}
    with child([*ABB_CONTROLLER, *asked], stderr=subprocess.PIPE, env=there_too) as there:
        try:
            assert there.stdout is not None
            lines = list(itertools.takewhile(lambda line: "Ctrl-C" not in line, there.stdout))
            numbers = [re.findall(r"\d+", line)[-1] for line in lines]
            own = ["run", str(plan), "--rig", "abb", "--host", "127.0.0.1", "--yes", "-o", str(file)]
            named = [*zip(("--port", "--egm-port", "--sensor-port"), numbers, strict=True)]
            driven = subprocess.run(
                [*ZEROBEAM, *own, *itertools.chain(*named), "--speed", "1", "--json-lines"],
                capture_output=True,
                text=True,
                env={**environment, "HEARD": str(tmp_path / "run")},
                timeout=120,
                check=False,
            )
        finally:
            there.terminate()
            out, err = there.communicate(timeout=30)
    assert driven.stderr == ""
    assert json.loads(driven.stdout.splitlines()[-1])["shots"] == [0]
    assert [shot.shot for shot in read_run(file).shots] == [0]
    by_run, by_controller = heard(tmp_path / "run"), heard(tmp_path / "controller")
    # The HTTP library looks at its import whether a socket can be bound to ::1, and closes it at once.
    by_run["socket.bind"].discard("::1")
    assert set().union(*by_run.values(), *by_controller.values()) == {"127.0.0.1"}
    assert {"socket.connect", "socket.bind", "socket.sendto"} <= set(by_run)
    assert {"socket.bind", "socket.sendto"} <= set(by_controller)
    for told in (driven.stdout, driven.stderr, "".join(lines), out, err, file.read_text()):
        assert not holds(told.encode(), "robotics")


def test_another_address_would_be_heard(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(LISTENER)
    script = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('0.0.0.0', 0));"
        "s.connect(('127.0.0.2', 9)); socket.getaddrinfo('localhost', 9)"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "HEARD": str(tmp_path / "heard")}
    subprocess.run([sys.executable, "-c", script], env=environment, timeout=60, check=True)
    found = heard(tmp_path / "heard")
    assert found["socket.bind"] == {"0.0.0.0"}
    assert found["socket.connect"] == {"127.0.0.2"}
    assert found["socket.getaddrinfo"] == {"localhost"}
