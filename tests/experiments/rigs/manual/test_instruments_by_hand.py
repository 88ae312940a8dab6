"""A run by hand with every kind of instrument: what is typed is what the run file has."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import good_plan

import zerobeam as zb
from zerobeam.experiments.procedure.events import (
    Doubted,
    Ended,
    GivenUp,
    PostureRequested,
    RunEvent,
    Stopped,
    Withdrawn,
)
from zerobeam.experiments.recording import Answers, RunRequest, record
from zerobeam.experiments.rigs.manual.line_sources import Lines
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.errors import RigFault
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run
from zerobeam.model.files.shot import Shot

TIP = {"tip_mm": [60, 0, 120], "sigma_mm": 0.02}
FACES = {
    "top": {"kind": "plane", "normal": [0, 0, 1], "guess_mm": [800, 0, 50], "sigma_mm": 5},
}
INSTRUMENTS: dict[str, tuple[dict[str, Any], str | None, dict[str, Any]]] = {
    "tracker": (
        {"sigma_mm": 0.02, "guess_mm": [3000, 0, 800], "reflectors": {"R1": {"guess_mm": [150, 0, 150]}}},
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
        unit="deg",
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


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.at_length(r"^tracker")
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


@pytest.mark.long
def test_metres_are_questioned_and_taken_as_such(tmp_path: Path) -> None:
    plan = planned("tracker")
    first, second, third = measured(plan)
    lines = [joints(first), numbers(first, 1e-3), "metres", joints(second), "1 2", numbers(second)]
    events = typed(tmp_path, plan, [*lines, f"{joints(third)} | {numbers(third, 1e-3)}", numbers(third)])
    assert doubts(events) == ["metres", "unreadable", "metres"]
    for shot, other in zip(read_run(tmp_path / "hand.jsonl").shots, (first, second, third), strict=True):
        assert shot.readings["measured_mm"] == pytest.approx(other.readings["measured_mm"], abs=1e-9)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("stop", [RigFault("the tracker is lost"), KeyboardInterrupt()])
def test_a_run_by_hand_that_breaks_off_says_so_and_keeps_what_is_recorded(
    tmp_path: Path, stop: BaseException
) -> None:
    plan = planned("tracker")
    first, second, third = measured(plan)

    def lines() -> Iterator[str]:
        yield from (joints(first), numbers(first), joints(second))
        raise stop

    events: list[RunEvent] = []
    with pytest.raises(type(stop)):
        record(
            plan,
            tmp_path / "hand.jsonl",
            RunRequest("manual", answers=Answers(Typed(lines()))),
            events.append,
        )
    assert events[-1] == Stopped(str(stop) or "interrupted")
    assert [shot.shot for shot in read_run(tmp_path / "hand.jsonl").shots] == [0]
    rest = [joints(second), numbers(second), joints(third), numbers(third)]
    ended = typed(tmp_path, plan, rest, resume=True)[-1]
    assert isinstance(ended, Ended)
    assert (ended.shots, ended.missing) == ((0, 1, 2), ())


@pytest.mark.long
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


MIX = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "instruments": {"tracker": {"kind": "tracker"} | INSTRUMENTS["tracker"][0]},
    "target_priors": {"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 20}},
    "noise": zb.Noise(joint_deg=0.005, spot_mm=0.05),
    "geometry": "exact",
}
MORE = [
    [-40, 30, 30, 60, -35, 80],
    [10, 50, 5, -70, 40, -100],
    [45, 30, 35, 90, 45, 140],
    [0, 20, 0, -30, 60, 20],
]
SHARED = 3  # postures at which both read, after as many of each alone


def mixed(rows: Sequence[tuple[Sequence[float], dict[str, Any]]]) -> Plan:
    means = [{key: value for key, value in how.items() if key != "target"} for _, how in rows]
    targets = [how.get("target") for _, how in rows]
    postures = [row for row, _ in rows]
    return zb.Plan.from_arrays(postures=postures, unit="deg", means=means, targets=targets, **MIX)


@pytest.fixture(scope="module")
def mix() -> tuple[Plan, Truth, list[Shot]]:
    """A laser and a tracker: seven postures of each, and three of both, the tracker stated first; and what a
    simulated cell records there."""
    alone = good_plan(7 + SHARED)
    rows = np.degrees(alone.postures).tolist()
    by_laser: dict[str, Any] = {"instrument": "tool", "target": "psd"}
    plan = mixed(
        [
            *((row, by_laser) for row in rows[:7]),
            *((row, {"instrument": "tracker"}) for row in [*POSTURES, *MORE]),
            *(
                (row, how | {"posture": k})
                for k, row in enumerate(rows[7:])
                for how in ({"instrument": "tracker"}, by_laser)
            ),
        ]
    )
    rng = np.random.default_rng(3)
    truth = Truth.drawn(plan, rng)
    return plan, truth, list(simulated_shots(truth, rng))


@pytest.mark.long
def test_a_laser_and_a_tracker_are_led_through_one_plan_to_a_result(
    tmp_path: Path, mix: tuple[Plan, Truth, list[Shot]]
) -> None:
    """The laser asks for the joints where it is centred, the tracker for its reading as well. Of a posture of
    both the joints are typed once, where the laser is centred."""
    plan, truth, shots = mix
    assert sum(shot.instrument == "tool" for shot in shots) == 10
    lines: list[str] = []
    for shot in shots:
        if shot.posture is None:
            lines += [joints(shot), *([numbers(shot)] if shot.instrument == "tracker" else [])]
        elif shot.instrument == "tracker":
            lines.append(f"{joints(shot)} | {numbers(shot)}" if shot.posture else joints(shot))
            lines += [] if shot.posture else [numbers(shot)]
    events = typed(tmp_path, plan, lines)
    assert doubts(events) == []
    run = read_run(tmp_path / "hand.jsonl")
    assert len(run.shots) == len(shots)
    by_number = {shot.shot: shot for shot in shots}
    for shot in run.shots:
        other = by_number[shot.shot]
        assert (shot.instrument, shot.posture, shot.target) == (other.instrument, other.posture, other.target)
        assert shot.joints_deg == pytest.approx(other.joints_deg, abs=1e-6)
        assert shot.measured_mm == other.measured_mm
        assert shot.spot_mm is None
    requests = [event for event in events if isinstance(event, PostureRequested)]
    assert len(requests) == len(plan.postures) - SHARED
    assert [len(event.also) for event in requests] == [0] * 14 + [1] * SHARED
    for event in requests:
        assert bool(event.reads) == (event.instrument == "tracker")
    assert [event.instrument for event in requests[14:]] == ["tool"] * SHARED
    answer = events[-1]
    assert isinstance(answer, Ended)
    assert answer.verdict == "pass"
    values = truth.values()
    for row in answer.parameters[1:]:
        assert row.estimate is not None
        assert row.std is not None
        assert abs(row.estimate - values[row.name]) < 5 * row.std


@pytest.mark.long
def test_measurements_of_one_posture_are_recorded_repeated_and_skipped_together(
    tmp_path: Path, mix: tuple[Plan, Truth, list[Shot]]
) -> None:
    """Nothing is recorded before all have read, so that joints are never those of a reading taken later."""
    whole, _, shots = mix
    plan = mixed(
        [
            (
                (whole.postures[i] * whole.robot.display).tolist(),
                {key: value for key, value in whole.means[i]._asdict().items() if value is not None}
                | ({"target": whole.targets[i]} if whole.targets[i] else {}),
            )
            for i in (14, 15, 16, 17)
        ]
    )
    first, second = shots[14], shots[16]
    begun = typed(tmp_path, plan, [f"{joints(first)} | {numbers(first)}", joints(second), "pause"])
    assert isinstance(begun[-1], Ended)
    assert begun[-1].missing == (2, 3)
    lines = [joints(second), "redo 0", joints(first), numbers(first, 2), f"{joints(second)} | 1", "skip"]
    events = typed(tmp_path, plan, lines, resume=True)
    assert [event.shot for event in events if isinstance(event, Withdrawn)] == [1, 0]
    assert [event.shot for event in events if isinstance(event, GivenUp)] == [2]
    assert doubts(events) == ["unreadable"]
    run = read_run(tmp_path / "hand.jsonl")
    assert [(shot.shot, shot.instrument) for shot in run.shots] == [(1, "tool"), (0, "tracker"), (3, "tool")]
    assert run.shots[1].measured_mm == pytest.approx([2 * value for value in first.readings["measured_mm"]])
    again = typed(tmp_path, plan, ["redo 3", "skip"], resume=True)
    assert [event.shot for event in again if isinstance(event, GivenUp)] == [2]
