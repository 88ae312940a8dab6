"""Do the intervals hold what they promise? Coverage and simulation-based calibration over simulated runs.

Every data set has a truth of its own, drawn from the priors, and is solved again: by the likelihood fit, by
the paper's midpoint fit with its sandwich covariance, and by its posterior. An interval of 95 % must hold
the truth in 95 % of the data sets, and the truth must rank evenly among the posterior's draws (Talts et al.
2018). Two wrong ways are carried along, for a check that never fails checks nothing.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from ...analysis.estimation.coordinates import SeenCoordinates
from ...analysis.estimation.fit import Fits, fit_rows, modes, start_at
from ...analysis.estimation.midpoint import fit_midpoints
from ...analysis.observability.identifiability import identify
from ...analysis.posterior.moves import (
    DifferentialMove,
    IndependenceMove,
    IndependenceProposal,
    degrees_of_freedom,
)
from ...analysis.status import versions
from ...model.density import Density
from ...model.files.header import Header
from ...model.files.robot_file import load_robot
from ...model.kernel import Index
from ...model.parameters import Parameters
from ...model.problem import Problem
from ...model.robot import Matrix
from ...reports.words.wording import listed
from ..plans.candidates import candidates
from ..plans.optimal import Planner
from ..plans.patterns import pattern
from ..simulate import simulated_readings
from .binomial import accuracy, held_share, nothing_known
from .case_store import each_case

_TARGET, _SIGMA_MM = (950.0, 150.0, 100.0), 30.0
_SHOTS, _CANDIDATES, _SHORT = 7, 2000, 0.4
_HEADER = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": list(_TARGET), "sigma_mm": _SIGMA_MM}},
}

LEVELS = (0.5, 0.9, 0.95, 0.99)
DRAWS = 199  # of each posterior: the levels above are then exact by ranks
BINS = 20
_STARTS = 4
_ROUND = 15  # steps of each walker before the proposal is fitted anew,
_REFITS, _GOOD = 4, 0.5  # so often at most, while less than this is accepted;
_ENOUGH, _MOST_STEPS = 10.0, 400  # then so many over the square of the acceptance, and at most
_WIDER = 1.3  # a refitted proposal is so much wider than the walkers' spread,
_HEAVY = 5.0  # and its nu this: for the tails
_DIFFERENTIAL = 0.4  # share of the steps
_CHUNK = 50  # data sets whose walkers go together: what a core keeps near
_CHANCE = 0.01  # of a false alarm over all levels and parameters of an estimator
_FURTHER = 3.0  # how often more truths are drawn than needed, should some not be met
_PINV = 1e-12  # of J'J: directions below 1e-6 of the largest singular value are dropped, as is customary

Progress = Callable[[str, float], None]  # the plan, and the share of the whole that is done


@dataclass(frozen=True, eq=False)
class DataSets:
    """W simulated runs of one plan: `truths` (W, p) and what was recorded; `failed` were not to be met."""

    problem: Problem
    truths: Matrix
    joints: Matrix
    spots: Matrix
    failed: int


@dataclass(frozen=True, eq=False)
class Estimates:
    """Of the offsets `which` (m,): estimates and stds (W, m), internal units; rows that did not converge are
    left out of both, `kept` (W,) says which stayed."""

    name: str
    words: str
    control: bool
    value: Matrix
    std: Matrix
    kept: NDArray[np.bool_]


def drawn(problem: Problem, count: int, rng: np.random.Generator) -> DataSets:
    """Truths from the priors, and one run of the problem's postures with each."""
    parameters = problem.parameters
    truths = np.empty((0, len(parameters)))
    joints, spots, tried = [], [], 0
    while len(truths) < count and tried < _FURTHER * count:
        some = count - len(truths)
        x = np.tile(parameters.prior_mean, (some, 1))
        x += np.where(parameters.free, rng.normal(size=x.shape) * parameters.prior_std, 0.0)
        found = simulated_readings(problem, x, rng)
        truths = np.vstack([truths, x[found.met]])
        joints.append(found.joints[found.met])
        spots.append(found.spots[found.met])
        tried += some
    return DataSets(problem, truths, np.concatenate(joints), np.concatenate(spots), tried - len(truths))


