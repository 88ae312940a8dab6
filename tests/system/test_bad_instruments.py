"""Runs of instruments that cannot be right: what the reader refuses, with what to do, and what the answer
names: readings in metres, a left-handed frame, points one row off."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import irb1600
from measured_arms import CELLS, Recorded, recorded
from scipy.spatial.transform import Rotation

from zerobeam.analysis.diagnostics.diagnosis import Explanation, diagnose
from zerobeam.analysis.ladder import solve_run
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import header_content
from zerobeam.model.files.run import read_run
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import CAUSES, changed, mend

JOINT_DEG = 0.005
Lines = list[dict[str, Any]]


def lines_of(kind: str, count: int = 12) -> Lines:
    cell = CELLS[kind]
    arm = recorded(cell, count, np.random.default_rng(5), exact=True, joint_deg=JOINT_DEG)
    lines: Lines = [header_content(cell.header(geometry="exact", joint_deg=JOINT_DEG), "zerobeam/run/1")]
    for i, (joints, some) in enumerate(zip(arm.joints, arm.measured, strict=True)):
        for item in some:
            row = {"target": item.target, "reflector": item.variant or None}
            row |= {name: list(part) if len(part) > 1 else part[0] for name, part in item.measured.items()}
            row |= {"shot": len(lines), "posture": i, "joints_deg": np.degrees(joints).tolist()}
            lines.append({key: value for key, value in row.items() if value is not None})
    return lines


def written(path: Path, lines: Lines) -> Path:
    path.write_text("\n".join(map(json.dumps, lines)) + "\n", encoding="utf-8")
    return path


def leica(**changes: Any) -> Callable[[Lines], object]:
    return lambda lines: lines[0]["instruments"]["leica"].update(changes)


def of_measurement(**changes: Any) -> Callable[[Lines], object]:
    return lambda lines: lines[3].update(changes)


def few_touches(lines: Lines) -> None:
    """Two of the front, and no angle that would say how it stands."""
    del lines[0]["angles"]
    front = [line for line in lines if line.get("target") == "front"]
    for line in front[2:]:
        lines.remove(line)


def unit_left_out(lines: Lines) -> None:
    lines[3]["measured"] = lines[3].pop("measured_mm")


_KNOWN = {"xyz_mm": [1, 2, 3], "quat": [1, 0, 0, 0]}
BAD: dict[str, tuple[str, Callable[[Lines], object], str, str]] = {
    "free and known": (
        "tracker", leica(frame={"free": True, **_KNOWN}), "frame is both free and known", "state frame: free"
    ),
    "free or known": (
        "tracker", leica(frame=["free", _KNOWN]), "frame is both free and known", "state frame: free"
    ),
    "half known": ("tracker", leica(frame={"xyz_mm": [1, 2, 3]}), "'quat' is missing", "quat"),
    "two touches": ("cube", few_touches, "'front' is measured with 2 numbers", "record more measurements"),
    "no such reflector": ("tracker", of_measurement(reflector="R9"), "no such reflector", "R1, R2, R3"),
    "no unit": ("tracker", unit_left_out, "unknown key 'measured'", "did you mean 'measured_mm'"),
    "sigma without unit": ("tracker", leica(sigma=0.1), "unknown key 'sigma'", "did you mean 'sigma_mm'"),
    "sigma of 0": ("tracker", leica(sigma_mm=0), "sigma_mm is out of range", "> 0"),
    "one of three below 0": ("tracker", leica(sigma_mm=[0.1, -0.1, 0.1]), "item 2 of sigma_mm", "> 0"),
    "constant below 0": (
        "tracker", leica(sigma_mm={"constant": -1, "per_m": 0}), "constant is out of range", "> 0"
    ),
    "covariance": (
        "tracker", leica(sigma_mm=[[1, 2], [2, 1]]), "sigma_mm is a matrix", "the standard deviations"
    ),
    "of one measurement": ("tracker", of_measurement(sigma_mm=-0.1), "sigma_mm is out of range", "> 0"),
    "quaternion of a frame": (
        "tracker", leica(frame={**_KNOWN, "quat": [1, 1, 0, 0]}), "not of length 1", "w comes first"
    ),
    "measured quaternion": (
        "pose", of_measurement(measured_quat=[1, 1, 0, 0]), "not of length 1", "look whether these are angles"
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def right() -> dict[str, Lines]:
    return {kind: lines_of(kind) for kind in ("tracker", "pose", "cube")}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_right_is_one_error_that_says_what_to_do(
    case: str, right: dict[str, Lines], tmp_path: Path
) -> None:
    """Negative control: without the change the file is read."""
    kind, spoil, what, remedy = BAD[case]
    lines = copy.deepcopy(right[kind])
    read_run(written(tmp_path / "right.jsonl", lines)).require_analysable()
    spoil(lines)
    with pytest.raises(BadInput) as refused:
        read_run(written(tmp_path / "run.jsonl", lines)).require_analysable()
    text = str(refused.value)
    assert what in text
    assert remedy in text
    assert refused.value.line is not None
    assert refused.value.found
    assert refused.value.allowed or refused.value.remedy


def in_metres(measured: list[list[Measurement]]) -> list[list[Measurement]]:
    def right(item: Measurement) -> Measurement:
        if "measured_mm" not in item.measured:
            return item
        return item._replace(
            measured={**item.measured, "measured_mm": tuple(x / 1000 for x in item.measured["measured_mm"])}
        )

    return [[right(item) for item in some] for some in measured]


def mirrored(measured: list[list[Measurement]]) -> list[list[Measurement]]:
    """y of every position reversed, and what a mirror makes of a rotation."""

    def right(item: Measurement) -> Measurement:
        x, y, z = item.measured["measured_mm"]
        turned = {}
        if "measured_quat" in item.measured:
            w, a, b, c = item.measured["measured_quat"]
            turned = {"measured_quat": (w, -a, b, -c)}
        return item._replace(measured={"measured_mm": (x, -y, z), **turned})

    return [[right(item) for item in some] for some in measured]


def as_other_programs(wrong: str) -> Callable[[list[list[Measurement]]], list[list[Measurement]]]:
    """Poses with w last, inverse rotations, or inverse poses: computed plainly."""

    def right(item: Measurement) -> Measurement:
        w, x, y, z = item.measured["measured_quat"]
        position = item.measured["measured_mm"]
        turned = {"quaternion": (x, y, z, w)}.get(wrong, (w, -x, -y, -z))
        if wrong == "inverse_pose":
            back = Rotation.from_quat([x, y, z, w]).inv()
            position = tuple((-back.apply(position)).tolist())
        return item._replace(measured={"measured_mm": position, "measured_quat": turned})

    return lambda measured: [[right(item) for item in some] for some in measured]


def one_row_off(measured: list[list[Measurement]]) -> list[list[Measurement]]:
    return [*measured[1:], measured[0]]


SPOILED = {"metres": in_metres, "mirrored": mirrored, "rows": one_row_off}
POSES = {wrong: as_other_programs(wrong) for wrong in ("quaternion", "inverse", "inverse_pose")}
SPOILED |= POSES


def arm_of(kind: str, *, exact: bool) -> Recorded:
    return recorded(CELLS[kind], 24, np.random.default_rng(3), exact=exact, joint_deg=JOINT_DEG)


def explained(
    kind: str, joints: np.ndarray, measured: list[list[Measurement]], *, exact: bool
) -> tuple[Explanation, ...]:
    header = CELLS[kind].header(geometry="exact" if exact else None, joint_deg=JOINT_DEG)
    return diagnose(solve_run(Problem.of_measured(header, irb1600(), joints, measured), header))


def require_named(kind: str, cause: str, *, exact: bool) -> None:
    """The cause is named, alone; of the run as it was recorded nothing is."""
    arm = arm_of(kind, exact=exact)
    label = next(iter(CELLS[kind].instruments))
    (best, *others) = explained(kind, arm.joints, SPOILED[cause](arm.measured), exact=exact)
    assert (best.cause, others) == (cause, [])
    assert best.factor < 0.2 * best.before  # a free geometry takes up a part of what is wrong
    assert best.of == ("" if cause == "rows" else label)
    for sentence in (CAUSES[best.cause], changed(best), mend(best)):
        assert sentence
        assert cause == "rows" or label in sentence or sentence == CAUSES[best.cause]
    if cause == "mirrored":
        assert best.amount == (2 if "known" in kind else 0)  # y; a free frame cannot tell which axis
        assert ("sign of y of leica" in changed(best)) == ("known" in kind)
    assert not {one.cause for one in explained(kind, arm.joints, arm.measured, exact=exact)} & SPOILED.keys()


@pytest.mark.long
@pytest.mark.parametrize(("kind", "cause"), [("ballbar", "metres"), ("tracker, frame known", "mirrored")])
@pytest.mark.at_length(r"^tracker, frame known-mirrored$")
def test_readings_that_are_wrong_alike_are_named(kind: str, cause: str) -> None:
    require_named(kind, cause, exact=True)


@pytest.mark.long
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(
    ("kind", "cause"),
    [
        *(("tracker, frame known", cause) for cause in SPOILED if cause not in POSES),
        *(("pose", cause) for cause in SPOILED),
        *((kind, cause) for kind in ("ballbar", "dial") for cause in ("metres", "rows")),
        *(("tracker", cause) for cause in ("metres", "mirrored")),
        ("laser + tracker", "metres"),
    ],
)
def test_readings_that_are_wrong_alike_are_named_at_length(kind: str, cause: str, exact: bool) -> None:
    require_named(kind, cause, exact=exact)


@pytest.mark.long
def test_a_joint_with_the_wrong_sign_is_no_fault_of_the_readings() -> None:
    """Negative control: a misfit of another cause gets that cause."""
    arm = arm_of("dial", exact=True)
    joints = arm.joints * [1, 1, 1, -1, 1, 1]
    (best, *_) = explained("dial", joints, arm.measured, exact=True)
    assert (best.cause, best.joints) == ("sign", (4,))


@pytest.mark.long
def test_poses_as_other_programs_write_them_are_named() -> None:
    require_named("pose", "quaternion", exact=True)


@pytest.mark.parametrize("wrong", POSES)
def test_poses_put_right_are_those_that_were_measured(wrong: str) -> None:
    arm, header = arm_of("pose", exact=True), CELLS["pose"].header(geometry="exact", joint_deg=JOINT_DEG)
    spoiled = Problem.of_measured(header, irb1600(), arm.joints, POSES[wrong](arm.measured))
    measured = Problem.of_measured(header, irb1600(), arm.joints, arm.measured)
    assert np.abs(spoiled.readings - measured.readings).max() > 0.1
    (right,) = (one for one in spoiled.tool.misread(spoiled.readings) if one.wrong == wrong)
    np.testing.assert_allclose(right.readings, measured.readings, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["tracker", "pose", "ballbar", "dial", "tracker + plane + ballbar"])
def test_readings_put_right_are_those_that_were_recorded(kind: str) -> None:
    arm, header = arm_of(kind, exact=True), CELLS[kind].header(geometry="exact", joint_deg=JOINT_DEG)

    def readings(measured: list[list[Measurement]]) -> np.ndarray:
        return Problem.of_measured(header, irb1600(), arm.joints, measured).readings

    def right(measured: list[list[Measurement]], wrong: str) -> list[np.ndarray]:
        problem = Problem.of_measured(header, irb1600(), arm.joints, measured)
        return [one.readings for one in problem.tool.misread(problem.readings) if one.wrong == wrong]

    every = right(in_metres(arm.measured), "metres")
    assert len(every) == (2 if "+" in kind else 1)
    if len(every) == 1:
        np.testing.assert_allclose(every[0], readings(arm.measured), rtol=1e-12)
    for again in right(arm.measured, "mirrored"):
        assert np.abs(again - readings(arm.measured)).max() > 1
