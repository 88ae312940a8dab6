"""Simulated runs of one plan, each with true parameters of its own, and what estimators make of them; the
arm, laser and PSD that the studies of laser plans share.

Some estimators are controls, whose intervals must not contain the true value.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import PlainSerializer, PlainValidator

from ...analysis.estimation.fit import Fits, fit_each
from ...analysis.estimation.midpoint import fit_midpoints
from ...model.arrays import Index, Mask, Matrix
from ...model.files.from_arrays import Laser
from ...model.files.header import EXACT, Header
from ...model.files.robot_file import load_robot
from ...model.kinematics.robot import Robot
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem
from ..plans.candidates import CandidatePostures, candidates
from ..plans.optimal import Planner
from ..plans.patterns import pattern
from ..simulate import simulated_readings

MEASUREMENTS = 7
SIGMA_MM = 30.0  # to which a person knows the PSD; without a camera the beam is searched for around it
_TARGET = (950.0, 150.0, 100.0)
_FURTHER = 3.0  # how often more truths are drawn than needed, should some not be met
_PINV = 1e-12  # of J'J: directions below 1e-6 of the largest singular value are dropped, as is customary


@dataclass(frozen=True, eq=False)
class DataSets:
    """W simulated runs of one plan: true parameters `truths` (W, p), `joints` (W, M, n) and `spots` as
    recorded; of `failed` further truths the arm cannot hit the target."""

    problem: Problem
    truths: Matrix
    joints: Matrix
    spots: Matrix
    failed: int

    def some(self, rows: slice) -> DataSets:
        """Some of them; those that failed are counted with all."""
        return DataSets(self.problem, self.truths[rows], self.joints[rows], self.spots[rows], 0)


def laser_header(
    joint_deg: float,
    spot_mm: float,
    sigma_mm: float | None = None,
    *,
    robot: str = "irb1600",
    target: tuple[float, ...] = _TARGET,
    exact: bool = True,
) -> Header:
    """The paper's arm, or another, with a calibrated laser, and a PSD near `target`, with the prior
    `sigma_mm` if any; arm and tool are exact as in the paper, or nothing of their geometry is stated."""
    psd = {"guess_mm": list(target), **({} if sigma_mm is None else {"sigma_mm": sigma_mm})}
    content = {
        "robot": robot,
        "tool": Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)).content(),
        "noise": {"joint_deg": joint_deg, "spot_mm": spot_mm},
        "targets": {"psd": psd},
        **({"geometry": EXACT} if exact else {}),
    }
    return Header.model_validate(content)


def robot_of(header: Header) -> Robot:
    """The built-in arm of a header."""
    return load_robot(header.robot, Path())


def _psd(header: Header) -> Matrix:
    return np.array(header.targets["psd"].guess_mm)


def y_postures(header: Header, span: float | None = None) -> Matrix:
    """(7, n) rad: our Y-Pattern over the arm's whole reach, or a share `span` of it."""
    return pattern(header, robot_of(header), _psd(header), "y", MEASUREMENTS, span=span)


def candidate_postures(header: Header, count: int, seed: int) -> CandidatePostures:
    return candidates(header, robot_of(header), _psd(header), count, seed=seed)


def planner(header: Header, count: int, seed: int) -> Planner:
    """The planner that chooses the best of `count` random postures."""
    random_postures = candidate_postures(header, count, seed)
    return Planner(header, robot_of(header), {"psd": _psd(header)}, [random_postures])


def optimal_postures(header: Header, count: int, seed: int) -> Matrix:
    """(7, n) rad: the A-optimal ones of `count` random postures."""
    return planner(header, count, seed).optimal(MEASUREMENTS, seed=seed).postures


def drawn(problem: Problem, count: int, rng: np.random.Generator, spread: Matrix | None = None) -> DataSets:
    """Truths drawn from the priors, or with the stds `spread` (p,), and one run of the problem's postures
    with each. What is held stays held."""
    parameters = problem.parameters
    spread = parameters.prior_std if spread is None else spread
    truths = np.empty((0, len(parameters)))
    joints, spots, tried = [], [], 0
    while len(truths) < count and tried < _FURTHER * count:
        some = count - len(truths)
        x = np.tile(parameters.prior_mean, (some, 1))
        x += np.where(parameters.free, rng.normal(size=x.shape) * spread, 0.0)
        readings = simulated_readings(problem, x, rng)
        truths = np.vstack([truths, x[readings.met]])
        joints.append(readings.joints[readings.met])
        spots.append(readings.spots[readings.met])
        tried += some
    return DataSets(problem, truths, np.concatenate(joints), np.concatenate(spots), tried - len(truths))


