"""A run that is watched: the same measurements, and where arm, beam, spot and LEDs were seen besides."""

from __future__ import annotations

import base64
from collections import Counter

import numpy as np
import pytest
from cells import PROBE, good_plan

from zerobeam.experiments.procedure.events import (
    ArmSent,
    MeasurementRecorded,
    PictureTaken,
    RunEvent,
    SpotSeen,
)
from zerobeam.experiments.procedure.order import InTurn
from zerobeam.experiments.procedure.session import Procedure, arm_sent, picture_taken
from zerobeam.experiments.procedure.steering import Belief
from zerobeam.experiments.rigs.simulated.cell_file import Cell
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.studies.campaign import MemoryJournal
from zerobeam.model.likelihood.problem import Problem


def test_who_watches_changes_nothing() -> None:
    plan, told, shots = good_plan(2), [], []
    for scene in (False, True):
        events: list[RunEvent] = []
        journal = MemoryJournal()
        Procedure(plan, SimulatedRig(plan, Cell(), 3), journal, InTurn(2), events.append, scene).carry_out()
        shots.append(journal.shots)
        told.append(events)
    assert shots[0] == shots[1]
    assert [event for event in told[1] if not isinstance(event, ArmSent | PictureTaken)] == told[0]
    kinds = Counter(type(event) for event in told[1])
    assert kinds[PictureTaken] >= 1
    assert kinds[ArmSent] > kinds[SpotSeen] > 2 == kinds[MeasurementRecorded]
    sent = [event for event in told[1] if isinstance(event, ArmSent)]
    for k, shot in enumerate(shots[1]):
        last = [event for event in sent if event.shot == k][-1]
        assert np.allclose(last.joints_deg, shot.joints_deg, atol=0.02)
        assert last.lit
    assert sent[0].target == (900.0, 0.0, 0.0)  # nothing is known yet but the plan
    assert sent[-1].target != sent[0].target
    for spot in (event for event in told[0] if isinstance(event, SpotSeen)):
        assert spot.at_mm is not None
        assert np.linalg.norm(spot.at_mm) == pytest.approx(spot.off_mm, abs=2e-4)
        assert spot.size_mm == 20.0


@pytest.mark.parametrize("tool", ["laser", "probe"])
def test_the_arm_is_where_the_model_has_it(tool: str) -> None:
    plan = good_plan(2) if tool == "laser" else good_plan(2, tool=PROBE)
    problem = Problem.from_plan(plan)
    belief = Belief(problem.select(np.array([1])), problem.nominal())
    event = arm_sent(belief, 1, plan.postures[1], lit=True)
    rotation, place = belief.flange(plan.postures[1])
    assert np.allclose(event.arm[-1], place, atol=0.01)
    point = place + rotation @ np.array(plan.header.tool.point_mm)
    assert np.allclose(event.beam[0], point, atol=0.01)
    assert len(event.beam) == (2 if tool == "laser" else 1)
    assert np.allclose(event.joints_deg, plan.postures[1] * plan.robot.display)


def test_a_picture_is_reduced_and_its_lights_remain() -> None:
    image = np.full((482, 641), 7, dtype=np.uint8)
    image[100, 301] = 255
    taken = picture_taken(4, image)
    assert (taken.width, taken.height, taken.reduced) == (213, 160, 3)
    grey = np.frombuffer(base64.b64decode(taken.grey), dtype=np.uint8).reshape(taken.height, taken.width)
    assert grey[33, 100] == 255
    assert np.count_nonzero(grey == 255) == 1
