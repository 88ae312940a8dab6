"""Sampling of a density by emcee: an independence move from a multivariate t, and differential evolution.

Nothing here knows of robots: a vectorised log-density goes in, draws and their diagnostics come out. A run
that mixes badly continues with many more walkers, up to a stated budget.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix, ShareDone
from .convergence import effective, nested_rhat, normal_scores
from .lean_emcee import lean_emcee

LogDensity = Callable[[Matrix], Matrix]
# A function of each of many arrays, as `map`.
Mapping = Callable[[Callable[[Matrix], Any], Iterable[Matrix]], Iterable[Any]]
_ROWS = 16_384  # of one call of the density


class IndependenceProposal:
    """A multivariate t to propose from: location (f,), lower Cholesky factor (f, f), nu."""

    def __init__(self, location: Matrix, factor: Matrix, nu: float) -> None:
        self.location, self.factor, self.nu = location, factor, nu
        self._inverse = np.linalg.inv(factor)

    def log_density(self, points: Matrix) -> Matrix:
        """(W,) up to a constant."""
        inner = (points - self.location) @ self._inverse.T
        size = len(self.location)
        result: Matrix = -(self.nu + size) / 2 * np.log1p(np.einsum("ij,ij->i", inner, inner) / self.nu)
        return result

    def draw(self, count: int, random: np.random.Generator) -> Matrix:
        normal = random.standard_normal((count, len(self.location)))
        chi2 = random.chisquare(self.nu, size=count)
        result: Matrix = self.location + (normal * np.sqrt(self.nu / chi2)[:, None]) @ self.factor.T
        return result

    def refitted(self, draws: Matrix, fewest: int) -> IndependenceProposal:
        """With the centre and spread of draws (N, f); itself where fewer than `fewest` of them differ."""
        size = len(self.location)
        if len(np.unique(draws[:, 0])) < fewest:
            return self
        try:
            factor = np.asarray(np.linalg.cholesky(np.cov(draws.T).reshape(size, size)), dtype=float)
        except np.linalg.LinAlgError:
            return self
        return IndependenceProposal(draws.mean(axis=0), factor, self.nu)


def degrees_of_freedom(size: int) -> float:
    """nu of the proposal: heavy tails (6) in few dimensions, lighter in many, where the radius of a t
    with few degrees of freedom would scatter far more than the posterior's."""
    return max(6.0, 2.0 * size)


