"""What do zerobeam, pybotics, robotkinecal and pyceres make of the same tracker measurements?

Simulated sets with truth: an IRB 1600 that deviates by the typical tolerances (links 0.3 mm and 0.1°, offsets
1°), one reflector, a free frame; 60 measurements, joints to 0.002° and coordinates to
0.05 mm, as stated to all. Errors are at 200 held-out postures, against where the reflector really is. In the
degenerate set joints 3 to 6 never move. On the UR10's series A, if it is there, one sixth of the measurements
is predicted by another sixth. Times are core seconds of a fit, imports not counted, all in one run.

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install --only-binary :all: pyceres pybotics robotkinecal
    .venv/bin/python benchmarks/tracker_table.py --peers /tmp/peers/bin/python
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tracker_peers
from threadpoolctl import threadpool_limits

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.solution import Solution
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Problem

ROOT = Path(__file__).resolve().parents[1]
SEED = 1
COUNT = 60
NOISE = (float(np.radians(0.002)), 0.05)
EXACT = (1e-9, 1e-6)  # stated of data without noise: the priors weigh nothing
STILL = (2, 3, 4, 5)
LARGE = 1000
FEW = {"pybotics": 2}  # arms, where a fit takes long
COMPARED = slice(1, 5)  # joint 1 and the frame, joint 6 and the reflector are one
PEERS_SIDE = Path(__file__).with_name("tracker_peers.py")
UR10 = np.array(
    [
        (0, 90, 127.3, 0),
        (-612, 0, 0, 0),
        (-572.3, 0, 0, 0),
        (0, 90, 163.941, 0),
        (0, -90, 115.7, 0),
        (0, 0, 92.2, 0),
    ]
) * [1, np.pi / 180, 1, np.pi / 180]
UR10_SIGMA = 0.35  # mm: what the series leaves of any model, so that the peers' priors have their weight
UR10_NOISE = 0.01  # degrees, as stated to zerobeam, which estimates the factor


@dataclass(frozen=True)
class Answer:
    """What one program makes of a set, in the units of tracker_peers.py."""

    positions: Matrix
    offsets: Matrix | None
    std: Matrix | None
    says: str
    seconds: float


def header(noise: tuple[float, float] = NOISE, **geometry: Any) -> Header:
    """Links estimated, no gravity or harmonics: what the simulated arms deviate by."""
    content = {
        "robot": "irb1600",
        "instruments": {
            "leica": {"kind": "tracker", "frame": "free", "sigma_mm": noise[1], "reflectors": {"R1": {}}}
        },
        "noise": {"joint_deg": float(np.degrees(noise[0]))},
        "geometry": {"gravity": False, "harmonics": False, **geometry},
    }
    return Header.model_validate(content)


def measurements(positions: Matrix) -> list[list[Measurement]]:
    """One of the reflector at each posture, (N, 3) mm in the tracker's frame."""
    return [[Measurement("leica", "R1", None, {"measured_mm": tuple(row)})] for row in positions.tolist()]


def problem_of(stated: Header, robot: Robot, joints: Matrix, positions: Matrix) -> Problem:
    return Problem.of_measured(stated, robot, joints, measurements(positions))


def answer_of(solution: Solution, stated: Header, held_joints: Matrix, seconds: float) -> Answer:
    """Held-out positions, offsets and stds of a solution; nan where it states no number."""
    held = solution.problem.recorded_at(
        held_joints, measurements(np.zeros((len(held_joints), 3))), range(len(held_joints)), stated
    )
    rows = list(solution.offsets)
    known = [row.std is not None for row in rows]
    names = [row.name for row in rows if row.status == "unidentifiable"]
    return Answer(
        held.linearise(solution.fit.x)[0],
        np.radians([row.estimate if one else np.nan for row, one in zip(rows, known, strict=True)]),
        np.radians([row.std if one else np.nan for row, one in zip(rows, known, strict=True)]),
        f"{solution.verdict}; unidentifiable: {', '.join(names) or 'none'}",
        seconds,
    )


