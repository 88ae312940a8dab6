"""Problems whose shots nearly hit, and what they are by the plain model."""

from typing import Any

import numpy as np
from cells import plan_of, simulated_problem
from plain_model import Arm, beam, by_complex_steps, covariance, miss, square
from scipy import stats

from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem

LASER = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
OPEN_LASER = {**LASER, "calibrated": False}
PROBE = {"kind": "probe", "point_mm": [10, 20, 100]}
OPEN_PROBE = {**PROBE, "calibrated": False}
TOOLS = {"laser": LASER, "open laser": OPEN_LASER, "probe": PROBE, "open probe": OPEN_PROBE}
SEEN = ("a", "b", "a", "a", "b", "a", "b", "b")  # targets of the shots
DISTANCE = [{"between": ["b", "a"], "mm": 60, "sigma_mm": 0.5}]


def header(
    tool: dict[str, Any] = LASER, *, geometry: dict[str, Any] | str | None = "exact", **changes: Any
) -> Header:
    """Exact geometry unless stated otherwise; None: no such key, a typical arm."""
    noise = {"joint_deg": 0.01, "joint_mm": 0.02, "spot_mm": 0.05}
    content = {"robot": "irb1600", "tool": tool, "noise": noise, **changes}
    if geometry is not None:
        content["geometry"] = geometry
    return Header.model_validate(content)


