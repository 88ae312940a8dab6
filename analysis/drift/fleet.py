"""Drift rates of the offsets of a robot model, by all of its arms: shrinkage between arms.

The logarithm of the drift rate of an offset is normal between the arms of a model,

    log rate ~ N(mu, tau^2),   tau^2 = rho SPREAD^2,   mu ~ N(log MEDIAN, (1 - rho) SPREAD^2),

each offset with a mu and a rho of its own (a hierarchical model: Gelman et al. 2013, Bayesian Data Analysis,
ch. 5). rho, the share of the prior's variance that lies between the arms of a model, is uniform from `LEAST`
to 1. So the rate of a single arm has the prior of `drift` whatever rho is, and one arm alone has the same
answer as without a fleet. The likelihood of an arm couples the rates of its offsets, so all mu and rho are
integrated over together: the likelihood of an arm, given mu and rho, is a weighted sum over the rates that
its drift was integrated over. Where too few of these agree with mu and rho, more are sampled about a normal
approximation, and again while few agree with the mu and rho of the posterior. mu and rho are integrated over
about the mode, as standard normal coordinates.

An offset whose drift rate no arm determines (`Drift.determines_rate`) is not modelled: nothing is known of it
but the prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import optimize, special

from ...model.arrays import Index, Matrix
from .drift import MEDIAN, SPREAD, Drift, median_interval
from .importance import Nodes, Pass, about, effective, from_pass, normalised, sampled
from .smoother import Series, smooth

LEAST = 0.04  # of rho: rates of two arms of a model are never taken as equal (tau at least 0.3)
ENOUGH = 100  # rates of an arm that agree with mu and rho: with fewer, more are sampled
_MORE, _ROUNDS, _WIDER = 256, 3, 1.3
FEW, _AGAIN = 30, 12  # rates of an arm that agree with its model: with fewer, so many rounds more at most
_NODES, _PASSES, _NEAR = 512, 2, 1.2  # of mu and rho; the pass about the mode is so much wider
_AT_ONCE = 64  # of mu and rho: what fast memory holds
_SOME = 128  # of mu and rho that an arm's rates are of
_EXCLUDED = 20.0  # less than the highest log-likelihood
_STEP = 1e-3
_CENTRE = math.log(MEDIAN)


@dataclass(frozen=True, eq=False)
class ArmRates:
    """The rates of an arm among those of its model: `rates` (K, m), `weights` (K,); `effective` is how many
    of them agree with the model's, on average."""

    names: tuple[str, ...]
    rates: Matrix
    weights: Matrix
    effective: float

    def rate(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Median and 95 % interval of an offset's drift rate, per root year."""
        return median_interval(self.rates[:, self.names.index(offset)], self.weights)


@dataclass(frozen=True, eq=False)
class ModelRates:
    """The drift rates of the offsets `names` of a model: `mu` (H, n) and `tau` (H, n) with the `weights`
    (H,), of the natural logarithm per root year; `effective` is their effective number. `arms` in the order
    given."""

    names: tuple[str, ...]
    mu: Matrix
    tau: Matrix
    weights: Matrix
    effective: float
    arms: tuple[ArmRates, ...]

    def median(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Of the median rate of the model's arms: median and 95 % interval, per root year."""
        return median_interval(np.exp(self.mu[:, self.names.index(offset)]), self.weights)

    def between(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Of the standard deviation of log rates between arms: median and 95 % interval."""
        return median_interval(self.tau[:, self.names.index(offset)], self.weights)

    def beyond(self, offset: str, rate: float) -> float:
        """Posterior probability that the median rate of the model's arms is above this one. mu is smoothed by
        a normal kernel (Silverman 1986), which makes the tails a little longer: few samples never say 1."""
        mu = self.mu[:, self.names.index(offset)]
        std = math.sqrt(self.weights @ (mu - self.weights @ mu) ** 2)
        width = max(std, 1e-6) * self.effective ** (-1 / 5)
        return min(1.0, float(self.weights @ special.ndtr((mu - math.log(rate)) / width)))


@dataclass(eq=False)
class _Cloud:
    """The `nodes` of an arm's rates (their logarithms) and their log-likelihood (K,); the `columns` of its
    offsets among those of the model, -1 where that is not modelled."""

    series: Series
    jumps: Matrix
    nodes: Nodes
    log_likelihood: Matrix
    columns: Matrix

    @property
    def kept(self) -> Matrix:
        """(K,) those that the results do not all but exclude."""
        return np.asarray(self.log_likelihood > self.log_likelihood.max() - _EXCLUDED)

    @property
    def base(self) -> Matrix:
        """(K,) the logarithm of likelihood and prior of what is not modelled, over their density."""
        apart = self.nodes.points[:, self.columns < 0] - _CENTRE
        over = self.nodes.against - 0.5 * (apart**2).sum(axis=1) / SPREAD**2
        return np.asarray(self.log_likelihood + over)

    def extend(self, mu: Matrix, tau: Matrix, seed: int) -> None:
        """More rates about the product of the arm's likelihood, taken as normal, and of N(mu, tau^2)."""
        weights = normalised(self.log_likelihood + self.nodes.over)
        x = (self.nodes.points - _CENTRE) / SPREAD  # standard normal by the prior
        mean = weights @ x
        spread, axes = np.linalg.eigh((weights[:, None] * (x - mean)).T @ (x - mean))
        sharper = np.maximum(1 / np.maximum(spread, 1e-6) - 1, 0.0)
        pulled = np.where(sharper > 0, (axes.T @ mean) / np.maximum(spread, 1e-6), 0.0)
        modelled = self.columns >= 0
        at = self.columns[modelled]
        precision, centre = np.ones(len(mean)), np.zeros(len(mean))
        precision[modelled] = (SPREAD / tau[at]) ** 2
        centre[modelled] = (mu[at] - _CENTRE) / SPREAD
        covariance = np.linalg.inv((axes * sharper) @ axes.T + np.diag(precision))
        middle = covariance @ (axes @ pulled + precision * centre)
        root = _WIDER * SPREAD * np.linalg.cholesky(covariance)
        self.add((_CENTRE + SPREAD * middle, root), seed)

    def add(self, near: Pass, seed: int) -> None:
        """The points of one more pass."""
        points = from_pass(near, _MORE, seed)
        log_likelihood = smooth(self.series, np.exp(points), self.jumps).log_likelihood
        self.nodes = self.nodes.followed_by(near, points)
        self.log_likelihood = np.concatenate([self.log_likelihood, log_likelihood])


@dataclass(frozen=True, eq=False)
class _Stack:
    """The kept rates of the A arms of a model one below the other, R in all: `features` (R, 2 n) are squares
    and values of their logarithms from the prior's median, 0 for an offset that the arm does not have;
    `base` (R,) as of each arm, up to a constant; `begins` (A,) where each begins, `present` (A, n) its
    offsets."""

    features: Matrix
    base: Matrix
    begins: Index
    present: Matrix

    @staticmethod
    def of(clouds: Sequence[_Cloud], size: int) -> _Stack:
        """Of n = `size` offsets that are modelled."""
        features, bases = [np.zeros((0, 2 * size))], [np.zeros(0)]
        present = np.zeros((len(clouds), size))
        for k, cloud in enumerate(clouds):
            kept, modelled = cloud.kept, cloud.columns >= 0
            x = np.zeros((int(kept.sum()), size))
            x[:, cloud.columns[modelled]] = cloud.nodes.points[np.ix_(kept, modelled)] - _CENTRE
            present[k, cloud.columns[modelled]] = 1.0
            features.append(np.concatenate([x**2, x], axis=1))
            base = cloud.base[kept]
            bases.append(base - base.max())
        begins = np.cumsum([*map(len, bases)])[:-1]
        return _Stack(np.concatenate(features), np.concatenate(bases), begins, present)

    @cached_property
    def arm(self) -> Index:
        """(R,) which arm each is of."""
        return np.repeat(np.arange(len(self.begins)), np.diff(self.begins, append=len(self.base)))

    @cached_property
    def _single(self) -> tuple[list[Matrix], list[Matrix]]:
        """Features and base of each arm in single precision, which takes a fourth of the time and is far
        finer than the number of rates is."""
        parts = (self.features.astype(np.float32), self.base.astype(np.float32))
        return np.split(parts[0], self.begins[1:]), np.split(parts[1], self.begins[1:])

    def log_weights(self, k: int, mu: Matrix, tau: Matrix) -> Matrix:
        """(H, K) of the rates of arm k for `mu`, `tau` (H, n), up to a constant of the arm."""
        linear, constant = _normal(mu, tau)
        features, base = self._single[0][k], self._single[1][k]
        log_weights = linear.astype(base.dtype) @ features.T
        log_weights += base
        log_weights -= (constant @ self.present[k])[:, None].astype(base.dtype)
        return np.asarray(log_weights)

    def weights(self, k: int, mu: Matrix, tau: Matrix) -> Matrix:
        """(K, H) of the rates of arm k, which sum to 1 for each `mu`, `tau`."""
        return normalised(self.log_weights(k, mu, tau).T.astype(float))

    def log_likelihood(self, mu: Matrix, tau: Matrix) -> Matrix:
        """(H,) of all arms together, up to a constant."""
        each = (_log_sum(self.log_weights(k, mu, tau)) for k in range(len(self.begins)))
        return np.asarray(sum(each, np.zeros(len(mu))))

    def density(self, at: Matrix) -> tuple[float, Matrix]:
        """The logarithm of the density of the coordinates `at` (2 n,) up to a constant, and its gradient."""
        size = len(at) // 2
        mu, tau = _model(at[None])
        (linear,), (constant,) = _normal(mu, tau)
        log_weights = self.features @ linear + self.base
        most = np.maximum.reduceat(log_weights, self.begins)
        arm = self.arm
        weights = np.exp(log_weights - most[arm])
        total = np.add.reduceat(weights, self.begins)
        value = float((most + np.log(total) - self.present @ constant).sum()) - 0.5 * float(at @ at)
        squared, mean = np.split((weights / total[arm]) @ self.features, 2)
        centre, variance, count = mu[0] - _CENTRE, tau[0] ** 2, self.present.sum(axis=0)
        by_mu = (mean - count * centre) / variance
        by_log_tau = (squared - 2 * centre * mean + count * centre**2) / variance - count
        within = (1 - LEAST) * special.ndtr(-at[size:])
        slope = (1 - LEAST) * np.exp(-0.5 * at[size:] ** 2) / math.sqrt(2 * math.pi)  # of rho
        by_rho = by_log_tau / (2 * (1 - within)) - by_mu * (SPREAD * at[:size]) / (2 * np.sqrt(within))
        return value, np.concatenate([by_mu * SPREAD * np.sqrt(within), by_rho * slope]) - at

    def mode(self) -> Matrix:
        """(2 n,) where the density of mu and rho is highest."""
        size = self.present.shape[1]
        if not size:
            return np.zeros(0)
        result = optimize.minimize(
            lambda at: tuple(-part for part in self.density(at)),
            np.zeros(2 * size),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-6, 6)] * (2 * size),
            options={"gtol": 1e-3, "ftol": 1e-8},
        )
        return np.asarray(result.x)

    def about_mode(self, mode: Matrix) -> Matrix:
        """A root (2 n, 2 n) of the covariance about the mode, by differences of the gradient."""
        steps = _STEP * np.eye(len(mode))
        curved = [(self.density(mode - d)[1] - self.density(mode + d)[1]) / (2 * _STEP) for d in steps]
        precision = np.reshape(curved, (len(mode), len(mode)))
        values, axes = np.linalg.eigh((precision + precision.T) / 2)
        return np.asarray(_NEAR * axes / np.sqrt(np.maximum(values, 0.5)))


def model_rates(drifts: Sequence[Drift], seed: int = 0) -> ModelRates:
    """The drift rates of the arms of one model, by the drift of each."""
    with_rate = {name for arm in drifts for name in arm.series.names if arm.determines_rate(name)}
    names = tuple(sorted(with_rate, key=lambda name: (len(name), name)))
    clouds = [_cloud(arm, names) for arm in drifts]
    stack = _Stack.of(clouds, len(names))
    for number in range(_ROUNDS):
        mu, tau = _model(stack.mode()[None])
        few = [k for k in range(len(clouds)) if effective(stack.weights(k, mu, tau)[:, 0]) < ENOUGH]
        for turn, k in enumerate(few):
            clouds[k].extend(mu[0], tau[0], seed + 1000 * (number + 1) + turn)
        if not few:
            break
        stack = _Stack.of(clouds, len(names))
    mode = stack.mode()
    passes = [(np.zeros(len(mode)), np.eye(len(mode))), (mode, stack.about_mode(mode))]

    def log_likelihood(points: Matrix) -> Matrix:
        parts = np.split(points, range(_AT_ONCE, len(points), _AT_ONCE))
        return np.concatenate([stack.log_likelihood(*_model(part)) for part in parts])

    nodes, log_likelihoods = sampled(log_likelihood, passes, _PASSES, _NODES, seed)
    weights = normalised(log_likelihoods + nodes.over)
    mu, tau = _model(nodes.points)
    some = np.searchsorted(np.cumsum(weights), (np.arange(_SOME) + 0.5) / _SOME)
    arms = tuple(_arm(cloud, mu[some], tau[some], seed) for cloud in clouds)
    return ModelRates(names, mu, tau, weights, effective(weights), arms)


def _cloud(drift: Drift, names: tuple[str, ...]) -> _Cloud:
    columns = [names.index(name) if name in names else -1 for name in drift.series.names]
    nodes = Nodes.of(np.log(drift.rates), drift.passes)
    return _Cloud(drift.series, drift.allowed, nodes, drift.smoothed.log_likelihood, np.array(columns))


def _arm(cloud: _Cloud, mu: Matrix, tau: Matrix, seed: int) -> ArmRates:
    """The rates of an arm given `mu` and `tau` (H, n): more of them, about those that agree where the fewest
    do, while fewer than `FEW` agree on average."""
    for number in range(_AGAIN + 1):
        of_each = _Stack.of([cloud], mu.shape[1]).weights(0, mu, tau)  # (K, H)
        agreeing = 1 / (of_each**2).sum(axis=0)
        if agreeing.mean() >= FEW or number == _AGAIN:
            break
        near = about(cloud.nodes.points[cloud.kept], of_each[:, agreeing.argmin()])
        cloud.add(near, seed + 10_000 + number)
    rates = np.exp(cloud.nodes.points[cloud.kept])
    return ArmRates(cloud.series.names, rates, of_each.mean(axis=1), float(agreeing.mean()))


def _normal(mu: Matrix, tau: Matrix) -> tuple[Matrix, Matrix]:
    """What multiplies the features (H, 2 n), and minus what each offset adds (H, n), of log N(mu, tau^2)."""
    precision, centre = 1 / tau**2, mu - _CENTRE
    linear = np.concatenate([-0.5 * precision, precision * centre], axis=1)
    return linear, 0.5 * precision * centre**2 + np.log(tau)


def _log_sum(log_weights: Matrix) -> Matrix:
    """(H,) of (H, K), which is overwritten."""
    most = log_weights.max(axis=1)
    log_weights -= most[:, None]
    np.exp(log_weights, out=log_weights)
    return np.asarray(most.astype(float) + np.log(log_weights.sum(axis=1, dtype=float)))


def _model(points: Matrix) -> tuple[Matrix, Matrix]:
    """mu and tau (H, n) of standard normal coordinates (H, 2 n)."""
    size = points.shape[1] // 2
    z, share = points[:, :size], points[:, size:]
    within = (1 - LEAST) * special.ndtr(-share)  # 1 - rho
    return _CENTRE + SPREAD * np.sqrt(within) * z, SPREAD * np.sqrt(1 - within)
