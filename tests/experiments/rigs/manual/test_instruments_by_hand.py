"""A run by hand with every kind of instrument: what is typed is what the run file has."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.experiments.procedure.events import Doubted, Ended, PostureRequested, RunEvent
from zerobeam.experiments.recording import Answers, RunRequest, record
from zerobeam.experiments.rigs.manual.lines import Lines
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run
from zerobeam.model.files.shot import Shot

TIP = {"tip_mm": [60, 0, 120], "sigma_mm": 0.02}
FACES = {
    "top": {"kind": "plane", "normal": [0, 0, 1], "guess_mm": [800, 0, 50], "sigma_mm": 5},
}
INSTRUMENTS: dict[str, tuple[dict[str, Any], str | None, dict[str, Any]]] = {
    "tracker": (
        {"sigma_mm": 0.02, "guess_mm": [3000, 0, 800], "reflectors": {"R1": {"guess_mm": [60, 0, 60]}}},
        None,
        {},
    ),
    "pose": ({"sigma_mm": 0.1, "sigma_deg": 0.03, "guess_mm": [3000, 0, 800], "mount": {}}, None, {}),
    "ballbar": (TIP, "s1", {"s1": {"guess_mm": [800, 0, 0], "sigma_mm": 5}}),
    "dial": (TIP | {"direction": [0, 0, 1]}, "top", FACES),
    "plane": (TIP | {"tip_diameter_mm": 6}, "top", FACES),
    "sphere": (
        TIP | {"tip_diameter_mm": 6},
        "ball",
        {"ball": {"kind": "sphere", "diameter_mm": 25, "guess_mm": [800, 0, 50], "sigma_mm": 5}},
    ),
}
POSTURES = [[0, 40, 20, 0, 30, 0], [20, 45, 10, 20, 35, 40], [-20, 35, 25, -20, 40, -40]]
SLOW = ("pose", "dial", "plane", "sphere")
KINDS = [pytest.param(kind, marks=[pytest.mark.long] if kind in SLOW else []) for kind in INSTRUMENTS]


class Typed:
    """Lines of a person that reads questions."""

    confirms, follows = True, False

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = iter(lines)

    def following(self) -> str | None:
        return next(self._lines, None)


def planned(kind: str, postures: Any = POSTURES) -> Plan:
    entry, target, targets = INSTRUMENTS[kind]
    return zb.Plan.from_arrays(
        robot="irb1600",
        instruments={"it": {"kind": kind} | entry},
        postures=postures,
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        targets=target,
        target_priors=targets or None,
    )


def measured(plan: Plan) -> list[Shot]:
    rng = np.random.default_rng(3)
    return list(simulated_shots(Truth.drawn(plan, rng), rng))


def joints(shot: Shot) -> str:
    return " ".join(map(repr, shot.joints_deg))


def numbers(shot: Shot, by: float = 1.0) -> str:
    values = [
        v for value in shot.readings.values() for v in (value if isinstance(value, tuple) else (value,))
    ]
    return ", ".join(repr(value * by) for value in values)


def typed(folder: Path, plan: Plan, lines: Iterable[str], **how: Any) -> list[RunEvent]:
    events: list[RunEvent] = []
    source: Lines = Typed(lines)
    request = RunRequest("manual", answers=Answers(source), scene=True, **how)
    record(plan, folder / "hand.jsonl", request, events.append)
    return events


def doubts(events: list[RunEvent]) -> list[str]:
    return [event.kind for event in events if isinstance(event, Doubted)]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_typed_is_recorded(tmp_path: Path, kind: str) -> None:
    plan = planned(kind)
    shots = measured(plan)
    if plan.header.instrument.met:  # at its target
        plan = planned(kind, [shot.joints_deg for shot in shots])
    lines = []
    for shot in shots:
        if not shot.readings:
            lines.append(joints(shot))
        elif shot.shot % 2:
            lines += [joints(shot), numbers(shot)]
        else:
            lines.append(f"{joints(shot)} | {numbers(shot)}")
    events = typed(tmp_path, plan, lines)
    assert doubts(events) == []
    run = read_run(tmp_path / "hand.jsonl")
    assert [shot.readings for shot in run.shots] == [shot.readings for shot in shots]
    assert [shot.target for shot in run.shots] == [shot.target for shot in shots]
    for shot, other in zip(run.shots, shots, strict=True):
        assert shot.joints_deg == pytest.approx(other.joints_deg, abs=1e-6)
    (reads,) = {event.reads for event in events if isinstance(event, PostureRequested)}
    instrument = plan.header.instrument
    assert {read.key: read.numbers for read in reads} == ({} if instrument.met else dict(instrument.columns))
    assert all(read.words != read.key for read in reads)


def test_metres_are_questioned_and_taken_as_such(tmp_path: Path) -> None:
    plan = planned("tracker")
    first, second, third = measured(plan)
    lines = [joints(first), numbers(first, 1e-3), "metres", joints(second), "1 2", numbers(second)]
    events = typed(tmp_path, plan, [*lines, f"{joints(third)} | {numbers(third, 1e-3)}", numbers(third)])
    assert doubts(events) == ["metres", "unreadable", "metres"]
    for shot, other in zip(read_run(tmp_path / "hand.jsonl").shots, (first, second, third), strict=True):
        assert shot.readings["measured_mm"] == pytest.approx(other.readings["measured_mm"], abs=1e-9)


def test_a_run_that_is_paused_before_a_reading_asks_for_the_posture_again(tmp_path: Path) -> None:
    plan = planned("ballbar")
    shots = measured(plan)
    events = typed(tmp_path, plan, [f"{joints(shots[0])} | {numbers(shots[0])}", joints(shots[1]), "pause"])
    assert isinstance(events[-1], Ended)
    assert events[-1].missing == (1, 2)
    assert [event.event for event in events if event.event in ("posture", "reading")] == [
        *("posture", "posture", "reading")
    ]
    typed(
        tmp_path,
        plan,
        [f"{joints(shots[1])} | {numbers(shots[1])}", "skip no access"],
        resume=True,
    )
    assert [shot.shot for shot in read_run(tmp_path / "hand.jsonl").shots] == [0, 1]


def test_several_instruments_are_refused(tmp_path: Path) -> None:
    plan = zb.Plan.from_arrays(
        robot="irb1600",
        instruments={
            "a": {"kind": "tracker"} | INSTRUMENTS["tracker"][0],
            "b": {"kind": "pose"} | INSTRUMENTS["pose"][0],
        },
        means=[{"instrument": name} for name in "aba"],
        postures=POSTURES,
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    )
    with pytest.raises(BadInput, match="one instrument"):
        typed(tmp_path, plan, [])
    assert not (tmp_path / "hand.jsonl").exists()