def ours(problem: Problem, stated: Header, held_joints: Matrix) -> Answer:
    """The whole model ladder with its verdict, in a warm process."""
    begun = time.process_time()
    solution = solve_run(problem, stated)
    return answer_of(solution, stated, held_joints, time.process_time() - begun)


def departures(truth: tracker_peers.Truth, positions: Matrix) -> dict[str, float]:
    """By how much the free parameters of arm and reflector, fitted to positions without noise, are off, rad
    and mm, by name."""
    stated = header(EXACT)
    problem = problem_of(stated, load_robot("irb1600", ROOT), truth.joints, positions)
    rows, reflector = truth.x[:24].reshape(6, 4), truth.x[30:]
    right = {f"leica.R1.{axis}": float(value) for axis, value in zip("xyz", reflector, strict=True)}
    for i, row in enumerate(rows, start=1):
        names = (f"link{i}.a", f"link{i}.alpha", f"link{i}.d", f"delta{i}")
        right |= {f"link{i}.beta": 0.0} | dict(zip(names, row.tolist(), strict=True))
    fitted = fit_likelihood(problem, starts=0).x.tolist()
    free = zip(problem.parameters.names, fitted, problem.parameters.free, strict=True)
    return {name: value - right[name] for name, value, is_free in free if is_free and name in right}


def theirs(
    python: Path, peer: str, rows: Matrix, sets: Sequence[tuple[Matrix, ...]], noise: tuple[float, float]
) -> list[Answer] | None:
    """One peer's answers to `sets` of joints, measured positions and held-out joints; None if it fails."""
    joints, measured, held_joints = (np.array(part) for part in zip(*sets, strict=True))
    data = {"joints": joints, "measured": measured, "held_joints": held_joints}
    answers = peers_side(python, peer, rows=rows, noise=np.array(noise), **data)
    if answers is None:
        return None
    return [
        Answer(
            np.array(one["positions"]),
            None if one["offsets"] is None else np.array(one["offsets"]),
            None if one["std"] is None else np.array(one["std"]),
            one["says"],
            one["seconds"],
        )
        for one in answers
    ]


def peers_side(python: Path, what: str, **data: Matrix) -> Any:
    """What tracker_peers.py prints; None, with the reason printed, if it fails."""
    single = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "data.npz"
        np.savez(file, **data)
        command = [str(python), str(PEERS_SIDE), what, str(file)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env={**os.environ, **single}
        )
    if done.returncode:
        print(f"{what:14s} it failed: {(done.stderr.strip().splitlines() or ['without a word'])[-1]}")
        return None
    return json.loads(done.stdout.rpartition("answers:")[2])


