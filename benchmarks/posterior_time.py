"""How many effective draws of the posterior a second: by zerobeam, emcee's stock move, and peers in JAX?

For the built-in run of 7 shots (8 unknowns), the one with an uncalibrated tool (11 unknowns) and, if the
recordings are there, panda_2 (559 postures), with nominal links and with uncertain ones, and for simulated
tracker sets of an arm with uncertain links: the smallest bulk ESS of all unknowns, a second and over two
cores, by one function of arviz-stats for all chains; of weighted draws Kish's effective number. All start
from the same Laplace fit and live in coordinates whitened by it; burn-in is counted for zerobeam's chains
alone, compiling for none. Each peer is at its best: NUTS with a chain on each core, HMC with hundreds of
chains side by side and the best of four settings, importance sampling with as heavy tails as zerobeam's. The
peers' log-density, written again in JAX, is first shown to be ours up to a constant; means and variances are
compared afterwards.

    python3 -m venv /tmp/nuts && /tmp/nuts/bin/pip install numpyro blackjax
    .venv/bin/python benchmarks/posterior_time.py --peers /tmp/nuts/bin/python
"""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import emcee
import numpy as np
from analyse_time import ROOT, ball_run
from arviz_stats.base import array_stats
from threadpoolctl import threadpool_limits
from tracker_peers import simulated
from tracker_table import NOISE, header, problem_of

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.posterior.convergence import Weights
from zerobeam.analysis.posterior.sampler import IndependenceProposal, degrees_of_freedom, sample_density
from zerobeam.analysis.posterior.sheet import Whitening
from zerobeam.experiments.demos import demo_runs
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.problem import Problem

SEED = 1
CORES = 2
THREADS = CORES  # of zerobeam's sampler
SAME = 1e-8  # of the range of log-densities
LINKS = (0.3, 0.1)  # tolerances, mm and degrees
TURNOVER = 2  # effective draws of a chain, at least
MANY = 50  # shots: from here a tenth of the effective draws will do
TRACKED = (60, 1000)  # measurements
ROWS = 1000  # of one vectorised call
PEERS_SIDE = Path(__file__).with_name("posterior_peer.py")


class Case:
    """One run, fitted, with the coordinates in which it is sampled."""

    def __init__(self, name: str, run: Path, urdf: str = "", *, links: bool = False) -> None:
        self.urdf, self.links = urdf, links
        read = read_run(run)
        exact = read.header.model_copy(update={"geometry": "exact"})  # as the peers' model is
        problem = Problem.from_run(dataclasses.replace(read, header=exact))
        free = Geometry.of_links(problem.robot, *LINKS)
        self._around(
            name + (", with links" if links else ""), problem.with_geometry(free) if links else problem
        )

    def _around(self, name: str, problem: Problem) -> None:
        """The fit of a problem, and the coordinates whitened by it."""
        self.name, self.problem = name, problem
        self.fit = fit_likelihood(self.problem, starts=0)
        self.density = Density(self.problem)
        self.size = self.density.size
        self._whitening = Whitening(self.density, self.fit.x, self.fit.covariance)

    @property
    def arm_of_peer(self) -> dict[str, Matrix]:
        """What the peer's arm is, and what was read."""
        return {
            "urdf": np.array(self.urdf),
            "links": np.array(self.links),
            "spots": self.problem.spots,
            "target_index": self.problem.target_index,
        }

    def parameters(self, w: Matrix) -> Matrix:
        """x (W, p) of whitened coordinates (W, f)."""
        return self._whitening.parameters(w)

    def log_density(self, w: Matrix) -> Matrix:
        return self.density.log_posterior(self.parameters(w))


