"""Does the whole chain hold what it promises? Runs in the simulated cell, from a plan to the offsets.

Every run has an arm of its own and goes the whole way: pictures, PSD, encoders, servo, identification. What
it then says of each offset is held against the truth, and the time that it took against the paper's six
minutes.
Two wrong ways are carried along, for a check that never fails checks nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from ...analysis.observability.identifiability import identify
from ...analysis.so_far import SoFar
from ...analysis.status import versions
from ...model.files.header import Header
from ...model.files.plan import Plan
from ...model.files.robot_file import load_robot
from ...model.problem import Problem
from ...model.robot import Matrix
from ...reports.words.wording import listed
from ..plans.candidates import candidates
from ..plans.optimal import Planner
from ..plans.patterns import pattern
from ..procedure.session import PHASES, told_by
from ..rigs.simulated.cell_file import ArmInCell, CameraInCell, Cell
from .binomial import accuracy, held_share, nothing_known
from .campaign import CellRun, Repeated, campaign, seeds
from .case_store import each_case

SHOTS, CANDIDATES = 7, 1000
TARGET = (950.0, 150.0, 100.0)
_SIGMA_MM = 30.0  # to which a person can tell it; without a camera the beam is looked for about it
_POOL = 24  # postures that the adaptive run may choose from
_TOLERANCE_DEG = 0.02
_BACKLASH_DEG = 0.1  # of the control: ten times the joint noise
_LEVEL = 0.95
_CHANCE = 0.01  # of a false alarm over all offsets of a plan
_LIMIT_S = 360.0  # "no more than 6 minutes" (section 4.1)

Progress = Callable[[str, float], None]  # the stage, and the share of the whole that is done


@dataclass(frozen=True, eq=False)
class StudiedPlan:
    """A plan of the study, and the cell that it is carried out in. A `control` must not agree."""

    name: str
    words: str
    repeated: Repeated
    control: bool = False


def header(joint_deg: float, spot_mm: float, sigma_mm: float | None = None) -> Header:
    """The paper's arm with a calibrated laser, and a PSD that was put up near TARGET, to `sigma_mm` if that
    is to be known of it."""
    place = {"guess_mm": list(TARGET), **({} if sigma_mm is None else {"sigma_mm": sigma_mm})}
    return Header.model_validate(
        {
            "robot": "irb1600",
            "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
            "noise": {"joint_deg": joint_deg, "spot_mm": spot_mm},
            "targets": {"psd": place},
        }
    )


def paper_plan(own: Header) -> Plan:
    """Our Y-Pattern of seven shots; the paper does not print its postures."""
    robot = load_robot(own.robot, Path())
    return _plan(own, pattern(own, robot, np.array(TARGET), "y", SHOTS))


def optimal_plan(own: Header, seed: int) -> Plan:
    """The A-optimal seven of many candidates."""
    robot = load_robot(own.robot, Path())
    found = candidates(own, robot, np.array(TARGET), CANDIDATES, seed=seed)
    return _plan(own, Planner(own, robot, np.array(TARGET), found).optimal(SHOTS, seed=seed).postures)


def pool_plan(own: Header, seed: int) -> Plan:
    """Candidates as they come: what an adaptive run chooses from."""
    robot = load_robot(own.robot, Path())
    found = candidates(own, robot, np.array(TARGET), CANDIDATES, seed=seed)
    return _plan(own, found.postures[:_POOL])


def _plan(own: Header, postures: Matrix) -> Plan:
    robot = load_robot(own.robot, Path())
    lines = tuple(range(1, len(postures) + 1))
    return Plan(own, robot, postures, ("psd",) * len(postures), lines, Path(), "", ())


def studied_plans(seed: int, camera: bool) -> list[StudiedPlan]:
    """The paper's plan, the optimal one, an adaptive run, and the optimal one on an arm that is not as
    modelled."""
    own = header(0.01, 0.05, _SIGMA_MM)
    cell = Cell(camera=CameraInCell() if camera else None)
    loose = cell.model_copy(update={"arm": ArmInCell(backlash_deg=_BACKLASH_DEG)})
    best, pool = optimal_plan(own, seed), pool_plan(own, seed)
    needed = _needed_in_turn(pool)
    in_turn = f"{needed} are needed" if needed else "all are not enough"
    return [
        StudiedPlan(
            "y-pattern",
            f"Y-Pattern of {SHOTS} shots over the arm's whole reach",
            Repeated(paper_plan(own), cell),
        ),
        StudiedPlan("optimal", f"{SHOTS} A-optimal shots of {CANDIDATES} postures", Repeated(best, cell)),
        StudiedPlan(
            "adaptive",
            f"the next of {_POOL} postures as the shots so far advise, until the worst std is within"
            f" {_TOLERANCE_DEG:g}°; in their own order {in_turn} by prediction",
            Repeated(pool, cell, _TOLERANCE_DEG),
        ),
        StudiedPlan(
            "backlash",
            f"control: the optimal plan on an arm whose gears have a play of {_BACKLASH_DEG:g}°",
            Repeated(best, loose),
            control=True,
        ),
    ]


def _needed_in_turn(plan: Plan) -> int | None:
    """How many of the plan's shots, one after another, reach the tolerance by prediction."""
    problem = Problem.from_plan(plan)
    offsets = problem.parameters.free & problem.parameters.group("offset")
    for count in range(2, problem.shots + 1):
        some = problem.select(np.arange(count))
        if np.degrees(identify(some, some.nominal()).data_std[offsets].max()) <= _TOLERANCE_DEG:
            return count
    return None