class _Move:
    """emcee requires of a move `propose(model, state)`, which returns the state and who moved.

    Its own moves accept walkers one by one, and emcee checks and copies each log-density in Python: that
    costs more than the density. These accept all at once, evaluate the proposals of many steps in one call,
    and draw from a generator of their ensemble.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.accepted = self.proposed = 0

    def settle(
        self, state: Any, chosen: Index, points: Matrix, log_density: Matrix, factors: Matrix | float
    ) -> Mask:
        """Metropolis and Hastings for the walkers `chosen` (indices); returns which of them moved."""
        # From -inf to -inf is NaN, and no move.
        with np.errstate(invalid="ignore"):
            gain = log_density - state.log_prob[chosen] + factors
        moved: Mask = -self.random.standard_exponential(len(points)) < gain
        state.coords[chosen[moved]] = points[moved]
        state.log_prob[chosen[moved]] = log_density[moved]
        self.accepted += int(moved.sum())
        self.proposed += len(moved)
        return moved


class IndependenceMove(_Move):
    """Every walker to a draw of the proposal.

    The draws do not depend on where the walkers are: those of `ahead` steps go to the density together.
    """

    def __init__(self, proposal: IndependenceProposal, random: np.random.Generator, ahead: int = 1) -> None:
        super().__init__(random)
        self.proposal = proposal
        self.ahead = ahead
        self.evaluated: list[tuple[Matrix, Matrix]] = []  # all points proposed, with ln p - ln g
        self._drawn: Iterator[tuple[Matrix, Matrix, Matrix]] = iter(())

    def propose(self, model: Any, state: Any) -> tuple[Any, Mask]:
        count = len(state.coords)
        drawn = next(self._drawn, None)
        if drawn is None:
            steps = max(1, min(self.ahead, _ROWS // count))
            self.ahead -= steps
            points = self.proposal.draw(steps * count, self.random)
            many = (points, model.log_prob_fn(points), self.proposal.log_density(points))
            self.evaluated.append((points, many[1] - many[2]))
            self._drawn = zip(*(np.split(values, steps) for values in many), strict=True)
            drawn = next(self._drawn)
        points, density_there, proposal_there = drawn
        factors = self.factors(self.proposal.log_density(state.coords), proposal_there)
        return state, self.settle(state, np.arange(count), points, density_there, factors)

    def factors(self, here: Matrix, there: Matrix) -> Matrix:
        """(W,) as in emcee's moves, what the proposal itself favours: ln g of the walkers and of what is
        proposed to them."""
        return here - there


class DifferentialMove(_Move):
    """Differential evolution (Ter Braak 2006; Nelson et al. 2013), half of the walkers by pairs of the other.

    emcee's DEMove lists all pairs of walkers at each call; here a walker draws its pair. With `groups` the
    walkers are so many groups of one size, one after the other, and every pair is of the walker's own group.
    """

    def __init__(self, random: np.random.Generator, groups: int = 1) -> None:
        super().__init__(random)
        self.groups = groups

    def propose(self, model: Any, state: Any) -> tuple[Any, Mask]:
        count, size = state.coords.shape
        accepted = np.zeros(count, dtype=bool)
        starts = np.arange(self.groups)[:, None] * (count // self.groups)
        halves = np.array_split(self.random.permutation(count // self.groups), 2)
        # Now and then a whole difference: from one mode to another.
        scale = 1.0 if self.random.random() < 0.1 else 2.38 / np.sqrt(2 * size)
        for half, other in (halves, halves[::-1]):
            chosen = (starts + half).reshape(-1)
            first = self.random.integers(len(other), size=len(chosen))
            second = (first + self.random.integers(1, len(other), size=len(chosen))) % len(other)
            start = np.repeat(starts[:, 0], len(half))
            stretch = scale * (1 + 1e-5 * self.random.standard_normal((len(chosen), 1)))
            steps = stretch * (state.coords[start + other[first]] - state.coords[start + other[second]])
            points = state.coords[chosen] + steps
            accepted[chosen] = self.settle(state, chosen, points, model.log_prob_fn(points), 0.0)
        return state, accepted


_CHUNK = 2048  # rows of one call of the density, whatever the number of threads: the numbers must be the same
ENSEMBLES = 4
RHAT_GATE = 1.01
BUDGET = 600_000  # evaluations of the density before a run gives up, and
_PER_ESS = 40  # more for each effective draw asked for
_KEPT = 2e7  # numbers of the draws that are kept: 160 MB, twice
_WALKERS = (32, 1024)  # of an ensemble: many share the cost of a step where many draws are asked for
_STEPS_PLANNED = 64
SHARE = 0.1  # of the steps, by differential evolution
ROUND = 20  # steps from one fit of the proposal to the next
ROUNDS = (2, 5)  # at least and at most
GOOD = 0.5  # of the proposals accepted: the proposal is close to the density
_HOPELESS = 0.05  # of them accepted: the density is not at all like the proposal
SETTLED = 0.03  # more proposals accepted than in any round before: not yet settled
_PULLS = 12  # halvings of the way to the proposal's location
_FIRST_LOOK = 60  # steps: from shorter chains the ESS comes out too large
_MANY_WALKERS = 64  # of an ensemble: where there are more, and proposals are accepted, fewer steps suffice
_DRIFT_GATE = 4.5  # standard errors; the tails of a curved sheet are found late, by all ensembles alike
_FEW_STEPS = 250  # of the run with few walkers
# Of the progress: the run with few walkers where it is expected to suffice, and where not; of the rest the
# burn-in of the one with many.
_SUFFICES, _FEW, _BURN_IN = 0.8, 0.2, 0.4
_MANY = 512  # walkers of an ensemble where few do not mix,
MANY_SHARE = 0.3  # and their share of the steps by differential evolution
_MANY_ROUNDS = (6, 12)
_LOOK_WALKERS = 128  # of an ensemble, to take diagnostics of
# Draws up to which more are taken for what the effective sample size does not decide: in all, and for each
# effective one that is asked for.
DECIDING, DECIDING_EACH = 100_000, 100
_BLOCK = 2.0  # times the draws so far, at most, in one block of these
_SPARE = 1.1  # times what is expected to decide
_TURNOVER = 2  # effective draws for each walker: on average it has left its start behind


class Proposed(NamedTuple):
    """Independent draws of a proposal g: `points` (N, f), and ln p - ln g (N,) of each up to a constant."""

    proposal: IndependenceProposal
    points: Matrix
    log_weights: Matrix


# Of what is judged, and of what was proposed where that is known: how many times as many draws it takes.
ShortBy = Callable[[Matrix, Proposed | None], float]
# Of the same: whether the draws agree with the density by another method.
Agrees = Callable[[Matrix, Proposed | None], bool]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Draws of all ensembles: `values` (ensembles, walkers, steps, f) in the sampler's coordinates, `judged`
    those in which R-hat, ESS and drift are taken.

    `rhat` and `ess_bulk` (f,). `settled`: R-hat passed its gate and nothing drifts; `enough`: the ESS is what
    was required; `agrees`: another method confirms the draws. `seconds` are those of the sampling, `looking`
    those of the diagnostics, `evaluations` the density's rows.
    """

    values: Matrix
    judged: Matrix
    rhat: Matrix
    ess_bulk: Matrix
    enough: bool
    settled: bool
    agrees: bool = False
    acceptance: float = 0.0
    seconds: float = 0.0
    looking: float = 0.0
    evaluations: int = 0

    @property
    def done(self) -> bool:
        return self.enough and self.settled and self.agrees


