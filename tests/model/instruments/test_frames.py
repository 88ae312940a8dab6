"""Rotation vectors, quaternions and planes across, against SciPy, at 0 and up to 180°."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from zerobeam.model.errors import BadInput
from zerobeam.model.instruments import frames

AXES = [np.array(axis) / np.linalg.norm(axis) for axis in ([1, 0, 0], [0, -1, 0], [1, 2, 3], [-3, 1, -0.5])]
ANGLES = [
    0,
    1e-12,
    1e-9,
    1e-6,
    1e-3,
    0.03,
    0.0316,
    0.0633,
    0.0999,
    0.1001,
    1,
    2,
    3,
    np.pi - 1e-3,
    np.pi - 1e-8,
]


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("angle", ANGLES)
def test_vectors_matrices_and_quaternions_are_those_of_scipy(axis, angle):
    expected = Rotation.from_rotvec(axis * angle)
    turn = frames.rotation(axis * angle)
    np.testing.assert_allclose(turn, expected.as_matrix(), rtol=0, atol=1e-15)
    np.testing.assert_allclose(frames.rotation_vector(turn), axis * angle, rtol=0, atol=2e-15)
    x, y, z, w = expected.as_quat(canonical=True)
    np.testing.assert_allclose(frames.quaternion(turn), [w, x, y, z], rtol=0, atol=1e-15)
    np.testing.assert_allclose(frames.rotation_of_quaternion([w, x, y, z]), turn, rtol=0, atol=1e-15)


@pytest.mark.parametrize("axis", AXES, ids=str)
def test_half_a_turn_is_never_taken_for_none(axis):
    vector = frames.rotation_vector(Rotation.from_rotvec(axis * np.pi).as_matrix())
    assert np.linalg.norm(vector) == pytest.approx(np.pi, abs=1e-15)
    assert abs(vector @ axis) == pytest.approx(np.pi, abs=1e-12)


def test_first_and_second_derivatives_at_no_rotation():
    vector = ca.SX.sym("vector", 3)
    entries = ca.vec(frames.turned(vector))
    first = ca.Function("f", [vector], [ca.jacobian(entries, vector)])(np.zeros(3)).full()
    expected = np.column_stack([cross(e).ravel(order="F") for e in np.eye(3)])
    np.testing.assert_array_equal(first, expected)
    for i in range(3):
        second = ca.hessian(frames.turned(vector)[i, i], vector)[0]
        at_zero = ca.Function("f", [vector], [second])(np.zeros(3)).full()
        np.testing.assert_allclose(at_zero, np.diag(np.eye(3)[i]) - np.eye(3), atol=1e-15)


def test_the_vector_of_a_turned_rotation_is_differentiable_at_no_rotation():
    """log(exp(v) R R') is v: its Jacobian is one, at 0 and on both sides of the limit of the series."""
    vector = ca.SX.sym("vector", 3)
    fixed = ca.SX(Rotation.from_rotvec([0.3, -2, 1]).as_matrix())
    back = frames.vector_of(frames.turned(vector) @ fixed @ fixed.T)
    jacobian = ca.Function("f", [vector], [ca.jacobian(back, vector)])
    for size in (0, 1e-9, 0.0632, 0.0633, 0.099, 0.101, 2.0, 3.0):
        np.testing.assert_allclose(jacobian(size * AXES[2]).full(), np.eye(3), rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", [*np.eye(3), *-np.eye(3), *AXES], ids=str)
def test_axes_across_are_right_handed(n):
    b1, b2 = frames.basis_across(n)
    np.testing.assert_allclose(np.cross(b1, b2), n, atol=1e-15)
    np.testing.assert_allclose([b1 @ b1, b2 @ b2, b1 @ b2], [1, 1, 0], atol=1e-15)


def test_the_nearest_rotation_is_none_that_mirrors():
    rng = np.random.default_rng(0)
    for _ in range(20):
        matrix = rng.normal(size=(3, 3))
        turn = frames.nearest_rotation(matrix)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
        # No rotation beside it is nearer.
        for step in 0.01 * np.vstack([np.eye(3), -np.eye(3)]):
            beside = frames.rotation(step) @ turn
            assert np.sum((beside - matrix) ** 2) >= np.sum((turn - matrix) ** 2)


def test_points_are_aligned_to_points_in_a_plane_too():
    rng = np.random.default_rng(1)
    others = rng.normal(size=(5, 3)) * [100, 100, 0]
    turn = Rotation.random(random_state=rng).as_matrix()
    result = frames.aligned(others @ turn.T + [1, 2, 3], others)
    np.testing.assert_allclose(result[0], turn, atol=1e-12)
    np.testing.assert_allclose(result[1], [1, 2, 3], atol=1e-12)


def test_a_rounded_quaternion_is_made_one_and_a_wrong_one_refused():
    q = frames.unit_quaternion([0.707, 0.707, 0, 0])
    assert np.linalg.norm(q) == pytest.approx(1, abs=1e-15)
    for wrong in ([1.0, 1, 0, 0], [0.0, 0, 0, 0], [1.0, 0, 0], [np.nan, 0, 0, 0]):
        with pytest.raises(BadInput, match="not of length 1"):
            frames.unit_quaternion(wrong)