def cell_study(
    runs: int,
    seed: int,
    progress: Progress,
    *,
    camera: bool = True,
    processes: int | None = None,
    store: Path | None = None,
) -> dict[str, Any]:
    """The whole study, as plain JSON types (docs/files.md, `zerobeam/study/1`).

    It agrees if the intervals of every plan hold the truth as often as they promise, and every control is
    seen to be wrong. With a `store` the answer of each plan is kept in that file at once, and a study that
    was stopped goes on from there.
    """
    began = time.perf_counter()
    progress("plans", 0.0)
    plans = studied_plans(seed, camera)

    def studied(k: int) -> dict[str, Any]:
        plan = plans[k]
        (own,) = campaign(
            [plan.repeated],
            seeds(seed, runs),
            lambda share: progress(plan.name, (k + 0.95 * share) / len(plans)),
            processes,
        )
        answer = {"told": _told(plan, own, [run.state for run in own])}
        if plan.name == "optimal":
            understated = replace(
                plan,
                name="noise understated by 2",
                words="control: the optimal plan's runs, the noise stated as half of what it is",
                control=True,
            )
            answer["control"] = _told(understated, own, _with_half_the_noise(plan.repeated.plan, own))
        return answer

    heading = {"study": "cell", "seed": seed, "runs": runs, "camera": camera, "versions": versions()}
    answers = each_case(store, heading, len(plans), studied)
    progress("plans", 1.0)
    told = [answer["told"] for answer in answers]
    told += [answer["control"] for answer in answers if "control" in answer]
    return {
        "schema": "zerobeam/study/1",
        "study": "cell",
        "title": "Does the whole chain hold what it promises?",
        "headline": _headline(runs, told),
        "agrees": all(plan["agrees"] is not plan["control"] for plan in told),
        "settings": {
            "runs": runs,
            "seed": seed,
            "level": _LEVEL,
            "camera": camera,
            "chance": _CHANCE,
            "limit_s": _LIMIT_S,
            "tolerance_deg": _TOLERANCE_DEG,
        },
        "seconds": time.perf_counter() - began,
        "versions": versions(),
        "plans": told,
        "notes": [
            f"Every run has an arm of its own, with offsets of {plans[0].repeated.cell.arm.drawn_deg:g}°"
            " (one standard deviation), a PSD that stands some 20 mm beside its guess, and noise of its own;"
            f" the priors of the fits are 5° and {_SIGMA_MM:g} mm. The same seeds, so the same arms, serve"
            " all plans.",
            "An interval is estimate ± 1.96 std, from the curvature of the likelihood. It counts where the"
            " run itself calls the offset identified or weak; a run that does not has no interval there, and"
            " lowers the number of runs that the share is of.",
            "Where an offset is weak two things are not quite as the intervals take them: the misses are not"
            " linear over them, which makes them a little short, and the priors are wider than what is drawn,"
            " which makes them a little long.",
            f"A plan agrees if none of its shares is off by more than a chance of {_CHANCE:.0%}, over its"
            " offsets together, allows (exact binomial test, Bonferroni). The intervals shown are 95 %"
            " (Clopper and Pearson).",
            "Seconds are those of the simulated cell's clock: a quarter of the arm's top speeds, pictures,"
            " PSD samples, settling. They depend on what the cell file says of these.",
        ],
    }


def _with_half_the_noise(plan: Plan, runs: Sequence[CellRun]) -> list[SoFar | None]:
    problem = Problem.from_plan(plan)
    noise = problem.noise
    half = replace(problem, noise=replace(noise, joint=noise.joint / 2, spot=noise.spot / 2))
    return [None if run.state is None else told_by(half, run.shots) for run in runs]