def fitted(data: DataSets) -> Fits:
    """The likelihood fit of every data set, in one call: the best of a few starts, as for a single run."""
    problem, count = data.problem, len(data.joints)
    density = Density(problem, data.joints, data.spots)
    rng = np.random.default_rng(count)
    z = np.concatenate([np.zeros((1, density.size)), rng.normal(size=(_STARTS - 1, density.size))])
    of = np.tile(np.arange(count), _STARTS)
    found = modes(density, start_at(problem, np.repeat(z, count, axis=0), data.joints[of]), of)
    cost = np.where(found.converged, found.cost, np.inf).reshape(_STARTS, count)
    best = np.argmin(cost, axis=0) * count + np.arange(count)
    return fit_rows(density, found.x[best])


def likelihood(data: DataSets, fits: Fits, which: NDArray[np.intp]) -> Estimates:
    """The intervals from the curvature at the modes."""
    words = "likelihood fit, intervals from the curvature"
    return _of_fits("likelihood", words, False, data.problem.parameters, fits, which)


def understated(data: DataSets, which: NDArray[np.intp]) -> Estimates:
    """Control: the likelihood fit with half of the true noise."""
    noise = data.problem.noise
    half = replace(data.problem, noise=replace(noise, joint=noise.joint / 2, spot=noise.spot / 2))
    fits = fitted(replace(data, problem=half))
    words = "control: the noise stated as half of what it is"
    return _of_fits("noise understated by 2", words, True, half.parameters, fits, which)


def midpoint(data: DataSets, which: NDArray[np.intp]) -> Estimates:
    """The paper's cost (eq. 8) with the sandwich covariance."""
    fits = fit_midpoints(data.problem, data.joints)
    at = (np.cumsum(fits.free) - 1)[which]  # the targets are no part of this fit
    variance = np.diagonal(fits.covariance, axis1=1, axis2=2)[:, at]
    std = np.sqrt(variance) * data.problem.parameters.prior_std[which]
    words = "midpoint fit of the paper (eq. 8), intervals from its sandwich covariance"
    return Estimates("midpoint", words, False, fits.x[:, which], std, fits.converged)


def pseudo_inverse(data: DataSets, fits: Fits, which: NDArray[np.intp]) -> Estimates:
    """Control: the same estimates with the covariance pinv(J'J), as truncating solvers give it."""
    problem, free = data.problem, data.problem.parameters.free
    at = problem.parameters.among_free[which]
    scale = problem.parameters.prior_std
    std = np.empty((len(fits.x), len(which)))
    for row, (x, joints, spots) in enumerate(zip(fits.x, data.joints, data.spots, strict=True)):
        jacobian = problem.moved(joints, spots).whiten(x).jacobian[:, free]
        std[row] = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian, rcond=_PINV, hermitian=True))[at])
    words = "control: the same fit with a pseudo-inverse for a covariance"
    return Estimates(
        "pseudo-inverse covariance", words, True, fits.x[:, which], std * scale[which], fits.converged
    )