def possible_density(log_density: LogDensity, points: Matrix) -> Matrix:
    """(W,); what is no number, or more than any number, is impossible: -inf."""
    with np.errstate(all="ignore"):
        values = np.asarray(log_density(points), dtype=float)
    return np.where(values < np.inf, values, -np.inf)


class Moves:
    """The steps of one ensemble: a `share` of them by differential evolution, the others by the proposal.

    With `groups` the walkers are of so many data sets, as many of each, one set after the other.
    """

    def __init__(
        self, proposal: IndependenceProposal, random: np.random.Generator, share: float, groups: int = 1
    ) -> None:
        self.independence = IndependenceMove(proposal, random)
        self.differential = DifferentialMove(random, groups)
        self._random, self._share = random, share

    def advance(self, log_density: LogDensity, start: Matrix, steps: int, *, last: bool = False) -> Matrix:
        """(walkers, steps, f) from `start` (walkers, f); only the `last` step if asked for."""
        emcee = lean_emcee()
        moves = [(self.independence, 1 - self._share), (self.differential, self._share)]
        sampler = emcee.EnsembleSampler(*start.shape, log_density, moves=moves, vectorize=True)
        sampler.log_prob_fn = log_density  # emcee's own prints a traceback at Ctrl-C
        self.independence.ahead = round((1 - self._share) * steps)
        # emcee's legacy generator has no more to do than to choose between the moves.
        choice = np.random.RandomState(self._random.integers(2**32)).get_state()
        state = emcee.State(start, log_prob=log_density(start), random_state=choice)
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True, store=not last)
        chain = state.coords[:, None] if last else sampler.get_chain().transpose(1, 0, 2)
        return np.asarray(chain)


