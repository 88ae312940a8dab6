"""The parts of a simulated cell: what is stated is the truth, what is not suits the plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cells import OPEN_LASER, PROBE, good_plan, header, irb1600, plan_of

from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.experiments.rigs.simulated.assembly import CellParts, assemble
from zerobeam.experiments.rigs.simulated.cell_file import Cell
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.kinematics.robot import same_arm
from zerobeam.model.likelihood.problem import Problem


def parts(plan: Plan, seed: int = 0, **content: Any) -> CellParts:
    return assemble(plan, Cell.model_validate(content), np.random.default_rng(seed))


def test_offsets_are_drawn_or_as_stated() -> None:
    plan = good_plan(3)
    drawn = parts(plan)
    assert (drawn.arm.offsets[1:] != 0).all()
    assert drawn.arm.offsets[0] == 0  # held: it is the base frame
    np.testing.assert_allclose(
        parts(plan, arm={"drawn_deg": 3}).arm.offsets, 3 * drawn.arm.offsets, rtol=1e-12
    )
    stated = parts(plan, arm={"offsets_deg": {"delta2": -1.2, "delta1": 0.5}})
    np.testing.assert_allclose(np.degrees(stated.arm.offsets), [0.5, -1.2, 0, 0, 0, 0])
    told = stated.provenance()
    assert told["true delta2 (deg)"] == -1.2
    assert told["true delta1 (deg)"] == 0.5
    assert told["true delta3 (deg)"] == 0.0


def test_what_is_stated_changes_nothing_of_what_is_drawn() -> None:
    """The cell of a seed is the same cell but for what is said of it."""
    plan = good_plan(3, tool=OPEN_LASER)
    drawn = parts(plan)
    offsets = parts(plan, arm={"offsets_deg": {}})
    np.testing.assert_array_equal(offsets.tool, drawn.tool)
    np.testing.assert_array_equal(offsets.centres["psd"], drawn.centres["psd"])
    tilted = parts(plan, laser={"tilt_deg": [0, 0]})
    np.testing.assert_array_equal(tilted.arm.offsets, drawn.arm.offsets)
    np.testing.assert_array_equal(tilted.tool[2:], drawn.tool[2:])


def test_a_calibrated_tool_is_as_stated_but_where_the_cell_says_otherwise() -> None:
    plan = good_plan(3)
    assert not parts(plan).tool.any()
    assert [name for name in parts(plan).provenance() if "tool" in name] == []
    off = parts(plan, laser={"tilt_deg": [0.1, -0.2], "shift_mm": [0.3, 0.4]})
    np.testing.assert_allclose(off.tool, [*np.radians([0.1, -0.2]), 0.3, 0.4])
    told = {name: value for name, value in off.provenance().items() if "tool" in name}
    assert told == {
        "true tool.tilt1 (deg)": 0.1,
        "true tool.tilt2 (deg)": -0.2,
        "true tool.shift1 (mm)": 0.3,
        "true tool.shift2 (mm)": 0.4,
    }


def test_the_provenance_of_an_uncalibrated_tool_is_what_the_beam_is() -> None:
    plan = good_plan(3, tool=OPEN_LASER)
    half = parts(plan, laser={"shift_mm": [0.3, 0.4]})
    told = half.provenance()
    assert (told["true tool.shift1 (mm)"], told["true tool.shift2 (mm)"]) == (0.3, 0.4)
    tilts = [told["true tool.tilt1 (deg)"], told["true tool.tilt2 (deg)"]]
    assert all(tilts)
    np.testing.assert_allclose(np.degrees(half.tool[:2]), tilts, atol=1e-9)


def test_the_truth_is_where_the_true_beam_hits() -> None:
    """At the truth's own parameters the model's beams go through the cell's PSD: offsets, tool and place."""
    plan = good_plan(3, tool=OPEN_LASER)
    made = parts(plan, laser={"shift_mm": [3, 4]}, psd={"placed": {"psd": {"centre_mm": [930, 20, -10]}}})
    aimed = aim(made.truth.problem, made.truth.x, servo_joints(made.truth.problem)).problem
    link = aimed.joints + made.arm.offsets
    still = np.zeros(6)
    origin, direction = made.functions.kernel("beam")(link, still, made.tool)
    off = np.cross(made.centres["psd"] - origin, direction)
    assert np.linalg.norm(off, axis=1).max() < 1e-5
    np.testing.assert_array_equal(made.centres["psd"], [930, 20, -10])


def test_a_psd_stands_near_the_plans_guess_or_where_it_is_said_to() -> None:
    near = parts(good_plan(3)).centres["psd"]
    assert 0 < np.linalg.norm(near - [900, 0, 0]) < 100
    sure = plan_of(header(targets={"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 0.5}}), good_plan(3).postures)
    np.testing.assert_allclose((parts(sure).centres["psd"] - [900, 0, 0]) * 40, near - [900, 0, 0])


def test_a_face_looks_at_its_beams_where_one_way_serves_them_all() -> None:
    plan = good_plan(5)
    problem = Problem.from_plan(plan)
    aimed = aim(problem, problem.nominal(), servo_joints(problem)).problem
    _, directions = aimed.beams(problem.nominal())
    normal = parts(plan).psds["psd"].normal
    assert normal is not None
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert (-directions @ normal >= np.cos(np.radians(70)) - 1e-12).all()
    # With the flange turned half round the beam comes from the other side: no face serves both.
    first = plan.postures[0]
    both = plan_of(
        plan.header, np.array([first, first - np.sign(first[5]) * np.array([0, 0, 0, 0, 0, np.pi])])
    )
    assert parts(both).psds["psd"].normal is None
    stated = parts(plan, psd={"placed": {"psd": {"normal": [0, 0, 5]}}}).psds["psd"].normal
    np.testing.assert_array_equal(stated, [0, 0, 1])
    assert parts(plan, psd={"placed": {"psd": {"normal": "beam"}}}).psds["psd"].normal is None


def test_arms_are_the_same_by_their_links_not_by_their_names() -> None:
    arm = irb1600()
    assert same_arm(arm, replace(arm, name="another"))
    assert not same_arm(arm, replace(arm, joints=arm.joints[:-1]))
    moved = arm.flange.copy()
    moved[2, 3] += 0.1
    assert not same_arm(arm, replace(arm, flange=moved))
    for change in (
        {"axis": np.array([1.0, 0, 0])},
        {"kind": "prismatic"},
        {"fixed": arm.joints[2].fixed @ moved},
    ):
        joints = (*arm.joints[:2], replace(arm.joints[2], **change), *arm.joints[3:])
        assert not same_arm(arm, replace(arm, joints=joints))


def test_a_probe_has_no_simulated_cell(refused: Callable[..., BadInput]) -> None:
    assert "tool is a probe" in str(refused(parts, good_plan(3, tool=PROBE)))
