"""Exact gauges of random arms whose geometry is free, against ranks in fifty digits.

The judge is that of test_gauges.py, with the links' parameters as further screws. A tolerance is knowledge:
what is a gauge is so with the geometry held; of the geometry, what is one with all of the others held.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from cells import good_plan, pattern_plan
from hypothesis import Phase, assume, example, given, settings
from mpmath import mpf

from zerobeam.analysis.observability.aim import aim
from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.model.arrays import Matrix
from zerobeam.model.likelihood.geometry import NOMINAL
from zerobeam.model.likelihood.problem import Problem

_spec = importlib.util.spec_from_file_location("judge", Path(__file__).with_name("test_gauges.py"))
assert _spec is not None
assert _spec.loader is not None
judge = importlib.util.module_from_spec(_spec)
sys.modules["judge"] = judge  # for its dataclasses
_spec.loader.exec_module(judge)

Kind, Cell, Exact = judge.Kind, judge.Cell, judge.Exact
cross, unit = judge.cross, judge.unit
_RESOLVED = mpf(10) ** -8  # of a pivot: what breaks a gauge by less, double precision need not tell from none
_STEP = 0.2  # mm, and hundredths of a degree, as in test_gauges.py


def freed(kind: Any) -> tuple[Any, Problem] | None:
    """The cell of a kind, and its problem with geometry: gravity and harmonics of every other seed."""
    cell = judge.cell(kind)
    if cell is None:
        return None
    bent = kind.seed % 2 == 0
    stated = {"gravity": bent, "harmonics": "auto" if bent else False, "up": [0.1, -0.2, 1.0]}
    data = cell.own.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    own = type(cell.own).model_validate({**data, "geometry": stated})
    cell = dataclasses.replace(cell, own=own)
    return cell, Problem.build(own, cell.robot, cell.joints, ["psd"] * len(cell.joints))


class Judge(judge.Judge):
    """Residuals and Jacobians of one cell in fifty digits: by offsets, geometry, target, tool."""

    def __init__(self, cell: Any, problem: Problem) -> None:
        super().__init__(cell)
        self.names = problem.geometry.names
        self.gravity = problem.geometry.gravity

    def chain(
        self, theta: Exact, own: dict[Any, mpf]
    ) -> tuple[Exact, Exact, list[Any], dict[Any, Any], list]:
        """Flange R, t (m); each joint's axis and a point on it; of each link parameter the same (no point of
        a shift); the ends of the links."""
        rotation, place, screws, links, ends = judge._EYE, judge._EYE[0] * 0, [], {}, []
        for i, row in enumerate(self.arm.rows):
            of = f"link{i + 1}"

            def value(axis: str, of: str = of) -> mpf:
                return own.get((of, axis), mpf(0))

            screws.append((rotation[:, 2], place))
            revolute = self.arm.kinds[i] == "r"
            c, s = judge.cos_sin(row.theta)
            ct, st = (mpmath.cos(theta[i]), mpmath.sin(theta[i])) if revolute else (mpf(1), mpf(0))
            c, s = c * ct - s * st, s * ct + c * st
            zero, one = mpf(0), mpf(1)
            rotation = rotation @ np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])
            along = mpf(row.d) / 1000 + (0 if revolute else theta[i]) + value("d")
            links[of, "d"] = (rotation[:, 2], None)
            links[of, "a"] = (rotation[:, 0], None)
            place = place + rotation @ np.array([mpf(row.a) / 1000 + value("a"), zero, along])
            for axis, k in (("theta", 2), ("alpha", 0), ("beta", 1)):
                links[of, axis] = (rotation[:, k], place)
                turn = judge._EYE.copy()
                a, b = (k + 1) % 3, (k + 2) % 3
                turn[a, a] = turn[b, b] = mpmath.cos(value(axis))
                turn[b, a] = mpmath.sin(value(axis))
                turn[a, b] = -turn[b, a]
                rotation = rotation @ turn
            ca, sa = judge.cos_sin(row.alpha)
            rotation = rotation @ np.array([[one, zero, zero], [zero, ca, -sa], [zero, sa, ca]])
            ends.append(place)
        return rotation, place, screws, links, ends

    def bending(self, q: Exact) -> dict[Any, Any]:
        """By how much each joint is moved by one of its bending: torques of the nominal arm, cos q, sin q."""
        rates: dict[Any, Any] = {}
        if self.gravity is not None:
            _, _, screws, _, ends = self.chain(q, {})
            up, masses = judge.exact(self.gravity.up), judge.exact(self.gravity.masses)
            for i in self.gravity.joints:
                axis, origin = screws[i]
                torque = -sum(masses[k] * (axis @ cross(ends[k] - origin, up)) for k in range(i, len(ends)))
                rates[f"joint{i + 1}", "gravity"] = torque / mpf(float(self.gravity.largest[i])) * 1000
        for i in range(len(q)):
            rates[f"joint{i + 1}", "cos"] = mpmath.cos(q[i])
            rates[f"joint{i + 1}", "sin"] = mpmath.sin(q[i])
        return rates

    def shot(self, values: Any, q: Exact) -> tuple[Exact, Exact]:
        n = len(self.arm.rows)
        own = dict(zip(self.names, values.delta[n:], strict=True))
        rates = self.bending(q)
        theta = q + values.delta[:n]
        for (of, axis), value in own.items():
            if of.startswith("joint"):
                theta[int(of[5:]) - 1] += value * rates[of, axis]
        rotation, place, screws, links, _ = self.chain(theta, own)

        def moved(axis: Exact, origin: Exact | None) -> Exact:
            return -axis if origin is None else -cross(axis, values.target - origin)

        by_joint = [
            moved(axis, origin if kind == "r" else None)
            for (axis, origin), kind in zip(screws, self.arm.kinds, strict=True)
        ]
        columns = list(by_joint)
        for of, axis in self.names:
            if of.startswith("link"):
                columns.append(moved(*links[of, axis]))
            else:
                columns.append(by_joint[int(of[5:]) - 1] * rates[of, axis])
        # What is left, target and tool, is that of an arm without geometry at this pose.
        plain = dataclasses.replace(values, delta=values.delta[:n] * 0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(judge, "chain", lambda arm, at: (rotation, place, screws))
            miss, rest = super().shot(plain, theta)
        # The same two directions across the beam.
        across = rest[:, n : n + 3]
        return miss, np.hstack([across @ np.array(columns).T, rest[:, n:]])

    def aimed(self, values: Any, q: Exact) -> Exact | None:
        """As there; the joints bend by a little of what they are turned, so that it takes more steps."""
        moving = np.flatnonzero(self.arm.moving)
        for _ in range(25):
            miss, jacobian = self.shot(values, q)
            if judge.norm(miss) < judge._HIT:
                return jacobian
            by_joints = jacobian[:, moving]
            try:
                part = mpmath.lu_solve(mpmath.matrix(by_joints @ by_joints.T), mpmath.matrix(miss))
            except ZeroDivisionError:
                return None
            q = q.copy()
            q[moving] -= by_joints.T @ np.array(list(part))
        return None


def values_of(problem: Problem, x: Matrix) -> Any:
    """Rad and m; `delta` are offsets and geometry."""
    metres = [mpf(1) if item.unit == "deg" else mpf(1) / 1000 for item in problem.parameters.items]
    values, arm = judge.exact(x) * np.array(metres), problem.parameters.arm.stop
    return judge.Values(values[:arm], values[arm : arm + 3], values[arm + 3 :])


def spanned(matrix: Exact, others: Exact, zero: mpf) -> list[bool]:
    """Which of the columns `others` are combinations of those of the `matrix` that pivots above `zero` keep
    apart: elimination of its columns."""
    size = matrix.shape[1]

    def unit_columns(columns: Exact) -> Exact:
        lengths = [judge.norm(column) for column in columns.T]
        return columns / np.array([own if own > judge._ZERO else mpf(1) for own in lengths])

    rows = np.hstack([unit_columns(matrix), unit_columns(others)])
    used: list[int] = []
    for done in range(min(len(rows), size)):
        left = [j for j in range(size) if j not in used]
        largest = np.abs(rows[done:, left])
        i, k = np.unravel_index(int(np.argmax(largest)), largest.shape)
        if largest[i, k] < zero:
            break
        used.append(left[k])
        rows[[done, done + i]] = rows[[done + i, done]]
        below = np.arange(len(rows)) > done
        rows[below] -= np.outer(rows[below, left[k]] / rows[done, left[k]], rows[done])
    return [all(abs(value) < judge._ZERO for value in column) for column in rows[len(used) :, size:].T]


def truth(cell: Any, problem: Problem, seed: int | None) -> dict[mpf, tuple[int, list[bool]]] | None:
    """At random values near by (nominal ones without a seed), with the measurements turned onto the target:
    the dimension of the null space without the geometry, and of each free parameter whether it is a gauge.

    For two bounds of what is none: that of fifty digits, and that of double precision. With links that
    deviate, and joints that bend, a gauge of the nominal arm is often broken by some 1e-12.
    """
    own, n, parameters = Judge(cell, problem), problem.robot.n, problem.parameters
    x = problem.nominal()
    if seed is not None:
        size = np.where(parameters.display == 1, _STEP, np.radians(0.1 * _STEP))
        x = x + np.random.default_rng(seed).normal(size=len(size)) * size
        x = np.where(parameters.free, x, problem.nominal())
    near = aim(problem, x, cell.moving)
    if not near.hit.all():
        return None
    here, stacked = values_of(problem, x), []
    for shot in near.problem.joints:
        jacobian = own.aimed(here, judge.joints_of(cell, shot))
        if jacobian is None:
            return None
        stacked.append(jacobian)
    assert n < stacked[0].shape[1]
    jacobian = np.vstack(stacked)
    geometry = parameters.group("geometry")
    plain = jacobian[:, parameters.free & ~geometry]
    tolerated = np.flatnonzero(geometry & parameters.free)
    answers = {}
    for zero in (judge._ZERO, _RESOLVED):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(judge, "_ZERO", zero)
            dimension, part = judge.null_space(plain)
        result = np.zeros(len(parameters), dtype=bool)
        result[parameters.free & ~geometry] = part
        result[tolerated] = spanned(plain, jacobian[:, tolerated], zero)
        answers[zero] = (dimension, result[parameters.free].tolist())
    return answers


def compare(kind: Any) -> bool:
    """Assert that the package says what the judge says; False where there is no such cell."""
    made = freed(kind)
    if made is None:
        return False
    cell, problem = made
    points = (truth(cell, problem, seed) for seed in (1, 2, 3))
    found = list(islice((point for point in points if point is not None), 2))
    if len(found) < 2:
        return False
    dimension = min(answers[judge._ZERO][0] for answers in found)
    # What is a gauge at both bounds of every point is one; what is at some bound and point may be called one.
    sure = np.all([own for answers in found for _, own in answers.values()], axis=0)
    told = identify(problem, problem.nominal())
    parameters = problem.parameters
    free, geometry = parameters.free, parameters.group("geometry")[parameters.free]
    names = np.array(parameters.names)[free]
    status = np.array(told.status)[free]
    unbounded = np.isinf(told.data_std[free])
    # The rule above all: no gauge has a finite std.
    assert set(names[sure]) <= set(names[unbounded]), (kind, set(names[sure]) - set(names[unbounded]))
    assert (status[sure] == "unidentifiable").all(), kind
    if judge.special(judge.cell(kind), plain(problem)):
        return True
    nominal = truth(cell, problem, None)
    assert nominal is not None
    may_be = np.any([own for answers in (*found, nominal) for _, own in answers.values()], axis=0)
    # What the data add to a tolerance may be too faint to be stated: less than 1e-8 of its own information.
    _, root, _ = information_root(problem, problem.nominal(), 1.0)
    faint = geometry & (1 / np.maximum(np.diag(np.linalg.pinv(root.T @ root)), 1e-300) - 1 < 1e-8)
    assert not (unbounded & ~may_be & ~faint).any(), (kind, names[unbounded & ~may_be & ~faint])
    assert sum(direction.kind == "exact" for direction in told.facts.null_space) >= dimension
    assert geometry.any()
    return True


def plain(problem: Problem) -> Problem:
    """The problem with nominal geometry."""
    return problem.with_geometry(NOMINAL)


SETTINGS: dict[str, Any] = {"deadline": None, "derandomize": True, "database": None}
SETTINGS["phases"] = [Phase.explicit, Phase.generate]
QUICK = judge.KINDS.filter(lambda kind: kind.shots < 10 and kind.joints < 6)


@settings(max_examples=3, **SETTINGS)
@given(kind=QUICK)
@example(kind=Kind(4, 6, False, True, True, False, 1, 8, False))  # the X-Pattern: theta1 constant
@example(kind=Kind(5, 4, False, False, False, False, 0, 8, True))
@example(kind=Kind(6, 4, True, True, False, False, 0, 8, False))
@example(  # a shift of a link that slides and tip take up: seen a million times better than its tolerance
    kind=Kind(365826, 6, True, False, True, True, 0, 12, False)
)
def test_no_gauge_is_called_known_with_geometry(kind: Any) -> None:
    assume(compare(kind))


@pytest.mark.long
@settings(max_examples=200, **SETTINGS)
@given(kind=judge.KINDS)
@example(kind=Kind(372271, 7, False, False, False, True, 0, 5, False))  # 3e-9 of a tolerance's information
def test_no_gauge_is_called_known_with_geometry_at_length(kind: Any) -> None:
    assume(compare(kind))


def test_the_x_pattern_stays_degenerate() -> None:
    """Freed geometry takes nothing away from a gauge: offset 2 is not known better, the others are worse.
    Control: where joint 1 varies, offset 2 is identifiable with geometry too."""
    for geometry in ({}, {"gravity": False, "harmonics": False}):
        told, names = {}, ()
        for stated in (None, geometry):
            problem = Problem.from_plan(pattern_plan("x", geometry=stated))
            names = problem.parameters.names[:6]
            told[stated is None] = identify(problem, problem.nominal())
        nominal, own = told[True], told[False]
        assert own.status[names.index("delta2")] == "unidentifiable"
        assert np.isinf(own.data_std[[1, *problem.parameters.targets(["psd"]).nonzero()[0][[0, 2]]]]).all()
        assert (own.data_std[2:6] >= nominal.data_std[2:6]).all()
        exact = [direction for direction in own.facts.null_space if direction.kind == "exact"]
        assert len(exact) == 1
        assert "delta2" in exact[0].combination
    problem = Problem.from_plan(good_plan(20, geometry={}))
    assert identify(problem, problem.nominal()).status[1] != "unidentifiable"


# --- the judge is judged -------------------------------------------------------------------------------


def test_the_judge_and_the_package_have_the_same_model() -> None:
    """Jacobians agree to rounding at shots that hit, also of links that deviate."""
    for seed, calibrated in ((6, True), (8, False)):
        made = freed(Kind(seed, 4, True, seed == 6, calibrated, False, 0, 3, True))
        assert made is not None
        cell, problem = made
        x = problem.nominal()
        for deviating in (False, True):
            if deviating:
                own = problem.parameters.block("geometry")
                x[own] = (
                    0.3
                    * np.random.default_rng(1).normal(size=own.stop - own.start)
                    * problem.parameters.prior_std[own]
                )
            near = aim(problem, x, cell.moving)
            assert near.hit.all()
            _, jacobians = near.problem.linearise(x)
            metres = np.array([1.0 if item.unit == "deg" else 0.001 for item in problem.parameters.items])
            for shot, jacobian in zip(near.problem.joints, jacobians, strict=True):
                _, judged = Judge(cell, problem).shot(values_of(problem, x), judge.joints_of(cell, shot))
                turned = np.array(judged.tolist(), dtype=float) * metres * 1000.0
                np.testing.assert_allclose(turned.T @ turned, jacobian.T @ jacobian, rtol=1e-6, atol=1e-3)


def test_columns_that_are_spanned_by_hand() -> None:
    matrix = np.array([judge.exact(row) for row in ([1, 0], [0, 1], [1, 1])])
    others = np.array([judge.exact(row) for row in ([2, 1, 0], [3, 0, 0], [5, 1.25, 0])])
    assert spanned(matrix, others, judge._ZERO) == [True, False, True]


def test_a_verdict_that_is_wrong_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: gauges of offsets, and then of links alone, that are given a finite std."""
    kind = Kind(305703, 5, False, False, True, False, 1, 12, False)
    assert compare(kind)
    honest = identify
    for group in ("geometry", "target"):

        def overlooked(problem: Problem, x: Matrix, group: Any = group) -> Any:
            told = honest(problem, x)
            known = np.isinf(told.data_std) & problem.parameters.group(group)
            return dataclasses.replace(told, data_std=np.where(known, 1.0, told.data_std))

        monkeypatch.setitem(globals(), "identify", overlooked)
        with pytest.raises(AssertionError):
            compare(kind)