class TrackerCase(Case):
    """A simulated set of a tracker, of an arm with uncertain links."""

    def __init__(self, count: int) -> None:
        truth = simulated(np.random.default_rng(SEED), count, NOISE)
        robot = load_robot("irb1600", ROOT)
        self._around(
            f"tracker, {count} measurements", problem_of(header(), robot, truth.joints, truth.measured)
        )

    @property
    def arm_of_peer(self) -> dict[str, Matrix]:
        names = list(self.problem.parameters.names)
        thirds = ("d", "beta", "d", "d", "d")  # the axes of joints 2 and 3 are parallel
        links = [
            names.index(f"link{i}.{axis}")
            for i, third in enumerate(thirds, start=1)
            for axis in ("a", "alpha", third)
        ]
        return {
            "tracker": np.array(True),
            "links": np.array(links),
            "spots": self.problem.readings[:, :3],
        }


class Found(NamedTuple):
    """What one sampler left: scaled draws (chains, steps, f) and the seconds that they took; of weighted
    ones ln of the weights (chains * steps,)."""

    draws: Matrix
    seconds: float
    log_weights: Matrix | None = None

    def ess(self) -> float:
        """The smallest bulk ESS of all unknowns; of weighted draws Kish's number."""
        if self.log_weights is not None:
            return Weights.of(self.log_weights).share * self.count
        return min(float(array_stats.ess(chain, method="bulk")) for chain in self.draws.transpose(2, 0, 1))

    def moments(self) -> dict[str, tuple[Matrix, Matrix]]:
        """Means and variances of the unknowns, each with its Monte Carlo standard error. Of chains alone.

        A variance is the mean of squares: their own autocorrelation counts, which for NUTS is another than
        that of the draws (arviz-stats' error of a std takes that of the draws).
        """
        squares = (self.draws - self.draws.mean(axis=(0, 1))) ** 2
        return {
            name: (
                values.mean(axis=(0, 1)),
                np.array([float(array_stats.mcse(v, method="mean")) for v in values.transpose(2, 0, 1)]),
            )
            for name, values in (("means", self.draws), ("variances", squares))
        }

    @property
    def count(self) -> int:
        return self.draws.shape[0] * self.draws.shape[1]


def ours(case: Case, ess: float) -> Found:
    """zerobeam's sampler, burn-in included; its looks at R-hat and ESS are apart, as the others' are."""
    proposal = IndependenceProposal(np.zeros(case.size), np.eye(case.size), degrees_of_freedom(case.size))
    sampled = sample_density(case.log_density, proposal, seed=SEED, ess=ess, threads=THREADS)
    print(f"  zerobeam's own looks at the diagnostics: {sampled.looking:.2f} s, not counted")
    return Found(scaled_chains(case, sampled.values.reshape(-1, *sampled.values.shape[2:])), sampled.seconds)


def scaled_chains(case: Case, w: Matrix) -> Matrix:
    return case.density.scaled(case.parameters(w.reshape(-1, case.size))).reshape(w.shape)


def stretch(case: Case, walkers: int, seconds: float) -> Found:
    """emcee as it comes, vectorised, for about `seconds`: an ensemble on each core, started from the fit."""

    def ensemble(seed: int, answer: multiprocessing.connection.Connection) -> None:
        random = np.random.RandomState(seed)
        sampler = emcee.EnsembleSampler(walkers, case.size, case.log_density, vectorize=True)
        start = emcee.State(random.randn(walkers, case.size), random_state=random.get_state())
        begun = time.perf_counter()
        start = sampler.run_mcmc(start, 20)
        steps = int(20 * seconds / (time.perf_counter() - begun))
        sampler.reset()
        begun = time.perf_counter()
        sampler.run_mcmc(start, steps)
        answer.send((time.perf_counter() - begun, sampler.get_chain().transpose(1, 0, 2)))

    forked = multiprocessing.get_context("fork")
    pipes = [forked.Pipe(duplex=False) for _ in range(CORES)]
    for k, (_, inlet) in enumerate(pipes):
        forked.Process(target=ensemble, args=(SEED + k, inlet)).start()
    answers = [outlet.recv() for outlet, _ in pipes]
    steps = min(chain.shape[1] for _, chain in answers)
    chains = np.concatenate([chain[:, :steps] for _, chain in answers])
    return Found(scaled_chains(case, chains), max(spent for spent, _ in answers))


