"""Steps inside a recording: measurements whose residuals are off together, as if the target had moved.

A socket that slips, or settles after some measurements, shifts the residuals of a run of measurements by one
vector in the target's frame. For every run of a recording (a run to its end is a single change) the drop of
the residuals' sum of squares by such a shift is taken, over the sum itself, so that the size of the noise
does not matter; the largest is compared with the largest of simulated recordings without a step, whose
residuals are as correlated as these. Circular binary segmentation (Olshen et al., Biostatistics 5, 2004), for
vectors.

Joints that do not move between measurements look much like it: their errors are common to these, and shift
all residuals. The noise of a joint is stated for each reading. Of a joint that rests over some postures the
error stays what it is: as large as stated, but one for all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..covariance import drawn_by_covariance
from ..estimation.fit import LikelihoodFit
from ..left_over import Contradiction, holm
from ..status import LACK_OF_FIT
from .recordings import (
    LARGE,
    SIGNIFICANCE,
    RecordedPart,
    Recording,
    correlation,
    covariance,
    drawn,
    equalised,
    lags,
    recordings,
    rho_of,
    traces,
    white_times,
)

_RESTS = 0.5  # of its noise: a joint that is read within so little has not moved
_LARGEST = 4.0  # standard deviations of an error: a larger one is none of the stated noise
_MOST = 200  # joints' rests
_SHORTEST_REST = 3  # measurements of a rest


def rests(problem: Problem) -> Iterator[tuple[int, Index]]:
    """Each joint with the rows of measurements, one after the other, over which it rests; not where it rests
    over all: its error is then a part of its offset."""
    joints, count = problem.joints, problem.shots
    for joint in range(problem.robot.n):
        still = _RESTS * problem.noise.joint[joint]
        first = 0
        for row in range(1, count + 1):
            if row < count and np.ptp(joints[first : row + 1, joint]) <= still:
                continue
            if _SHORTEST_REST <= row - first < count:
                yield joint, np.arange(first, row)
            first = row


def resting_columns(fit: LikelihoodFit) -> Matrix | None:
    """(M, g) what a common error of one standard deviation of each resting joint does to the whitened
    residuals at the mode, of those whose error the stated noise allows. None without any."""
    problem, d = fit.problem, fit.problem.tool.residual_size
    every = sorted(rests(problem), key=lambda one: -len(one[1]))[:_MOST]
    if not every:
        return None
    whitened, parameters = fit.whitened, problem.parameters
    columns = np.zeros((len(whitened.residual), len(every)))
    for k, (joint, rows) in enumerate(every):
        at = (rows[:, None] * d + np.arange(d)).ravel()
        std = problem.noise.joint[joint] / parameters.prior_std[joint]
        columns[at, k] = whitened.jacobian[at, joint] * std
    free = whitened.jacobian[:, parameters.free]
    for _ in range(3):
        both = np.hstack([free, columns])
        rows = np.vstack([both, np.eye(both.shape[1])])
        left = np.append(whitened.residual, np.append(fit.z, np.zeros(columns.shape[1])))
        errors = -np.linalg.lstsq(rows, left, rcond=None)[0][free.shape[1] :]
        allowed = np.abs(errors) <= _LARGEST
        if allowed.all():
            break
        columns = columns[:, allowed]
    return columns if columns.shape[1] else None


_FEWEST = 6  # measurements of a recording that is tested
_FEWEST_LEFT = 12.0  # degrees of freedom that the fit leaves to it
_SHORTEST = 2  # measurements of a run, and of the rest
_PLACES = 60  # at most so many places of a change: of a longer recording every second, third…
_SIMULATED = 300
_NUMBERS = 1_000_000  # simulated residuals at once
_DETERMINED_MM = 10.0  # a direction that the measurements determine no better is free
_EULER = float(np.euler_gamma)
_RHO_STEP = 0.05
# The only significant step of a hundred typical arms at rest has 1.9; steps of forty with a target moved by
# 1 mm have 2.5 to 5.4, and those of sockets that slipped on real arms (panda_2, kuka_14) 3.6 to 6.2.
_STANDS_OUT = 2.0


@record
class RecordingStep(Contradiction, RecordedPart):
    """A run of measurements of one recording that are off together, or the rest is off these by the opposite.
    Of a `station` it is the instrument that is off, relative to the base."""

    kind: Annotated[Literal["step"], it("of the criterion")] = field(default="step", kw_only=True)

    shift_mm: Annotated[
        tuple[float | None, ...],
        it(
            "of the target against the rest of the recording, base frame, mm; null for an undetermined"
            " component"
        ),
    ]
    size_mm: Annotated[float | None, it("length of the shift, mm; null while a component is undetermined")]
    p_value: Annotated[float, it("Holm-adjusted over the recordings; below 0.01")]
    factor: Annotated[
        float,
        it(
            "the root mean square of the shifted residuals over that of the others; a misfit from 2 on, if"
            " the p-value is below 0.001"
        ),
    ]
    station: Annotated[bool, it("whether it is an instrument that stands in the world")] = False

    @property
    def contradicts(self) -> bool:
        """Whether it speaks against the model: at the level of every test of a fit, and beyond what else
        scatters in the recording. Errors of an arm that change slowly along a row of postures are steps of
        the size of that scatter."""
        return self.p_value < LACK_OF_FIT and self.factor > _STANDS_OUT


@dataclass(frozen=True)
class RecordingSteps:
    """`rows` are the significant steps, one at most of each recording, the clearest first; `tested` of
    `recordings` are long enough."""

    rows: tuple[RecordingStep, ...]
    tested: int
    recordings: int


class Runs(NamedTuple):
    """All runs of a recording: from measurement `first` (S,) to before `end` (S,); `whitening` (S, 3, 3)
    turns the sum of the residuals over a run into the root of the drop, along `vectors` (S, 3, 3) of which
    those `determined` (S, 3) count."""

    first: Index
    end: Index
    whitening: Matrix
    vectors: Matrix
    determined: Mask


def steps(fit: LikelihoodFit, rival: Matrix | None = None) -> RecordingSteps:
    """The significant steps inside the recordings at the mode; `rival` as of `recordings`."""
    clearest, count = all_steps(fit, rival) if fit.converged else ([], 0)
    rows = tuple(
        sorted((step for step in clearest if step.p_value < SIGNIFICANCE), key=lambda step: step.p_value)
    )
    return RecordingSteps(rows, len(clearest), count)


def all_steps(fit: LikelihoodFit, rival: Matrix | None = None) -> tuple[list[RecordingStep], int]:
    """The clearest run of each recording that is long enough, significant or not, and how many recordings
    there are."""
    recorded = recordings(fit, rival)
    every, plain = recorded.every, recorded.shared(0.0)
    tested = [
        i
        for i, recording in enumerate(every)
        if recording.shots >= _FEWEST and traces(recording, 0.0, plain)[0] >= _FEWEST_LEFT
    ]
    lag = lags(recorded) if tested else {}
    tested = [i for i in tested if i in lag]
    if not tested:
        return [], len(every)
    together = equalised(list(lag.values()))
    # The end of the grid where the residuals do not determine a significant correlation: the safe side.
    shared = rho_of(together) if correlation(together)[1] < SIGNIFICANCE else 0.0
    by_rho: dict[float, Matrix] = {0.0: plain}
    clearest = []
    rng = np.random.default_rng(0)
    for i in tested:
        recording = every[i]
        runs = _runs(recording)
        best, size = _largest(recording, runs, recording.residual[None])
        size_mm, design = _size(recording, runs, int(best[0]))
        shift = design.reshape(-1, 3) @ size_mm
        moved = white_times(recording, by_rho[0.0], shift)
        left = recording.residual + moved.reshape(recording.residual.shape)
        alone = lag[i]._replace(product=float((left[1:] * left[:-1]).sum()), square=float((left**2).sum()))
        rho = max(0.0, shared, rho_of([alone]))
        rho = min(0.95, round(rho / _RHO_STEP) * _RHO_STEP)
        if rho not in by_rho:
            by_rho[rho] = recorded.shared(rho)
        simulated = _simulated(recording, runs, rho, by_rho[rho], rng)
        run = int(runs.end[best[0]] - runs.first[best[0]])
        factor = float(np.linalg.norm(shift) / np.linalg.norm(left) * np.sqrt(recording.shots / run))
        p_value = _gumbel(float(size[0]), simulated)
        clearest.append(_step(fit, recording, runs, int(best[0]), p_value, factor))
    adjusted = holm([step.p_value for step in clearest])
    return [replace(step, p_value=p) for step, p in zip(clearest, adjusted, strict=True)], len(every)


def _simulated(
    recording: Recording, runs: Runs, rho: float, shared: Matrix, rng: np.random.Generator
) -> Matrix:
    """(B,) the largest of simulated recordings without a step."""
    size = recording.residual.size
    if size <= LARGE:
        errors = drawn_by_covariance(covariance(recording, rho, shared), _SIMULATED, rng)
        return _largest(recording, runs, errors.reshape(_SIMULATED, *recording.residual.shape))[1]
    # Of a long recording some at a time, in bounded memory.
    at_once = max(1, min(_SIMULATED, _NUMBERS // size))
    counts = [min(at_once, _SIMULATED - k) for k in range(0, _SIMULATED, at_once)]
    parts = [_largest(recording, runs, drawn(recording, rho, shared, count, rng))[1] for count in counts]
    return np.concatenate(parts)


def _runs(recording: Recording) -> Runs:
    """All runs that are tested, by their information D'MD on a shift; M is what is left of errors."""
    shots, d = recording.residual.shape
    stride = -(-shots // _PLACES)
    changes = np.unique(np.append(np.arange(0, shots, stride), shots))
    first, end = (changes[k] for k in np.triu_indices(len(changes), 1))
    size = end - first
    # Of two complementary runs, which are one and the same step, the shorter.
    inside = (first > 0) & (end < shots)
    edge = ~inside & (2 * size <= shots)
    keep = (size >= _SHORTEST) & (size <= shots - _SHORTEST) & (inside | edge)
    first, end = first[keep], end[keep]
    blocks = recording.jacobian.reshape(shots, d, -1)
    shared = blocks.transpose(0, 2, 1) @ recording.by_target
    gram = _between(np.einsum("nda,ndb->nab", recording.by_target, recording.by_target), first, end)
    cross = _between(shared, first, end)
    gram = gram - cross.transpose(0, 2, 1) @ cross
    values, vectors = np.linalg.eigh(gram)
    determined = values > max(_DETERMINED_MM**-2, 1e-10 * float(values.max(initial=0.0)))
    safe = np.where(determined, values, 1.0)
    whitening = np.where(determined, 1 / np.sqrt(safe), 0.0)[:, :, None] * vectors.transpose(0, 2, 1)
    return Runs(first, end, whitening, vectors, determined)


def _between(parts: Matrix, first: Index, end: Index) -> Matrix:
    """(S, …) sums of `parts` (n, …) over runs."""
    total = np.concatenate([np.zeros_like(parts[:1]), np.cumsum(parts, axis=0)])
    return np.asarray(total[end] - total[first])


def _largest(recording: Recording, runs: Runs, residuals: Matrix) -> tuple[Index, Matrix]:
    """(B,) of recordings (B, n, d) the run whose shift explains most, and -log(1 - share of the squares)."""
    pull = np.einsum("nda,bnd->nba", recording.by_target, residuals)
    total = _between(pull, runs.first, runs.end)
    drop = ((total @ runs.whitening.transpose(0, 2, 1)) ** 2).sum(axis=2)
    share = drop / np.maximum((residuals**2).sum(axis=(1, 2)), 1e-300)
    best = np.argmax(share, axis=0)
    largest = np.minimum(share[best, np.arange(len(best))], 1 - 1e-12)
    return best, -np.log1p(-largest)


def _size(recording: Recording, runs: Runs, best: int) -> tuple[Matrix, Matrix]:
    """(3,) mm by which a target elsewhere over a run would explain its residuals, and (n, d, 3) the columns
    of the residuals by such a shift."""
    design = np.zeros((*recording.residual.shape, 3))
    run = slice(int(runs.first[best]), int(runs.end[best]))
    design[run] = recording.by_target[run]
    root = runs.whitening[best]
    return -(root.T @ root) @ np.einsum("nda,nd->a", design, recording.residual), design


def _step(
    fit: LikelihoodFit, recording: Recording, runs: Runs, best: int, p_value: float, factor: float
) -> RecordingStep:
    first, end = int(runs.first[best]), int(runs.end[best])
    shift, _ = _size(recording, runs, best)
    # A component with a part in an undetermined direction is undetermined.
    lost = np.abs(runs.vectors[best][:, ~runs.determined[best]]).sum(axis=1) > 1e-6
    numbers = fit.problem.shot_numbers
    return RecordingStep(
        recording.target,
        numbers[recording.rows[first]],
        numbers[recording.rows[end - 1]],
        end - first,
        tuple(None if gone else float(value) for value, gone in zip(shift, lost, strict=True)),
        None if lost.any() else float(np.linalg.norm(shift)),
        p_value,
        factor,
        fit.problem.is_station(recording.target),
    )


def _gumbel(value: float, simulated: Matrix) -> float:
    """The p-value of a largest value, by Gumbel's distribution of the moments of the simulated ones: the
    tail of -log(1 - share) is exponential (of a beta distribution), and simulations do not reach it."""
    scale = float(simulated.std(ddof=1)) * np.sqrt(6) / np.pi
    if scale == 0.0:  # a shift explains whatever there is
        return 1.0
    location = float(simulated.mean()) - _EULER * scale
    return float(-np.expm1(-np.exp(-(value - location) / scale)))
