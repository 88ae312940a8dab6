import numpy as np
from scipy.spatial.transform import Rotation

from zerobeam.model.kinematics.orientation import (
    angles_of,
    from_quaternion,
    orientation,
)
from zerobeam.model.kinematics.robot import euler


def about(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def rotations() -> list[np.ndarray]:
    random = Rotation.random(200, np.random.default_rng(0)).as_matrix()
    right = [
        about("x", a) @ about("y", b) @ about("z", c)
        for a in (0, 90, 180)
        for b in (0, 90, -90)
        for c in (0, 90)
    ]
    return [*random, *right]


def test_every_form_gives_the_rotation_back() -> None:
    for turn in rotations():
        result = orientation(turn)
        w, x, y, z = result.quaternion
        assert w >= 0
        forms = [
            Rotation.from_quat([x, y, z, w]).as_matrix(),
            Rotation.from_euler("ZYX", result.abc, degrees=True).as_matrix(),
            Rotation.from_euler("xyz", result.roll_pitch_yaw, degrees=True).as_matrix(),
            Rotation.from_rotvec(result.rotation_vector).as_matrix(),
            Rotation.from_euler("XYZ", result.xyz, degrees=True).as_matrix(),
            euler("xyz", angles_of(turn))[:3, :3],
        ]
        for form in forms:
            np.testing.assert_allclose(form, turn, rtol=0, atol=1e-12)
        assert np.linalg.norm(result.rotation_vector) <= np.pi + 1e-12


def test_a_tool_that_points_forward_is_what_pendants_show() -> None:
    # ABB's and KUKA's flange at the arm's home: z forward, x down.
    result = orientation(about("y", 90))
    np.testing.assert_allclose(result.quaternion, [0.5**0.5, 0, 0.5**0.5, 0], atol=1e-12)
    np.testing.assert_allclose(result.abc, [0, 90, 0], atol=1e-9)
    # FANUC's: W 180, P -90, R 0.
    np.testing.assert_allclose(
        orientation(about("y", -90) @ about("x", 180)).roll_pitch_yaw, [180, -90, 0], atol=1e-9
    )


def test_a_pose_from_its_quaternion() -> None:
    for turn in Rotation.random(20, np.random.default_rng(1)):
        x, y, z, w = turn.as_quat()
        pose = from_quaternion([1.0, -2.0, 3.0, *(2 * np.array([w, x, y, z]))])  # of any length
        np.testing.assert_allclose(pose[:3, :3], turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(pose[:, 3], [1, -2, 3, 1])