def weighed(case: Case, seconds: float) -> Found:
    """Independent draws of zerobeam's own proposal on its own kernel, weighted, for about `seconds`."""
    random = np.random.default_rng(SEED)
    proposal = IndependenceProposal(np.zeros(case.size), np.eye(case.size), degrees_of_freedom(case.size))
    drawn, log_weights = [], []
    begun = time.perf_counter()
    with ThreadPoolExecutor(THREADS) as pool:
        while time.perf_counter() - begun < seconds or len(drawn) < THREADS:
            some = [proposal.draw(ROWS, random) for _ in range(THREADS)]
            drawn += some
            log_weights += pool.map(lambda w: case.log_density(w) - proposal.log_density(w), some)
    spent = time.perf_counter() - begun
    return Found(scaled_chains(case, np.concatenate(drawn)[None]), spent, np.concatenate(log_weights))


def peers(case: Case, python: Path, warmup: int, draws: int) -> dict[str, Found]:
    """What each peer left, after their density was compared with ours; none, and why is told, if it fails."""
    problem, factor = case.problem, np.linalg.cholesky(case.fit.covariance)
    parameters, distances = problem.parameters, problem.distances
    points = case.parameters(2 * np.random.default_rng(SEED).normal(size=(20, case.size)))
    model = {
        **case.arm_of_peer,
        "joints": problem.joints,
        "variances": problem.noise.variances,
        "mean": parameters.prior_mean,
        "std": parameters.prior_std,
        "free": np.flatnonzero(parameters.free),
        "pairs": np.array([(d.first, d.second) for d in distances], dtype=int).reshape(-1, 2),
        "apart": np.array([d.mm for d in distances]),
        "apart_sigma": np.array([d.sigma for d in distances]),
        "centre": case.fit.z,
        "factor": factor,
        "points": case.density.scaled(points),
        "settings": np.array([CORES, warmup, draws, SEED]),
    }
    with tempfile.TemporaryDirectory() as folder:
        given, answered = Path(folder) / "model.npz", Path(folder) / "answer.npz"
        np.savez(given, **model)
        command = [str(python), str(PEERS_SIDE), str(given), str(answered)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"  the peers failed: {(done.stderr.strip().splitlines() or ['without a word'])[-1]}")
            return {}
        answer = dict(np.load(answered))
    own = case.density.log_posterior(points)
    off = np.ptp(own - answer.pop("checked")) / np.ptp(own)
    if off >= SAME:
        raise SystemExit(
            f"the log-density in JAX is not ours: off by {off:.0e} of its range, so nothing is compared"
        )
    print(f"  log-density in JAX at {len(points)} points: ours up to a constant, {off:.0e} of its range")
    parts: dict[str, dict[str, Matrix]] = {}
    for key, part in answer.items():
        name, _, what = key.partition("|")
        parts.setdefault(name, {})[what] = part
    return {name: Found(p["z"], float(p["seconds"]), p.get("log_weights")) for name, p in parts.items()}


def bare_loop_seconds(case: Case, x: np.ndarray) -> float | None:
    """A call of the kernel's C function alone, its arguments ready: its loop over rows and shots is in C."""
    kernel = case.problem.functions.kernel("terms", compile=True)
    if not kernel.compiled:
        return None
    inputs = case.density._grid(x, None)
    call, _ = kernel.ready(inputs, len(x), case.problem.shots)
    return fastest(call)


def fastest(call: Callable[[], object], repeat: int = 20) -> float:
    """Seconds of the fastest call."""
    spent = []
    for _ in range(repeat):
        begun = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begun)
    return min(spent)