def rms(errors: Matrix) -> float:
    """Of the lengths of vectors (N, 3)."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


def line(
    name: str, answers: Sequence[Answer], truths: Sequence[tracker_peers.Truth], yardstick: float
) -> str:
    """A row of the table: errors of positions and offsets, coverage of 95 % intervals, time."""
    errors = np.array([a.positions - t.held for a, t in zip(answers, truths, strict=True)])
    cells = [f"{rms(errors):.3f} mm"]
    offsets, covered = "none", "states none"
    if all(a.offsets is not None for a in answers):
        off = np.array([(a.offsets - t.x[3:24:4])[COMPARED] for a, t in zip(answers, truths, strict=True)])
        offsets = f"{np.degrees(np.sqrt(np.nanmean(off**2))):.4f}°"
        if all(a.std is not None for a in answers):
            within = np.abs(off) < 1.96 * np.array([a.std[COMPARED] for a in answers if a.std is not None])
            covered = f"{within[~np.isnan(off)].mean():.0%} of {(~np.isnan(off)).sum()}"
    seconds = float(np.median([a.seconds for a in answers]))
    return " | ".join(
        [f"{name:14s}", *cells, offsets, covered, f"{seconds:.3f} s", f"{seconds / yardstick:.1f}"]
    )


def simulated_table(python: Path | None, count: int, *, beta: bool) -> None:
    """Sets of arms whose parallel axes are tilted about y by `beta`, which DH rows cannot state, or not."""
    rng = np.random.default_rng(SEED)
    truths = [tracker_peers.simulated(rng, COUNT, NOISE, beta=beta) for _ in range(count)]
    robot, stated = load_robot("irb1600", ROOT), header()
    problems = [problem_of(stated, robot, one.joints, one.measured) for one in truths]
    ours(problems[0], stated, truths[0].held_joints)  # kernels are compiled
    answers = [ours(p, stated, one.held_joints) for p, one in zip(problems, truths, strict=True)]
    fits = [fit_seconds(problem) for problem in problems]
    yardstick = float(np.median([a.seconds for a in answers]))
    print(f"{count} simulated arms, parallel axes {'tilted' if beta else 'as nominal'}:")
    print("held-out rms | offsets 2 to 5, rms | 95 % intervals that hold | core | ratio")
    print(line("zerobeam", answers, truths, yardstick), f"| the fit alone {np.median(fits):.3f} s")
    for peer in tracker_peers.PEERS if python else ():
        some = truths[: FEW.get(peer, count)]
        sets = [(one.joints, one.measured, one.held_joints) for one in some]
        answered = theirs(python, peer, tracker_peers.IRB1600, sets, NOISE)
        if answered is not None:
            row = line(peer, answered, some, yardstick)
            print(row, "|", answered[0].says, f"| {len(some)} arms", flush=True)


def degenerate_lines(python: Path | None) -> None:
    """What is said of a set in which joints never move."""
    truth = tracker_peers.simulated(np.random.default_rng(SEED), COUNT, NOISE, still=STILL, beta=False)
    stated = header()
    problem = problem_of(stated, load_robot("irb1600", ROOT), truth.joints, truth.measured)
    answers = {"zerobeam": ours(problem, stated, truth.held_joints)}
    for peer in tracker_peers.PEERS if python else ():
        sets = [(truth.joints, truth.measured, truth.held_joints)]
        answered = theirs(python, peer, tracker_peers.IRB1600, sets, NOISE)
        if answered is not None:
            (answers[peer],) = answered
    print(f"joints {', '.join(str(k + 1) for k in STILL)} never move:")
    for name, one in answers.items():
        std = "none" if one.std is None else np.array2string(np.degrees(one.std), precision=3)
        print(f"  {name:14s} {one.says}; stds of the offsets, deg: {std}")


def fit_seconds(problem: Problem) -> float:
    """Core seconds of the fit alone, from one start."""
    begun = time.process_time()
    fit_likelihood(problem, starts=0)
    return time.process_time() - begun


def large_line(python: Path) -> None:
    """The fit of many measurements, next to pyceres' with exact Jacobians."""
    truth = tracker_peers.simulated(np.random.default_rng(SEED), LARGE, NOISE, beta=False)
    problem = problem_of(header(), load_robot("irb1600", ROOT), truth.joints, truth.measured)
    fit_seconds(problem)
    spent = min(fit_seconds(problem) for _ in range(5))
    sets = [(truth.joints, truth.measured, truth.held_joints)] * 5
    answers = theirs(python, "pyceres", tracker_peers.IRB1600, sets, NOISE)
    if answers is not None:
        peer = min(one.seconds for one in answers)
        print(f"{LARGE} measurements, the best of 5: zerobeam's fit {spent:.3f} s, pyceres {peer:.3f} s,"
              f" {peer / spent:.1f} times ours")  # fmt: skip


def exact_line(python: Path) -> None:
    """Positions that pybotics simulates without noise: its parameters come back."""
    truth = tracker_peers.simulated(np.random.default_rng(SEED), COUNT, (0.0, 0.0), beta=False)
    model = truth.model
    arm = {"rows": model.rows, "turn": model.turn, "shift": model.shift, "x": truth.x, "joints": truth.joints}
    positions = peers_side(python, "arm", **arm)
    if positions is not None:
        off = departures(truth, np.array(positions))
        worst = max(off, key=lambda name: abs(off[name]))
        print(f"simulated by pybotics without noise: {len(off)} parameters are off by"
              f" {abs(off[worst]):.0e} at most ({worst}; rad, mm)")  # fmt: skip