def _told(plan: StudiedPlan, runs: Sequence[CellRun], states: Sequence[SoFar | None]) -> dict[str, Any]:
    """One plan of the study; `states` is what each run said, in the order of `runs`."""
    carried = plan.repeated.plan
    problem = Problem.from_plan(carried)
    status = identify(problem, problem.nominal()).status
    ended = [run for run in runs if run.state is not None]
    free = np.flatnonzero(problem.parameters.free & problem.parameters.group("offset"))
    rows: list[dict[str, Any]] = []
    for i in free:
        item = problem.parameters.items[i]
        error, std = _of_offset(item.name, runs, states)
        # What the plan cannot tell has no number, even if single runs were lucky enough to claim one.
        known = status[i] != "unidentifiable" or plan.control
        row: dict[str, Any] = {"name": item.name, "unit": item.unit, "status": status[i]}
        row |= accuracy(error, std) if known else nothing_known()
        rows.append({**row, "coverage": _coverage(error, std, _CHANCE / len(free)) if known else None})
    judged = [row["coverage"] for row in rows if row["coverage"] is not None]
    agrees = bool(judged) and all(share["agrees"] for share in judged)
    contradicted = sum(state is not None and not state.consistent for state in states)
    used = [len(run.shots) for run in ended]
    saved = [len(carried.postures) - len(run.shots) - len(run.refused) for run in ended]
    adaptive = plan.repeated.tolerance is not None
    totals = [sum(run.seconds.values()) for run in ended]
    return {
        "name": plan.name,
        "words": plan.words,
        "control": plan.control,
        "agrees": agrees,
        "sentence": _sentence(rows, agrees, plan.control, len(ended), contradicted),
        "robot": carried.robot.name,
        "shots": len(carried.postures),
        "noise": {"joint_deg": float(np.degrees(problem.noise.joint[0])), "spot_mm": problem.noise.spot},
        "runs": len(runs),
        "failed": len(runs) - len(ended),
        "failures": sorted({run.failure for run in runs if run.failure is not None}),
        "refused": sum(len(run.refused) for run in runs),
        "contradicted": contradicted,
        "parameters": rows,
        "seconds": _seconds(ended),
        "within_limit": max(totals) <= _LIMIT_S if totals else None,
        "shots_used": {"mean": float(np.mean(used)), "min": min(used), "max": max(used)}
        if used
        else dict.fromkeys(("mean", "min", "max")),
        "saved": float(np.mean(saved)) if adaptive and saved else None,
        "computing_s": float(np.mean([run.computing for run in runs])),
    }


def _of_offset(name: str, runs: Sequence[CellRun], states: Sequence[SoFar | None]) -> tuple[Matrix, Matrix]:
    """Errors and stds (R,), deg or mm, of the runs that tell the offset."""
    told = []
    for run, state in zip(runs, states, strict=True):
        for offset in () if state is None else state.offsets:
            if offset.name == name and offset.estimate is not None and offset.std is not None:
                told.append((offset.estimate - run.truth[name], offset.std))
    error, std = np.array(told).reshape(-1, 2).T
    return error, std


def _coverage(error: Matrix, std: Matrix, alarm: float) -> dict[str, Any] | None:
    """None where no run tells the offset."""
    if not len(error):
        return None
    held = int((np.abs(error) <= stats.norm.ppf((1 + _LEVEL) / 2) * std).sum())
    return held_share(held, len(error), _LEVEL, alarm)


def _seconds(runs: Sequence[CellRun]) -> dict[str, dict[str, float | None]]:
    told: dict[str, dict[str, float | None]] = {}
    for phase in (*PHASES, "total"):
        spent = [sum(run.seconds.values()) if phase == "total" else run.seconds[phase] for run in runs]
        told[phase] = (
            {"mean": float(np.mean(spent)), "max": max(spent)} if spent else {"mean": None, "max": None}
        )
    return told


def _sentence(
    rows: Sequence[dict[str, Any]], agrees: bool, control: bool, ended: int, contradicted: int
) -> str:
    judged = [row for row in rows if row["coverage"] is not None]
    if not judged:
        return "No offset that these shots could tell"
    worst = max(judged, key=lambda row: abs(row["coverage"]["share"] - _LEVEL))
    share = worst["coverage"]["share"]
    text = (
        f"{100 * _LEVEL:g} % intervals hold the truth in {100 * share:.1f} % at the worst ({worst['name']}): "
    )
    if control:
        text += "not seen to be wrong" if agrees else "wrong, and seen to be"
        return f"{text}. Of themselves {contradicted} of {ended} runs say that they contradict the model"
    text += "as promised" if agrees else "not as promised"
    silent = {row["name"]: ended - (0 if row["coverage"] is None else row["coverage"]["of"]) for row in rows}
    untold = [f"{name} in {count} runs" for name, count in silent.items() if count]
    return text + (f". Without an interval, as the run could not tell it: {listed(untold)}" if untold else "")


def _headline(runs: int, plans: Sequence[dict[str, Any]]) -> str:
    shown, controls = ([p for p in plans if p["control"] is of] for of in (False, True))
    short = [plan["name"] for plan in shown if not plan["agrees"]]
    unseen = [plan["name"] for plan in controls if plan["agrees"]]
    longest = max((plan["seconds"]["total"]["max"] or 0.0 for plan in shown), default=0.0)
    return " ".join(
        [
            f"Over {runs} runs a plan through the whole chain, the intervals that a run shows"
            f" {'hold' if not short else 'do not hold'} what they promise"
            f"{f' ({listed(short)})' if short else ''}.",
            f"Not seen to be wrong: {listed(unseen)}." if unseen else "Every control is seen to be wrong.",
            f"The longest run takes {longest:.0f} s of the six minutes that the paper allows."
            if longest <= _LIMIT_S
            else f"The longest run takes {longest:.0f} s, more than the paper's six minutes.",
        ]
    )