def measure(case: Case, python: Path | None, ess: float, seconds: float, draws: int) -> None:
    print(f"{case.name}: {case.problem.shots} shots, {case.size} unknowns")
    w = np.random.default_rng(SEED).normal(size=(ROWS, case.size))
    x = case.parameters(w)
    likelihood = fastest(lambda: case.density.log_likelihood(x)) / ROWS
    density = fastest(lambda: case.log_density(w)) / ROWS
    bare = bare_loop_seconds(case, x)
    told_bare = "no compiler"
    if bare is not None:
        told_bare = f"{1e6 * bare / ROWS:.2f} µs, {likelihood * ROWS / bare:.2f} times"
    print(
        f"  one core, {ROWS} rows a call: log-likelihood {1e6 * likelihood:.2f} µs ({1 / likelihood:,.0f} a"
        f" second), with coordinates and priors {1e6 * density:.2f} µs; bare loop over the C function:"
        f" {told_bare}"
    )
    found = ours(case, ess if case.problem.shots < MANY else ess / 10)
    least = told("zerobeam", found)
    rate, tau = least / found.seconds, found.count / least
    bound = CORES / likelihood / tau
    print(f"    bound by the kernel on {CORES} cores: {bound:,.0f} a second, of which {rate / bound:.0%}")
    for walkers in dict.fromkeys((max(64, 2 * case.size + 2), 1000)):
        told(f"emcee, stretch move, {walkers} walkers", stretch(case, walkers, seconds), rate)
    told("zerobeam, importance sampling", weighed(case, seconds / 2), rate)
    if python is None:
        print("  peers left out: name the python of their environment by --peers")
        return
    draws = draws if case.problem.shots < MANY else draws // 8
    left = peers(case, python, draws // 4 if draws > 2000 else draws // 2, draws)
    for name, peer in left.items():
        told(name, peer, rate)
    if not left:
        return
    peer = max(
        (peer for peer in left.values() if peer.log_weights is None),
        key=lambda peer: peer.ess() / peer.seconds,
    )
    for (name, (own, own_error)), (theirs, error) in zip(
        found.moments().items(), peer.moments().values(), strict=True
    ):
        z = np.abs(own - theirs) / np.hypot(own_error, error)
        print(f"    {name} of the {case.size} unknowns: at most {z.max():.1f} standard errors from ours")


def told(name: str, found: Found, ours: float | None = None) -> float:
    """Print a sampler's line, `ours` being our effective draws a second; its effective draws."""
    least = found.ess()
    rate = least / found.seconds
    print(
        f"  {name}: ESS {least:,.0f} of {found.count:,} draws (tau {found.count / least:.1f}) in"
        f" {found.seconds:.2f} s: {rate:,.0f} a second"
        + ("" if ours is None else f"; zerobeam's chains {ours / rate:,.2g} times")
        + ("" if found.log_weights is None else f"; Pareto k {Weights.of(found.log_weights).pareto_k:.2f}")
        # Chains that have hardly moved count for as much as their starts, drawn from the fit, were worth.
        + (": too few for so many chains to be believed" if least < TURNOVER * len(found.draws) else ""),
        flush=True,
    )
    return least


def cases(folder: Path) -> Iterator[Case]:
    for run in demo_runs():
        if run.name != "x-pattern":  # there is nothing to sample but priors
            yield Case(run.title, run.path)
        if run.name == "good":
            yield Case(run.title, run.path, links=True)
    for count in TRACKED:
        yield TrackerCase(count)
    data = Path(os.environ.get("ZEROBEAM_SHARED_DATA", ROOT.parent / "shared" / "data")).resolve()
    if (data / "mukca" / "panda_2").is_dir():
        for links in (False, True):
            yield Case(
                "panda_2", ball_run(data, "panda_2", folder), str(data / "mukca/urdf/panda.urdf"), links=links
            )
    else:
        print(f"panda_2 left out: there is no mukca/panda_2 in {data}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peers", type=Path, help="the python of an environment with numpyro and blackjax")
    parser.add_argument("--ess", type=float, default=50_000.0, help="asked of zerobeam (default 50,000)")
    parser.add_argument("--seconds", type=float, default=10.0, help="for emcee's stock move (default 10)")
    parser.add_argument("--draws", type=int, default=4000, help="of each chain of NUTS (default 4000)")
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    asked = parser.parse_args()
    with threadpool_limits(limits=1, user_api="blas"), tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder)):
            if asked.only in case.name:
                measure(case, asked.peers, asked.ess, asked.seconds, asked.draws)


if __name__ == "__main__":
    main()