class Made:
    """A problem whose shots miss their targets by up to `near` mm at the parameters `x`."""

    def __init__(self, own: Arm, stated: Header, *, seen=SEEN, seed=0, near=0.5) -> None:
        rng = np.random.default_rng(seed)
        self.arm = own
        n, d = own.robot.n, 2 if stated.tool.kind == "laser" else 3
        joints = np.array([own.random(rng) for _ in seen])
        spots = rng.normal(scale=0.3, size=(len(seen), d)) if d == 2 else np.zeros((len(seen), d))
        self.problem = Problem.build(stated, own.robot, joints, seen, spots)
        parameters = self.problem.parameters
        self.x = parameters.prior_mean + 0.3 * parameters.prior_std * rng.normal(size=len(parameters))
        delta, unknowns = self.problem.split(self.x).arm, self.problem.split(self.x).tool
        first = [seen.index(name) for name in self.problem.targets]
        for k, i in enumerate(first):
            # The target is where the first of its shots has it.
            y = unknowns if len(unknowns) else self.problem.tool.point
            if d == 2:
                p, u = beam(self.problem.tool, unknowns)
                y = p + 700 * u
            flange = own.pose(joints[i] + delta).real
            self.x[parameters.block("target", k)] = flange[:3, 3] + flange[:3, :3] @ y
        for i, k in enumerate(self.problem.target_index):
            if i not in first:
                joints[i] = joints[first[k]] + rng.uniform(-30, 30, n) / own.robot.display
            self._aim(i, rng.uniform(-near, near, d))

    def _aim(self, shot: int, wanted: np.ndarray) -> None:
        """Turn the joints of one shot until its miss is the wanted one: Gauss-Newton on the plain model."""
        joints, lengths = self.problem.joints, np.where(self.arm.robot.display == 1, 1000.0, 1.0)
        for _ in range(50):
            short = wanted - self.miss(self.x, shot).real
            if np.abs(short).max() < 1e-6:
                return
            by_joints = by_complex_steps(lambda q: self.miss(self.x, shot, q), joints[shot]) * lengths
            step = np.linalg.lstsq(by_joints, short, rcond=None)[0]
            joints[shot] += step * lengths * min(1.0, 0.3 / np.abs(step).max())
        raise AssertionError("this shot cannot be turned onto its target: choose another seed")

    def free(self, x: np.ndarray, shot: int) -> np.ndarray:
        """delta, the shot's target, tool in one vector; here and below, x may be many (..., p)."""
        parts = self.problem.split(x)
        target = parts.targets[..., self.problem.target_index[shot], :]
        return np.concatenate([parts.arm, target, parts.tool], axis=-1)

    def miss(self, x: np.ndarray, shot: int, q: np.ndarray | None = None) -> np.ndarray:
        problem = self.problem
        q = problem.joints[shot] if q is None else q
        return miss(self.arm.pose, problem.tool, q, problem.spots[shot], self.free(x, shot))

    def variances(self, x: np.ndarray) -> np.ndarray:
        """(..., n + 1) with the noise factors at x, if there are any."""
        noise, n = self.problem.noise, self.problem.robot.n
        content = np.append(noise.joint**2, noise.spot**2)
        if not noise.separate:
            return content
        return content * np.repeat(np.exp(x[..., -2:]) ** 2, (n, 1), axis=-1)

    def covariance(self, x: np.ndarray, shot: int) -> np.ndarray:
        """(..., d, d), complex if x is."""
        problem = self.problem
        shot_of = (problem.joints[shot], problem.spots[shot], self.free(x, shot))
        return covariance(self.arm, problem.tool, *shot_of, self.variances(x))

    def gaussians(self, x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Miss and covariance of every shot."""
        shots = range(self.problem.shots)
        return [(self.miss(x, i).real, self.covariance(x, i).real) for i in shots]

    def distances(self, x: np.ndarray) -> np.ndarray:
        """(..., D) by how many of its stds each stated distance is missed, complex if x is."""
        targets, content = self.problem.split(x).targets, self.problem.distances
        between = [targets[..., each.second, :] - targets[..., each.first, :] for each in content]
        lengths = [np.sqrt((v * v).sum(axis=-1)) for v in between]
        missed = [(v - each.mm) / each.sigma for v, each in zip(lengths, content, strict=True)]
        return np.stack(missed, axis=-1) if missed else np.zeros((*x.shape[:-1], 0))

    def stated(self, x: np.ndarray) -> list[np.ndarray]:
        """S (d, d) of every shot at the stated noise: that of the factors 1."""
        z = x.copy()
        if self.problem.noise.separate:
            z[..., -2:] = 0
        return [self.covariance(z, i) for i in range(self.problem.shots)]

    def log_density(self, x: np.ndarray) -> float:
        """Log-likelihood at known or separate noise: each miss's density over that of no miss at the stated
        noise, which no unit of the miss changes."""
        total = -(self.distances(x) ** 2).sum() / 2
        for (m, s), content in zip(self.gaussians(x), self.stated(x), strict=True):
            zero = np.zeros(len(m))
            total += stats.multivariate_normal.logpdf(m, zero, s)
            total -= stats.multivariate_normal.logpdf(zero, zero, content.real)
        return float(total)

    def log_posterior(self, x: np.ndarray) -> np.ndarray:
        """(...) with the prior, for complex steps."""
        problem, parameters = self.problem, self.problem.parameters
        quad, logdet = 0.0, 0.0
        for i, content in enumerate(self.stated(x)):
            m, s = self.miss(x, i), self.covariance(x, i)
            quad = quad + square(m, s)
            logdet = logdet + np.log(np.linalg.det(s) / np.linalg.det(content))
        if problem.noise.estimated:
            quad = problem.shots * problem.tool.residual_size * np.log(quad)
        z = ((x - parameters.prior_mean) / parameters.prior_std)[..., parameters.free]
        return -(quad + logdet + (self.distances(x) ** 2).sum(axis=-1) + (z**2).sum(axis=-1)) / 2

    def steps(self, rad: float, mm: float) -> np.ndarray:
        return np.where(self.problem.parameters.display == 1, mm, rad)

    def walkers(self, count: int, seed: int = 3) -> np.ndarray:
        """(count, p) about x, near enough that the likelihoods stay moderate."""
        rng = np.random.default_rng(seed)
        parameters = self.problem.parameters
        steps = np.where(parameters.group("noise"), 0.3, self.steps(1e-3, 1.0))
        return self.x + rng.normal(size=(count, len(self.x))) * steps


def many_runs(
    plan: Plan, values: dict[str, float], count: int, seed: int
) -> tuple[np.ndarray, Problem, np.ndarray, np.ndarray]:
    """`count` simulated runs of one plan: the true x (p,), the plan's problem, and what was recorded, the
    joints (count, N, n) and spots (count, N, d).

    The simulated cell shoots all of them as one long run.
    """
    shots = len(plan.postures)
    long = plan_of(plan.header, np.tile(plan.postures, (count, 1)), plan.targets * count, plan.robot)
    truth, recorded = simulated_problem(long, values, seed)
    joints = recorded.joints.reshape(count, shots, -1)
    return truth.x, Problem.from_plan(plan), joints, recorded.spots.reshape(count, shots, -1)