def fitted(data: DataSets) -> Fits:
    """The likelihood fit of every data set, as `analyse` fits a single run."""
    return fit_each(data.problem, data.joints, data.spots)


def _of_bytes(values: object) -> Matrix:
    if isinstance(values, np.ndarray):
        return values
    return np.frombuffer(base64.b64decode(str(values)), dtype="<f8").astype(float)


def _as_bytes(values: Matrix) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


# Kept in a file to the last bit, but for its shape.
StoredMatrix = Annotated[Matrix, PlainValidator(_of_bytes), PlainSerializer(_as_bytes)]
StoredMask = Annotated[
    Mask, PlainValidator(lambda kept: np.array(kept, dtype=bool)), PlainSerializer(lambda kept: kept.tolist())
]


@dataclass(frozen=True, eq=False)
class Estimates:
    """Of m offsets: estimates and standard uncertainties (W, m), internal units; `kept` (W,) says which data
    sets converged. A `control` is wrong on purpose."""

    name: str
    words: str
    control: bool
    value: StoredMatrix
    std: StoredMatrix
    kept: StoredMask


def with_half_the_noise(problem: Problem) -> Problem:
    """The problem of a control, whose intervals are too short by 2."""
    return replace(problem, noise=problem.noise.times(0.5))


def likelihood(data: DataSets, fits: Fits, which: Index) -> Estimates:
    """The intervals from the curvature at the modes, of the parameters `which` (m,)."""
    words = "likelihood fit, intervals from the curvature"
    return _of_fits("likelihood", words, data.problem.parameters, fits, which)


def understated(data: DataSets, which: Index) -> Estimates:
    """Control: the likelihood fit with half of the true noise."""
    half = with_half_the_noise(data.problem)
    fits, words = fitted(replace(data, problem=half)), "control: the noise stated as half of what it is"
    return _of_fits("noise understated by 2", words, half.parameters, fits, which, control=True)


def midpoint(data: DataSets, which: Index) -> Estimates:
    """The paper's cost (eq. 8) with the sandwich covariance; its geometry is nominal, as in the paper."""
    problem = data.problem.with_geometry(NOMINAL)  # the offsets stay where they are: they come first
    fits = fit_midpoints(problem, data.joints)
    at = (np.cumsum(fits.free) - 1)[which]  # the targets are no part of this fit
    std = np.sqrt(np.diagonal(fits.covariance, axis1=1, axis2=2)[:, at]) * problem.parameters.prior_std[which]
    words = "midpoint fit of the paper (eq. 8), intervals from its sandwich covariance"
    return Estimates("midpoint", words, False, fits.x[:, which], std, fits.converged)


def pseudo_inverse(data: DataSets, fits: Fits, which: Index) -> Estimates:
    """Control: the same estimates with the covariance pinv(J'J), as truncating solvers give it."""
    parameters, std = data.problem.parameters, np.empty((len(fits.x), len(which)))
    for row, (x, joints, spots) in enumerate(zip(fits.x, data.joints, data.spots, strict=True)):
        jacobian = data.problem.moved(joints, spots).whiten(x).jacobian[:, parameters.free]
        variance = np.diag(np.linalg.pinv(jacobian.T @ jacobian, rcond=_PINV, hermitian=True))
        std[row] = np.sqrt(variance[parameters.among_free[which]])
    words = "control: the same fit with a pseudo-inverse for a covariance"
    std *= parameters.prior_std[which]
    return Estimates("pseudo-inverse covariance", words, True, fits.x[:, which], std, fits.converged)


def _of_fits(
    name: str, words: str, parameters: Parameters, fits: Fits, which: Index, *, control: bool = False
) -> Estimates:
    std = fits.std[:, parameters.among_free[which]] * parameters.prior_std[which]
    return Estimates(name, words, control, fits.x[:, which], std, fits.converged)