def ur10_table(python: Path | None, data: Path) -> None:
    """Every sixth measurement by those three further."""
    with tempfile.TemporaryDirectory() as folder:
        whole = read_run(imported(data, Path(folder)))
    positions = np.array([one.measured["measured_mm"] for one in whole.measurements])
    train, test = slice(0, None, 6), slice(3, None, 6)
    problem = problem_of(whole.header, whole.robot, whole.joints[train], positions[train])
    ours(problem, whole.header, whole.joints[test])
    mine = ours(problem, whole.header, whole.joints[test])
    print(f"UR10, {problem.shots} measurements predict {len(positions[test])}: rms | core | ratio")
    noise = float(np.radians(UR10_NOISE)), UR10_SIGMA
    answers = {"zerobeam": mine}
    sets = [(whole.joints[train], positions[train], whole.joints[test])]
    for peer in tracker_peers.PEERS if python else ():
        answer = theirs(python, peer, UR10, sets, noise)
        if answer is not None:
            (answers[peer],) = answer
    start = tracker_peers.started(UR10, *sets[0], np.array(noise))
    nominal = start.model.positions(whole.joints[test], start.start)
    print(f"{'nominal links':14s} {rms(nominal - positions[test]):.3f} mm")
    for name, one in answers.items():
        left = rms(one.positions - positions[test])
        ratio = one.seconds / mine.seconds
        print(f"{name:14s} {left:.3f} mm | {one.seconds:.2f} s | {ratio:.1f} | {one.says}")


def imported(data: Path, folder: Path, series: str = "grid_every_eighth.csv") -> Path:
    """The run that `import points` makes of a series: A, or B (joint_configurations.csv)."""
    limits = "theta_deg: 0, lower_deg: -360, upper_deg: 360"
    rows = [
        f"  - {{a_mm: {a}, alpha_deg: {round(np.degrees(alpha))}, d_mm: {d}, {limits}}}"
        for a, alpha, d, _ in UR10
    ]
    (folder / "ur10.yaml").write_text(
        "\n".join(["schema: zerobeam/robot/1", "name: UR10", "convention: standard", "joints:", *rows]) + "\n"
    )
    (folder / "header.yaml").write_text(
        "robot: ur10.yaml\n"
        "instruments: {leica: {kind: tracker, frame: free, sigma_mm: 0.05, reflectors: {R1: {}}}}\n"
        f"noise: {{joint_deg: {UR10_NOISE}, scale: estimated}}\n"
        "geometry: {gravity: true, harmonics: true}\n"
    )
    names = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    columns = ",".join(f"measurement_{axis}" for axis in "xyz")
    command = [
        str(Path(sys.executable).with_name("zerobeam")), "import", "points", str(data / "ipa" / series),
        "--header", str(folder / "header.yaml"), "--joint-columns", ",".join(f"{n}_joint" for n in names),
        "--joint-units", "rad", "--columns", columns, "--units", "mm", "--uncertainty", "none",
        "--decimal", ",", "-o", str(folder / f"{Path(series).stem}.jsonl"),
    ]  # fmt: skip
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return folder / f"{Path(series).stem}.jsonl"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peers", type=Path, help="the python of an environment with the peers")
    parser.add_argument("--sets", type=int, default=10, help="simulated sets (default 10)")
    wanted = parser.parse_args()
    if wanted.peers is None:
        print("the peers are left out: name the python of their environment by --peers")
    data = Path(os.environ.get("ZEROBEAM_SHARED_DATA", ROOT.parent / "shared" / "data")).resolve()
    with threadpool_limits(limits=1, user_api="blas"):
        for beta in (False, True):
            simulated_table(wanted.peers, wanted.sets, beta=beta)
        degenerate_lines(wanted.peers)
        if wanted.peers is not None:
            large_line(wanted.peers)
            exact_line(wanted.peers)
        if (data / "ipa").is_dir():
            ur10_table(wanted.peers, data)
        else:
            print(f"UR10 left out: there is no ipa in {data}")


if __name__ == "__main__":
    main()