class _Run:
    """Independent ensembles, carried out as one by emcee, and what they have learnt so far.

    Points come and go as (ensembles, walkers, [steps,] f) in the caller's coordinates.
    """

    def __init__(
        self,
        log_density: LogDensity,
        proposal: IndependenceProposal,
        seed: int,
        pool: ThreadPoolExecutor,
        judged: Callable[[Matrix], Matrix],
        short_by: ShortBy,
        agrees: Agrees,
    ) -> None:
        self._log_density, self._pool = log_density, pool
        self._judged, self._short_by, self._agrees = judged, short_by, agrees
        self._proposal = proposal
        self.share = SHARE
        self.random = np.random.default_rng(seed)
        self._evaluated: list[tuple[Matrix, Matrix]] = []
        self.evaluations = 0
        self.acceptance = self._independent = 0.0
        self.seconds = 0.0

    def density(self, points: Matrix) -> Matrix:
        return possible_density(self._log_density, points)

    def _mapped(self, function: Callable[[Matrix], Matrix], points: Matrix) -> Matrix:
        """A function of rows, by all threads."""
        chunks = [points[first : first + _CHUNK] for first in range(0, len(points), _CHUNK)]
        return np.concatenate(list((self._pool.map if len(chunks) > 1 else map)(function, chunks)))

    def start(self, walkers: int) -> Matrix | None:
        """Draws of the proposal, moved to its location until the density is not 0; else None."""
        points = self._proposal.draw(ENSEMBLES * walkers, self.random)
        for _ in range(_PULLS):
            possible = np.isfinite(self.density(points))
            self.evaluations += len(points)
            if possible.all():
                break
            points[~possible] = (points[~possible] + self._proposal.location) / 2
        possible = np.isfinite(self.density(points))
        if not possible.any():
            return None
        points[~possible] = self.random.choice(points[possible], int((~possible).sum()))
        return points.reshape(ENSEMBLES, walkers, -1)

    def spread(self, values: Matrix, walkers: int) -> Matrix:
        """(ensembles, walkers, f) starting points, chosen among the draws of each ensemble."""
        ensembles = values.reshape(ENSEMBLES, -1, values.shape[-1])
        return np.stack(
            [self.random.choice(draws, walkers, replace=len(draws) < walkers) for draws in ensembles]
        )

    def advance(self, starts: Matrix, steps: int) -> Matrix:
        """Chains (ensembles, walkers, steps, f) from `starts` (ensembles, walkers, f)."""
        began = time.perf_counter()
        start = starts.reshape(-1, starts.shape[-1])
        moves = Moves(self._proposal, self.random, self.share, groups=ENSEMBLES)
        chain = moves.advance(lambda points: self._mapped(self.density, points), start, steps)
        both = (moves.independence, moves.differential)
        self._independent = both[0].accepted / max(1, both[0].proposed)
        self.acceptance = sum(m.accepted for m in both) / sum(m.proposed for m in both)
        if sum(len(points) for points, _ in self._evaluated) < DECIDING:
            self._evaluated += moves.independence.evaluated
        self.evaluations += len(start) * (steps + 1)
        self.seconds += time.perf_counter() - began
        return chain.reshape(*starts.shape[:2], steps, -1)

    def burn_in(
        self, starts: Matrix, rounds: tuple[int, int], progress: ShareDone = lambda share: None
    ) -> Matrix:
        """Rounds, a refit after each, until neither acceptance nor draws move on; the last round's draws."""
        best, values = 0.0, starts[:, :, None]
        for count in range(1, rounds[1] + 1):
            values = self.advance(values[:, :, -1], ROUND)
            self._refit(values[:, :, ROUND // 2 :])
            settled = self._independent < best + SETTLED and drift(values, self._pool.map) < _DRIFT_GATE
            if count >= rounds[0] and settled:
                break
            best = max(best, self._independent)
            progress(count / rounds[1])
        return values

    def _refit(self, values: Matrix) -> None:
        draws = values.reshape(-1, values.shape[-1])
        size = draws.shape[1]
        # From few draws a covariance of many parameters is a worse proposal than one that is close.
        fewest = 10 * size if self._independent < GOOD else max(10 * size, 2 * size**2)
        self._proposal = self._proposal.refitted(draws, fewest)

    @property
    def hopeless(self) -> bool:
        """No number of draws within the budget would do."""
        return self._independent < _HOPELESS

    def _first_look(self, walkers: int) -> int:
        """How many steps until the first diagnostics: many autocorrelation times of a walker."""
        if self._independent < GOOD:
            return _FIRST_LOOK
        return min(max(_FIRST_LOOK // 2, _FIRST_LOOK * _MANY_WALKERS // walkers), _FIRST_LOOK)

    def _settled(self, judged: Matrix, rhat: Matrix) -> bool:
        return float(rhat.max()) <= RHAT_GATE and drift(judged, self._pool.map) <= _DRIFT_GATE

    def grow(
        self, starts: Matrix, ess: float, limit: int, progress: Callable[[float, bool], None]
    ) -> Sampled:
        """Draws from `starts` until they are enough, have settled, and agree, in at most `limit` steps.

        `progress` hears the share that is done, of the effective draws or of the steps, and whether the limit
        is expected to suffice.
        """
        walkers = starts.shape[1]
        needed = max(ess, _TURNOVER * ENSEMBLES * walkers)
        total = min(self._first_look(walkers), limit)
        self._evaluated = []
        values = self.advance(starts, total)
        judged = self._judged_each(values)
        while True:
            rhat, bulk = diagnostics(judged, self._pool.map)
            reached = float(bulk.min())
            expected = total * needed / max(reached, 1.0)
            progress(min(reached / needed, 1.0) if expected <= limit else total / limit, expected <= limit)
            settled, enough = self._settled(judged, rhat), reached >= needed
            if (enough and settled) or total >= limit or self.hopeless:
                sampled = Sampled(values, judged, rhat, bulk, enough, settled)
                return self._decide(sampled, ess) if enough and settled else sampled
            # As many as the draws so far let expect, with some to spare; more where the ensembles disagree.
            factor = 1.5 if enough else min(1.1 * needed / max(reached, 1.0), 8.0)
            total = min(max(int(np.ceil(factor * total)), total + ROUND), limit)
            values, judged = self._extended(values, judged, total)

    def _decide(self, sampled: Sampled, ess: float) -> Sampled:
        """More draws, block by block (JCGM 101:2008, 7.9.4), until they decide or are enough for `ess`.

        R-hat and ESS stay those of the draws before, which have settled: of all they are better. What the
        tails have found late is looked for in all.
        """
        values, judged = sampled.values, sampled.judged
        ensembles, walkers, first, _ = values.shape
        steps, limit = first, int(min(DECIDING, DECIDING_EACH * ess)) // (ensembles * walkers)
        while (factor := self._short_by(judged, self._proposed())) > 1 and steps < limit:
            steps = min(max(int(np.ceil(min(_SPARE * factor, _BLOCK) * steps)), steps + ROUND), limit)
            values, judged = self._extended(values, judged, steps)
        still = steps == first or drift(judged, self._pool.map) <= _DRIFT_GATE
        agrees = self._agrees(judged, self._proposed())
        return replace(sampled, values=values, judged=judged, settled=still, agrees=agrees)

    def _proposed(self) -> Proposed | None:
        if not self._evaluated:
            return None
        points, log_weights = (np.concatenate(parts) for parts in zip(*self._evaluated, strict=True))
        return Proposed(self._proposal, points, log_weights)

    def _extended(self, values: Matrix, judged: Matrix, steps: int) -> tuple[Matrix, Matrix]:
        """Chains continued to so many steps, and what is judged of them."""
        more = self.advance(values[:, :, -1], steps - values.shape[2])
        pairs = ((values, more), (judged, self._judged_each(more)))
        longer, longer_judged = (np.concatenate(pair, axis=2) for pair in pairs)
        return longer, longer_judged

    def _judged_each(self, values: Matrix) -> Matrix:
        """What is judged of chains (ensembles, walkers, steps, f), by all threads."""
        return np.stack(list(self._pool.map(self._judged, values)))


def sample_density(
    log_density: LogDensity,
    proposal: IndependenceProposal,
    *,
    seed: int,
    ess: float,
    threads: int = 1,
    judged: Callable[[Matrix], Matrix] = lambda values: values,
    short_by: ShortBy = lambda judged, proposed: 0.0,
    agrees: Agrees = lambda judged, proposed: True,
    progress: ShareDone | None = None,
) -> Sampled:
    """Sample a vectorised log-density (W, f) -> (W,) by independent ensembles until `ess` is reached.

    The proposal is refitted during the burn-in, then frozen. A run that would take long continues with many
    walkers, until the budget is spent; the result says whether it converged. `threads` share the ensembles;
    the draws are the same for any number of them. `judged` turns draws (…, f) into the coordinates in which
    R-hat, ESS and drift are taken; `short_by` says of these, and of what was proposed, how many times as many
    draws another question needs, which gets up to `DECIDING` in all and `DECIDING_EACH` for each of `ess`;
    `agrees` says of all of them whether another method confirms them. -inf, inf and NaN of the density are
    impossible points, all alike.
    """
    best, few_part = [0.0], 0.0

    def shown(share: float) -> None:
        best.append(max(best[-1], share))
        if progress is not None:
            progress(best[-1])

    def by_few(share: float, suffices: bool) -> None:
        shown(share * (_SUFFICES if suffices else _FEW))

    def by_many(share: float) -> None:
        shown(few_part + (0.99 - few_part) * share)

    began = time.perf_counter()
    few = max(_WALKERS[0], 2 * len(proposal.location) + 2)
    walkers = max(few, 2 * (min(int(ess / _STEPS_PLANNED), _WALKERS[1]) // 2))
    with ThreadPoolExecutor(max_workers=threads) as pool:
        run = _Run(log_density, proposal, seed, pool, judged, short_by, agrees)
        starts = run.start(few)
        if starts is None:
            values = np.tile(proposal.location, (ENSEMBLES, few, 8, 1))
            sampled = Sampled(values, judged(values), *diagnostics(judged(values)), False, False)
        else:
            values = run.burn_in(starts, ROUNDS)
            if walkers > few:
                values = run.advance(run.spread(values, walkers), ROUND // 2)
            sampled = run.grow(values[:, :, -1], ess, _FEW_STEPS, by_few)
            if not (sampled.done or run.hopeless):
                few_part, run.share = best[-1], MANY_SHARE
                many = max(walkers, _MANY)
                starts = run.spread(sampled.values, many)
                values = run.burn_in(starts, _MANY_ROUNDS, lambda share: by_many(_BURN_IN * share))
                left = min(BUDGET + _PER_ESS * ess - run.evaluations, _KEPT / values.shape[-1])
                limit = max(_FIRST_LOOK, int(left / (ENSEMBLES * many)))
                rest = 1.0 - _BURN_IN
                sampled = run.grow(
                    values[:, :, -1], ess, limit, lambda share, _: by_many(_BURN_IN + rest * share)
                )
    return replace(
        sampled,
        acceptance=run.acceptance,
        seconds=run.seconds,
        looking=time.perf_counter() - began - run.seconds,
        evaluations=run.evaluations,
    )


def drift(values: Matrix, mapped: Mapping = map) -> float:
    """By how many standard errors the second half of the draws lies or spreads elsewhere than the first.

    Each walker is compared with itself, the walkers give the error: sees what is far too little for R-hat.
    The largest over the f coordinates of (ensembles, walkers, steps, f), all looked at by `mapped`.
    """
    return float(np.max(list(mapped(_drift, np.moveaxis(values, -1, 0).copy()))))


def _drift(draws: Matrix) -> float:
    """Of one coordinate's draws (ensembles, walkers, steps)."""
    half = draws.shape[2] // 2
    largest = 0.0
    for x in (draws, np.abs(draws - np.median(draws))):
        moved = x[:, :, -half:].mean(axis=2) - x[:, :, :half].mean(axis=2)
        error = float(moved.std()) / np.sqrt(moved.size)
        largest = max(largest, float(np.abs(moved.mean())) / max(error, 1e-300))
    return largest


def diagnostics(values: Matrix, mapped: Mapping = map) -> tuple[Matrix, Matrix]:
    """Nested rank R-hat and bulk ESS (f,) of draws (ensembles, walkers, steps, f), all looked at by `mapped`.

    R-hat compares the ensembles (walkers of one ensemble are not independent chains: Margossian et al. 2024),
    and the first half of the steps with the second: ensembles that all drift the same way agree, too. The
    ranks (Vehtari et al. 2021, eq. 14) are taken once for all of these. Walkers being alike, a part of them
    speaks for all where they are many.
    """
    thin = -(-values.shape[1] // _LOOK_WALKERS)
    share = values.shape[1] / len(range(0, values.shape[1], thin))
    each = list(mapped(_rank_statistics, np.moveaxis(values[:, ::thin], -1, 0).copy()))
    rhat, bulk = np.array(each).T
    return rhat, share * bulk


def _rank_statistics(draws: Matrix) -> tuple[float, float]:
    """R-hat and bulk ESS of one coordinate's draws (ensembles, walkers, steps)."""
    ensembles, _, steps = draws.shape
    half = steps // 2
    chains = np.stack([draws[..., :half], draws[..., -half:]])
    if half < 4 or np.ptp(chains) == 0:
        return np.inf, 0.0
    scores = normal_scores(chains)
    folded = normal_scores(np.abs(chains - np.median(chains)))
    rhat = max(
        nested_rhat(grouped.reshape(groups, -1, half))
        for z in (scores, folded)
        for groups, grouped in ((ensembles, z.swapaxes(0, 1)), (2, z))
    )
    return rhat, effective(scores.reshape(-1, half))
