"""How long does one fit take: by zerobeam, and by what a user would pick instead, on the same run?

The run is the built-in `good` one: 7 shots of the irb1600, the offsets 2 to 6 and the target unknown.
zerobeam climbs to the posterior's mode, with weights that move with the parameters. The peers are given less
to do: the sum of squares of the priors and of the residuals whitened by the weights of our mode. Each runs
until it stops by itself; its distance from the optimum of that cost is stated in posterior standard
deviations.

The peers get environments of their own, since they want different versions of numpy; without any scipy alone
is compared. Times of GTSAM, pyceres and scipy are mostly those of a cost in Python.

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install --only-binary :all: pyceres pybotics robotkinecal
    python3 -m venv /tmp/jaxes && /tmp/jaxes/bin/pip install --only-binary :all: jax optimistix gtsam pin
    .venv/bin/python benchmarks/fit_time.py --peers /tmp/peers/bin/python --peers /tmp/jaxes/bin/python
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from zerobeam.analysis.estimation.fit import Fits, LikelihoodFit, fit_likelihood, fit_rows, start_at
from zerobeam.experiments.demos import demo_runs
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem

SEED = 1
REACHED = 1e-3  # posterior stds: nearer than this a peer has got to the optimum
PEERS_SIDE = Path(__file__).with_name("fit_peers.py")
SCIPY = ("scipy, 2-point differences", "scipy, exact Jacobians")
ANOTHER_PROBLEM = "robotkinecal"  # it cannot state this one: it knows no beams, no offsets alone, no priors
PEERS = (
    *("pyceres, differences in Python", "pyceres, exact Jacobians", "GTSAM, exact Jacobians"),
    *("optimistix, Levenberg-Marquardt", "Gauss-Newton in JAX, compiled", "pybotics and scipy"),
    ANOTHER_PROBLEM,
)
ALL_RUNS, POSES = "Gauss-Newton in JAX, all runs", "pinocchio"


def ours(problem: Problem) -> LikelihoodFit:
    """One fit as it is compared: to the mode, without further starts."""
    return fit_likelihood(problem, starts=0)


def ours_batch(problem: Problem, joints: Matrix, spots: Matrix) -> Fits:
    """One fit of each of B runs, `joints` (B, N, n) and `spots` (B, N, d), in one call."""
    start = start_at(problem, np.zeros((len(joints), int(problem.parameters.free.sum()))), joints)
    return fit_rows(Density(problem, joints, spots), start)


def the_run() -> Problem:
    run = read_run(next(run.path for run in demo_runs() if run.name == "good"))
    exact = run.header.model_copy(update={"geometry": "exact"})
    return Problem.from_run(dataclasses.replace(run, header=exact))


def noisy_runs(problem: Problem, count: int) -> tuple[Matrix, Matrix]:
    """Joints (B, N, n) and spots (B, N, d) of the run with the stated noise once more on top, B times."""
    rng = np.random.default_rng(SEED)
    return (
        problem.joints + rng.normal(size=(count, *problem.joints.shape)) * problem.noise.joint,
        problem.spots + rng.normal(size=(count, *problem.spots.shape)) * problem.noise.spot,
    )


def shared_optimum(problem: Problem, fit: LikelihoodFit) -> Matrix:
    """(8,) rad and mm: where the cost that the peers are given is least, by Gauss-Newton from our mode."""
    parameters = problem.parameters
    free, x = parameters.free, fit.x.copy()
    mean, std = parameters.prior_mean[free], parameters.prior_std[free]
    for _ in range(10):
        data = problem.whiten(x, fit.whitened.factor)
        residual = np.append(data.residual, (x[free] - mean) / std)
        jacobian = np.vstack([data.jacobian[:, free], np.eye(len(mean))])
        x[free] -= std * np.linalg.lstsq(jacobian, residual)[0]
    return x[free]


def cost_data(problem: Problem, fit: LikelihoodFit, joints: Matrix, spots: Matrix) -> dict[str, Matrix]:
    """What the peers get (see fit_peers.py), the start being the one that zerobeam takes itself."""
    parameters = problem.parameters
    free = parameters.free
    return {
        "joints": problem.joints,
        "spots": problem.spots,
        "factor": fit.whitened.factor,
        "mean": parameters.prior_mean[free],
        "std": parameters.prior_std[free],
        "start": start_at(problem, np.zeros((1, int(free.sum()))))[0, free],
        "mode": fit.x[free],
        "many_joints": joints,
        "many_spots": spots,
    }


def theirs(pythons: list[Path], peer: str, data: dict[str, Matrix], repeat: int) -> dict[str, Any] | None:
    """One peer's optimum `x`, `seconds` of each fit and what it `asked`, in the first environment that has
    it; None, and why is told, if none."""
    single = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    why = "left out: name the python of its environment by --peers"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cost.npz"
        np.savez(file, **data)
        for python in pythons:
            command = [str(python), str(PEERS_SIDE), peer, str(file), str(repeat)]
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, env={**os.environ, **single}
            )
            if done.returncode == 0:
                answer: dict[str, Any] = json.loads(done.stdout.rpartition("answer:")[2])
                return answer
            why = f"it failed: {(done.stderr.strip().splitlines() or ['without a word'])[-1]}"
    print(f"{peer:32s} {why}")
    return None


def timed(call: Callable[[], object], repeat: int) -> list[float]:
    """Seconds of each call, after one that is not counted."""
    call()
    spent = []
    for _ in range(repeat):
        begun = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begun)
    return spent


def compare(problem: Problem, pythons: list[Path], repeat: int, joints: Matrix, spots: Matrix) -> None:
    """One fit by each; then the runs of a batch `joints` (B, N, n) and `spots` (B, N, d) in one call."""
    fit = ours(problem)
    free = problem.parameters.free
    optimum, std = shared_optimum(problem, fit), fit.std * problem.parameters.prior_std[free]
    data, spent = cost_data(problem, fit, joints, spots), timed(lambda: ours(problem), repeat)
    print(f"{'zerobeam':32s} {line(spent)}  {fit.iterations} iterations; {fit.reason}")
    moved = np.abs((optimum - fit.x[free]) / std).max()
    print(f"the optimum of the peers' cost is {moved:.1e} posterior stds from our mode")
    for peer in (*SCIPY, *PEERS):
        answer = theirs([Path(sys.executable)] if peer in SCIPY else pythons, peer, data, repeat)
        if answer is None:
            continue
        told = ", ".join(f"{count} {what}s" for what, count in answer["asked"].items())
        if peer == ANOTHER_PROBLEM:
            end = f"another problem: 30 numbers from whole flange poses, {answer['x'][0]:.0e} mm left"
        else:
            off = np.abs((np.array(answer["x"]) - optimum) / std).max()
            end = f"{told}; {off:.0e} stds off{'' if off < REACHED else ': it did not get there'}"
        print(f"{peer:32s} {line(answer['seconds'], spent)}  {end}")
    fits, spent = ours_batch(problem, joints, spots), timed(lambda: ours_batch(problem, joints, spots), 5)
    print(
        f"{f'zerobeam, {len(joints)} runs in one call':32s} {line(spent)}  {fits.converged.sum()} converged"
    )
    if (answer := theirs(pythons, ALL_RUNS, data, 5)) is not None:
        off = np.abs((np.array(answer["x"]) - fits.x[:, free]) / std).max()
        end = f"at most {off:.0e} stds from ours, whose weights move with each run"
        print(f"{ALL_RUNS:32s} {line(answer['seconds'], spent)}  {end}")
    postures = joints.reshape(-1, joints.shape[-1])
    spent = timed(lambda: problem.robot.pose_and_jacobian(postures), 5)
    print(f"{f'zerobeam, {len(postures)} poses and Jacobians':32s} {line(spent)}")
    if (answer := theirs(pythons, POSES, data, 5)) is not None:
        print(f"{POSES:32s} {line(answer['seconds'], spent)}  {answer['x'][0]:.0e} mm off")


def line(spent: list[float], ours: list[float] | None = None) -> str:
    """Median and best; the ratio is that of the bests, which other work on the machine disturbs least."""
    ratio = "" if ours is None else f" {min(spent) / min(ours):7.1f} times ours"
    return f"{1000 * statistics.median(spent):8.2f} ms (best {1000 * min(spent):.2f}){ratio}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--peers", type=Path, action="append", default=[], help="the python of an environment with peers"
    )
    parser.add_argument("--repeat", type=int, default=30, help="fits timed of each (default 30)")
    parser.add_argument("--batch", type=int, default=1000, help="runs of the batch (default 1000)")
    asked = parser.parse_args()

    with threadpool_limits(limits=1, user_api="blas"):
        problem = the_run()
        compare(problem, asked.peers, asked.repeat, *noisy_runs(problem, asked.batch))


if __name__ == "__main__":
    main()
