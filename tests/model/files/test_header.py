import numpy as np
import pytest

from zerobeam.model.files.header import Header, UrdfRef, check_header, header_content
from zerobeam.model.files.measurements import read_header
from zerobeam.model.kinematics.robot import Joint, Robot

LASER = """\
robot: irb1600
tool:
  kind: laser
  calibrated: false
  point_mm: [0, 0, 65]
  direction: [2, 0, 0]
  sigma: {tilt_deg: 2, shift_mm: 5}
noise:
  joint_deg: 0.01
  spot_mm: 0.05
targets:
  psd: {guess_mm: [1200, 0, 600], sigma_mm: 300}
  other: {}
distances:
  - {between: [psd, other], mm: 50, sigma_mm: 0.1}
held: [delta1]
provenance: {serial: 1600-501234, absolute_accuracy: no, when: 2024-05-01, ambient: 21.5, warm: true}
"""
PROBE = """\
robot: {urdf: panda.urdf, base: panda_link0, tip: panda_hand_tcp}
tool: {kind: probe, calibrated: false, point_mm: [0, 0, 32]}
noise: {joint_deg: [0.01, 0.02], spot_mm: 0, scale: estimated}
"""


@pytest.fixture
def header_file(tmp_path):
    def write(text):
        path = tmp_path / "header.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_everything_that_is_stated_arrives(header_file):
    header = read_header(header_file(LASER))
    assert header.robot == "irb1600"
    assert header.tool.direction == (2, 0, 0)
    assert (header.tool.sigma.tilt_deg, header.tool.sigma.shift_mm) == (2, 5)
    assert header.targets["psd"].guess_mm == (1200, 0, 600)
    assert header.targets["other"].guess_mm is None
    assert header.targets["other"].sigma_mm == 10_000
    assert header.distances[0].between == ("psd", "other")
    assert header.held == ("delta1",)
    assert header.provenance == {
        "serial": "1600-501234",
        "absolute_accuracy": "no",
        "when": "2024-05-01",
        "ambient": 21.5,
        "warm": True,
    }


def test_the_defaults_are_those_of_the_design(header_file):
    header = read_header(header_file(PROBE))
    assert header.robot == UrdfRef(urdf="panda.urdf", base="panda_link0", tip="panda_hand_tcp")
    assert (header.prior.offset_deg, header.prior.offset_mm) == (5, 5)
    assert header.tool.sigma.shift_mm == 50
    tolerance = header.tolerance
    assert (tolerance.offset_deg, tolerance.length_mm, tolerance.tilt_deg) == (0.1, 1, 0.1)
    assert (header.held, header.limits, header.noise.scale) == (None, "error", "estimated")
    assert header.noise.joint_deg == (0.01, 0.02)
    bare = LASER.replace("  sigma: {tilt_deg: 2, shift_mm: 5}\n", "")
    sigma = read_header(header_file(bare)).tool.sigma
    assert (sigma.tilt_deg, sigma.shift_mm) == (3, 10)
    assert read_header(header_file(bare.replace("  calibrated: false\n", ""))).tool.calibrated


def test_held_nothing_is_not_the_same_as_held_unstated(header_file):
    assert read_header(header_file(PROBE + "held: []\n")).held == ()
    assert read_header(header_file(PROBE)).held is None