def posterior_draws(
    data: DataSets, fits: Fits, rng: np.random.Generator, tell: Callable[[float], None]
) -> tuple[Matrix, float]:
    """(W, DRAWS, f) draws of the scaled free parameters of every data set, and the mean acceptance.

    One walker for each draw, moved by emcee with the moves of `sample_posterior`, from the same fit, in the
    same coordinates and on the same density; its last place is the draw.
    """
    count = len(fits.x)
    parts = [np.arange(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        jobs = [
            pool.submit(_drawn_together, data, fits, part, own)
            for part, own in zip(parts, rng.spawn(len(parts)), strict=True)
        ]
        found = []
        for done, job in enumerate(jobs):
            found.append(job.result())
            tell((done + 1) / len(jobs))
    draws, acceptance = zip(*found, strict=True)
    return np.concatenate(draws), float(np.average(acceptance, weights=[len(part) for part in parts]))


def _drawn_together(
    data: DataSets, fits: Fits, part: Index, rng: np.random.Generator
) -> tuple[Matrix, float]:
    import emcee

    density = Density(data.problem, data.joints[part], data.spots[part])
    size, count = density.size, len(part)
    every = np.arange(count)
    coordinates = SeenCoordinates(density)
    centre = coordinates.from_parameters(fits.x[part], every)
    factor = np.linalg.cholesky(coordinates.covariance(fits.x[part], fits.covariance[part], every))

    def place(w: Matrix) -> Matrix:
        """v (count, …, f) of walkers (count * …, f): as many of each data set, one set after the other."""
        return np.asarray(centre[:, None] + w.reshape(count, -1, size) @ factor.transpose(0, 2, 1))

    def log_density(w: Matrix) -> Matrix:
        of = np.repeat(every, len(w) // count)
        return density.log_posterior(coordinates.to_parameters(place(w).reshape(-1, size), of), of)

    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    independence, differential = IndependenceMove(proposal, rng), DifferentialMove(rng, groups=count)
    w = proposal.draw(count * DRAWS, rng)

    def advanced(w: Matrix, steps: int) -> Matrix:
        sampler = emcee.EnsembleSampler(
            count * DRAWS,
            size,
            log_density,
            moves=[(independence, 1 - _DIFFERENTIAL), (differential, _DIFFERENTIAL)],
            vectorize=True,
        )
        sampler.random_state = np.random.RandomState(rng.integers(2**32)).get_state()
        state = emcee.State(w, log_prob=log_density(w))
        for moved in sampler.sample(state, iterations=steps, store=False, skip_initial_state_check=True):
            state = moved
        return np.asarray(state.coords)

    w = advanced(w, _ROUND)
    for _ in range(_REFITS):
        if independence.accepted >= _GOOD * independence.proposed:
            break
        # The whitening, and with it the proposal, is fitted anew to where the walkers are.
        v = place(w)
        centre = v.mean(axis=1)
        around = v - centre[:, None]
        factor = _WIDER * np.linalg.cholesky(around.transpose(0, 2, 1) @ around / (DRAWS - 1))
        independence.proposal = IndependenceProposal(np.zeros(size), np.eye(size), _HEAVY)
        w = np.linalg.solve(factor, around.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(-1, size)
        independence.accepted = independence.proposed = 0
        w = advanced(w, _ROUND)
    acceptance = independence.accepted / independence.proposed
    v = place(advanced(w, min(math.ceil(_ENOUGH / max(acceptance, 1e-3) ** 2), _MOST_STEPS)))
    draws = density.scaled(coordinates.to_parameters(v.reshape(-1, size), np.repeat(every, DRAWS)))
    return draws.reshape(count, DRAWS, size), independence.accepted / independence.proposed


@dataclass(frozen=True, eq=False)
class StudiedPlan:
    """A plan of the study. `degenerate`: there is an offset that it cannot tell at all; `curved`: its misses
    are so far from linear that intervals from the curvature at the mode need not hold."""

    name: str
    words: str
    problem: Problem
    degenerate: bool = False
    curved: bool = False


def studied_plans(seed: int) -> list[StudiedPlan]:
    """From good to degenerate, for the built-in arm: a laser, one target, seven shots."""
    header = Header.model_validate(_HEADER)
    robot = load_robot(header.robot, Path())
    place = np.array(_TARGET)

    def planned(postures: Matrix, own: Header = header) -> Problem:
        return Problem.build(own, robot, postures, ["psd"] * len(postures))

    found = candidates(header, robot, place, _CANDIDATES, seed=seed)
    best = Planner(header, robot, place, found).optimal(_SHOTS, seed=seed).postures
    freed = header.model_copy(update={"held": ()})
    return [
        StudiedPlan("good", f"{_SHOTS} A-optimal shots of {_CANDIDATES} postures", planned(best)),
        StudiedPlan(
            "weak",
            f"Y-Pattern of {_SHOTS} shots over the arm's whole reach",
            planned(pattern(header, robot, place, "y", _SHOTS)),
        ),
        StudiedPlan(
            "nearly degenerate",
            f"Y-Pattern of {_SHOTS} shots over {_SHORT:g} of the reach",
            planned(pattern(header, robot, place, "y", _SHOTS, span=_SHORT)),
            curved=True,
        ),
        StudiedPlan(
            "degenerate",
            "the good plan with joint 1 freed, which turns with the base and the target",
            planned(best, freed),
            degenerate=True,
        ),
    ]


def coverage_study(
    data_sets: int, seed: int, progress: Progress, *, store: Path | None = None
) -> dict[str, Any]:
    """The whole study, as plain JSON types (docs/files.md, `zerobeam/study/1`).

    It agrees if the intervals of the posterior, those of the likelihood's curvature where the plan is not
    nearly degenerate, and the ranks are as promised, and every control is seen to be wrong. The midpoint fit
    is the paper's: where its intervals do not hold, that is a finding. With a `store` the answer of each plan
    is kept in that file at once, and a study that was stopped goes on from there.
    """
    began = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        plans = studied_plans(seed)

        def studied(k: int) -> dict[str, Any]:
            def tell(share: float) -> None:
                progress(plans[k].name, (k + share) / len(plans))

            return _studied(plans[k], data_sets, seed, tell)

        heading = {"study": "coverage", "seed": seed, "data_sets": data_sets, "versions": versions()}
        told = each_case(store, heading, len(plans), studied)
    must, findings, seen = [row["agrees"] for plan in told for row in plan["sbc"]], [], []
    for plan, answer in zip(plans, told, strict=True):
        for row in answer["estimators"]:
            if row["control"]:
                seen.append(not row["agrees"])
            elif row["name"] == "midpoint" or (row["name"] == "likelihood" and plan.curved):
                findings += [] if row["agrees"] else [f"{row['name']} on {plan.name}"]
            else:
                must.append(row["agrees"])
    return {
        "schema": "zerobeam/study/1",
        "study": "coverage",
        "title": "Do the intervals hold what they promise?",
        "headline": _headline(data_sets, all(must), all(seen), findings),
        "agrees": all((*must, *seen)),
        "settings": {
            "data_sets": data_sets,
            "seed": seed,
            "levels": list(LEVELS),
            "draws": DRAWS,
            "bins": BINS,
            "chance": _CHANCE,
            "posterior": f"at least {_ROUND + int(_ENOUGH)} steps of emcee for each of {DRAWS} walkers",
        },
        "seconds": time.perf_counter() - began,
        "versions": versions(),
        "plans": told,
        "notes": [
            "Every data set has a truth of its own: offsets of 5° (one standard deviation), the target"
            f" {_SIGMA_MM:g} mm about its guess, as the priors of the fits say.",
            f"An estimator agrees if none of its shares is off by more than a chance of {_CHANCE:.0%}, over"
            " all levels and offsets together, allows (exact binomial test, Bonferroni). The intervals shown"
            " are 95 % (Clopper and Pearson).",
            "Intervals from the curvature at the mode are for plans that are not nearly degenerate: where a"
            " direction is nearly lost a result shows those of profile and posterior beside them.",
            "The midpoint fit uses no spot reading and no prior, and starts from zero offsets as in the"
            " paper: where it ends in another minimum its error is large, and the rmse holds those runs too."
            " Its sandwich is linear; on poor plans its errors are not.",
        ],
    }


def _headline(data_sets: int, kept: bool, seen: bool, findings: Sequence[str]) -> str:
    parts = [
        f"Over {data_sets} simulated data sets a plan, the intervals that zerobeam shows"
        f" {'hold' if kept else 'do not hold'} what they promise.",
        "Every control is seen to be wrong." if seen else "A control is not seen to be wrong.",
    ]
    if findings:
        parts.append(f"Not to be relied on: intervals of {listed(list(findings))}.")
    return " ".join(parts)


def _studied(plan: StudiedPlan, count: int, seed: int, tell: Callable[[float], None]) -> dict[str, Any]:
    problem = plan.problem
    rng = np.random.default_rng([seed, *plan.name.encode()])
    parameters = problem.parameters
    which = np.flatnonzero(parameters.free & parameters.group("offset"))
    status = identify(problem, problem.nominal()).status
    known = np.array([status[i] in ("identified", "weak") for i in which])
    data = drawn(problem, count, rng)
    tell(0.1)
    fits = fitted(data)
    tell(0.2)
    estimates = [likelihood(data, fits, which), understated(data, which)]
    if plan.degenerate:
        estimates.append(pseudo_inverse(data, fits, which))
    else:
        estimates.insert(1, midpoint(data, which))
    tell(0.3)
    draws, acceptance = posterior_draws(data, fits, rng, lambda share: tell(0.3 + 0.7 * share))
    at = parameters.among_free[which]
    scale, mean, true = parameters.prior_std[which], parameters.prior_mean[which], data.truths[:, which]
    ranks = (draws[:, :, at] < ((true - mean) / scale)[:, None]).sum(axis=1)
    items = [parameters.items[i] for i in which]
    of_draws = Estimates(
        "posterior",
        f"posterior, intervals between quantiles of {DRAWS} draws",
        False,
        draws[:, :, at].mean(axis=1) * scale + mean,
        draws[:, :, at].std(axis=1, ddof=1) * scale,
        fits.converged,
    )
    rows = [_estimator(e, items, status, known, true, which) for e in estimates]
    rows.insert(1, _estimator(of_draws, items, status, known, true, which, ranks))
    return {
        "name": plan.name,
        "words": plan.words,
        "robot": problem.robot.name,
        "shots": problem.shots,
        "noise": {"joint_deg": float(np.degrees(problem.noise.joint[0])), "spot_mm": problem.noise.spot},
        "data_sets": len(data.truths),
        "failed": data.failed,
        "acceptance": acceptance,
        "estimators": rows,
        "sbc": [_calibration(items, ranks)],
    }


def _of_fits(
    name: str, words: str, control: bool, parameters: Parameters, fits: Fits, which: NDArray[np.intp]
) -> Estimates:
    at = parameters.among_free[which]
    std = fits.std[:, at] * parameters.prior_std[which]
    return Estimates(name, words, control, fits.x[:, which], std, fits.converged)


def _estimator(
    estimates: Estimates,
    items: Sequence[Any],
    status: Sequence[str],
    known: NDArray[np.bool_],
    truth: Matrix,
    which: NDArray[np.intp],
    ranks: NDArray[np.int64] | None = None,
) -> dict[str, Any]:
    """Bias, rmse and coverage of one estimator; by ranks among the draws where they are given.

    What a plan cannot tell has no interval in any result, so it has none here; but a control is judged by
    the numbers that it would have given.
    """
    kept = estimates.kept
    error = (estimates.value - truth)[kept]
    off = np.abs(error) / estimates.std[kept]
    rows, agrees, compared = [], True, 0
    judged = np.ones_like(known) if estimates.control else known
    alarm = _CHANCE / max(int(judged.sum()) * len(LEVELS), 1)
    for j, item in enumerate(items):
        shown = (error[:, j] * item.display, estimates.std[kept, j] * item.display)
        row: dict[str, Any] = {
            "name": item.name,
            "unit": item.unit,
            "status": status[which[j]],
            **(accuracy(*shown) if judged[j] else nothing_known()),
            "coverage": [],
        }
        if judged[j]:
            for level in LEVELS:
                if ranks is None:
                    held = int((off[:, j] <= stats.norm.ppf((1 + level) / 2)).sum())
                else:
                    cut = round((1 - level) / 2 * (DRAWS + 1))
                    held = int(((ranks[kept, j] >= cut) & (ranks[kept, j] <= DRAWS - cut)).sum())
                share = held_share(held, len(error), level, alarm)
                agrees, compared = agrees and share["agrees"], compared + 1
                row["coverage"].append(share)
        rows.append(row)
    return {
        "name": estimates.name,
        "words": estimates.words,
        "control": estimates.control,
        "agrees": agrees,
        "converged": int(kept.sum()),
        "sentence": _sentence(rows, agrees, estimates.control),
        "parameters": rows,
    }


def _sentence(rows: Sequence[dict[str, Any]], agrees: bool, control: bool) -> str:
    shares = [
        (abs(c["share"] - 0.95), row["name"], c["share"])
        for row in rows
        for c in row["coverage"]
        if c["level"] == 0.95
    ]
    if not shares:
        return "No offset that these shots could tell"
    _, name, share = max(shares)
    worst = f"95 % intervals hold the truth in {share:.1%} at the worst ({name})"
    if control:
        return f"{worst}: {'not seen to be wrong on this plan' if agrees else 'wrong, and seen to be'}"
    return f"{worst}: {'as promised' if agrees else 'not as promised'}"


def _calibration(items: Sequence[Any], ranks: NDArray[np.int64]) -> dict[str, Any]:
    """Rank histograms of the posterior, each against the uniform by chi-squared."""
    count = len(ranks)
    rows, least = [], 1.0
    for j, item in enumerate(items):
        counts = np.bincount(ranks[:, j] * BINS // (DRAWS + 1), minlength=BINS)
        chi2, p = stats.chisquare(counts)
        least = min(least, float(p))
        rows.append(
            {
                "name": item.name,
                "unit": item.unit,
                "ranks": [int(c) for c in counts],
                "chi2": float(chi2),
                "p_value": float(p),
            }
        )
    agrees = least >= _CHANCE / max(len(rows), 1)
    return {
        "name": "posterior",
        "control": False,
        "agrees": agrees,
        "sentence": f"The truth ranks {'evenly' if agrees else 'unevenly'} among the draws"
        f" (smallest p-value {least:.2g} of {len(rows)})",
        "parameters": rows,
        "power": power_sentence(count, _CHANCE / max(len(rows), 1)),
    }


def power(count: int, alarm: float, ratio: float) -> float:
    """Probability that the chi-squared test of `count` ranks sees stds that are `ratio` of the right ones."""
    edges = stats.norm.cdf(stats.norm.ppf(np.linspace(0, 1, BINS + 1)) * ratio)
    excess = float(count * BINS * ((np.diff(edges) - 1 / BINS) ** 2).sum())
    return float(stats.ncx2.sf(stats.chi2.isf(alarm, BINS - 1), BINS - 1, excess))


def power_sentence(count: int, alarm: float) -> str:
    return "stds too small by " + ", by ".join(
        f"{1 - ratio:.0%} would be seen with probability {power(count, alarm, ratio):.2f}"
        for ratio in (0.9, 0.8, 0.7)
    )