def change(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ("robot: irb1600\n", "", "'robot' is missing", 1),
        ("robot: irb1600", "robot: 5", "robot cannot be used", 1),
        ("robot: irb1600", "robot: {urdf: a, base: b}", "'tip' is missing in robot", 1),
        ("robot: irb1600", "robot: {urdf: a, base: b, tip: c, top: d}", "unknown key 'top' in robot", 1),
        ("kind: laser", "kind: lazer", "tool.kind is not one of", 3),
        ("kind: laser", "kind: probe", "direction is stated for a probe", 6),
        ("  direction: [2, 0, 0]\n", "", "tool.direction is missing", 2),
        ("[2, 0, 0]", "[0, 0, 0]", "no length", 6),
        ("[2, 0, 0]", "[2, 0]", "a list of 3 values", 6),
        ("[2, 0, 0]", "[2, 0, '0']", "item 3 of tool.direction is not a number", 6),
        ("calibrated: false", "calibrated: no", "tool.calibrated is not true or false", 4),
        ("tilt_deg: 2", "tilt_deg: 0", "out of range", 7),
        ("joint_deg: 0.01", "joint_deg: 0", "standard deviation of a joint reading", 9),
        ("joint_deg: 0.01", "joint_deg: [0.01, -1]", "standard deviation of a joint reading", 9),
        ("joint_deg: 0.01", "joint_deg: '0.01'", "standard deviation of a joint reading", 9),
        ("joint_deg: 0.01", "joint_deg: [0.01]\n  joint_mm: 1", "together with a list", 10),
        ("spot_mm: 0.05", "spot_mm: -0.05", "out of range", 10),
        ("spot_mm: 0.05", "spot_mm: .nan", "finite", 10),
        ("spot_mm: 0.05", "spot: 0.05", "unknown key 'spot' in noise", 10),
        ("spot_mm: 0.05", "spot_mm: 0.05\n  scale: guessed", "noise.scale is not one of", 11),
        ("sigma_mm: 300", "sigma_mm: 0", "out of range", 12),
        ("sigma_mm: 300", "sigma: 300", "unknown key 'sigma' in targets.psd", 12),
        ("  other: {}", "  tool: {}", "called 'tool'", 13),
        ("  other: {}", "  ' other': {}", "cannot be a name", 13),
        ("[psd, other]", "[psd, psd]", "between a target and itself", 15),
        ("[psd, other]", "[psd]", "a list of 2 values", 15),
        ("mm: 50", "mm: 0", "out of range", 15),
        ("held: [delta1]", "held: [delta1, delta1]", "duplicate", 16),
        ("held: [delta1]", "held: delta1", "held is not a list", 16),
        ("held: [delta1]", "limits: ignore", "limits is not one of", 16),
        ("21.5", "[21.5]", "provenance.ambient", 17),
        ("held: [delta1]", "tolerances: {}", "unknown key 'tolerances'", 16),
        ("robot: irb1600", "schema: zerobeam/run/2\nrobot: irb1600", "schema is not one of", 1),
    ],
)
def test_what_a_header_cannot_say(header_file, refused, old, new, what, line):
    path = header_file(change(LASER, old, new))
    error = refused(read_header, path)
    assert what in error.what, error
    assert error.line == line, error
    assert error.file == str(path)
    assert "pydantic" not in str(error)


def test_separate_noise_factors_need_a_spot_noise(header_file, refused):
    """Of none at all no factor can be told; joints alone may be estimated."""
    content = change(LASER, "spot_mm: 0.05", "spot_mm: 0.05\n  scale: separate")
    assert read_header(header_file(content)).noise.scale == "separate"
    error = refused(read_header, header_file(content.replace("spot_mm: 0.05", "spot_mm: 0")))
    assert "no spot noise" in error.what
    assert error.line == 10
    assert "above 0" in error.allowed
    assert "scale: estimated" in error.remedy
    assert read_header(header_file(change(LASER, "spot_mm: 0.05", "spot_mm: 0"))).noise.spot_mm == 0


def test_a_probe_has_no_tilt(header_file, refused):
    text = change(PROBE, "32]", "32], sigma: {tilt_deg: 3}")
    assert "tilt_deg is stated for a probe" in refused(read_header, header_file(text)).what
    shift = change(PROBE, "32]", "32], sigma: {shift_mm: 3}")
    assert read_header(header_file(shift)).tool.sigma.shift_mm == 3


def test_what_is_written_is_what_was_stated(header_file):
    """Defaults are not written out, and reading the written header gives an equal one."""
    for text in (LASER, PROBE):
        header = read_header(header_file(text))
        content = header_content(header, "zerobeam/run/1")
        assert next(iter(content)) == "schema"
        assert "prior" not in content
        again = Header.model_validate({k: v for k, v in content.items() if k != "schema"})
        assert again == header
        assert ("held" in content) == (header.held is not None)
    assert "sigma" not in content["tool"]


def axes(*kinds):
    z = np.array([0, 0, 1.0])
    joints = tuple(Joint(f"j{i}", kind, np.eye(4), z, -1, 1) for i, kind in enumerate(kinds))
    return Robot("arm", joints, np.eye(4))


@pytest.mark.parametrize(
    ("noise", "kinds", "what"),
    [
        ("{joint_deg: 0.1, spot_mm: 0}", ["revolute", "revolute"], None),
        ("{joint_deg: 0.1, joint_mm: 0.1, spot_mm: 0}", ["revolute", "prismatic"], None),
        ("{joint_deg: [0.1, 0.1], spot_mm: 0}", ["revolute", "prismatic"], None),
        ("{joint_deg: 0.1, joint_mm: 0.1, spot_mm: 0}", ["revolute", "revolute"], "no prismatic joint"),
        ("{joint_deg: 0.1, spot_mm: 0}", ["revolute", "prismatic"], "joint_mm is missing"),
        ("{joint_deg: [0.1], spot_mm: 0}", ["revolute", "revolute"], "wrong number of values"),
    ],
)
def test_the_noise_must_suit_the_robot(header_file, refused, noise, kinds, what):
    path = header_file(f"robot: irb1600\ntool: {{kind: probe, point_mm: [0, 0, 0]}}\nnoise: {noise}\n")
    header = read_header(path)
    if what is None:
        check_header(header, axes(*kinds), file=path, line=lambda _: 3)
    else:
        error = refused(check_header, header, axes(*kinds), file=path, line=lambda _: 3)
        assert what in error.what
        assert error.line == 3
