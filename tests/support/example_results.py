"""Results for the tests of the reports, by the real functions on small runs with fixed seeds: good,
degenerate, badly fitting, hostile. Each is made when it is first asked for, and once."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from cells import OPEN_LASER, TABLE_2, good_plan, header, irb1600, plan_of, simulated, varied_postures
from exact_runs import demo_runs
from made_once import made_once

from zerobeam.analysis.analyse import Analysis, analyse
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.observability.causes import NullDirection, TargetUnseen
from zerobeam.analysis.posterior import sampler
from zerobeam.analysis.posterior.posterior import Draws
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.files.header import StatedDistance, StatedGeometry, StatedTarget
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.kinematics.robot import Robot
from zerobeam.reports.run.report import pictures
from zerobeam.reports.style.canvas import Picture

HOSTILE_NAMES = (
    "<script>alert('x')</script>",
    '#import "/etc/passwd": *; $x^2$ *bold* `raw` @cite <label>',
    "../../x",
    "long" * 75,
    "\u202eמטרה left",
    "🎯 target",
    "nul\x00inside",
    "$\\frac{1}{0}$ {{ 7*7 }} {% raw %}",
    "lone\ud800surrogate",
    'quote" onload="alert(1)',
)

# An estimate that no report may show where the data do not determine it.
FORBIDDEN = -1.23456789

_SEED = 20140803


def _analysed(run: Run, **asked: Any) -> Analysis:
    return analyse(run, seed=_SEED, ess=400.0, **asked)


def _demo(name: str, geometry: str | None = "exact") -> Run:
    """A run of the demo, with exact geometry; None: as it is, of a typical arm."""
    (path,) = [demo.path for demo in demo_runs() if demo.name == name]
    run = read_run(path)
    return replace(run, header=run.header.model_copy(update={"geometry": geometry}))


def _named(run: Run, name: str) -> Run:
    return replace(run, path=Path(name))


def _with_forbidden(found: Analysis) -> Analysis:
    """The posterior's rows of what only the prior says, with numbers that are found nowhere else. (A real
    run has the prior's own there, 0 and 5°, which a report may well say elsewhere.)"""
    posterior = found.result.posterior
    if posterior.parameters is None:
        return found
    rows = tuple(
        replace(row, mean=FORBIDDEN, q50=FORBIDDEN, std=4.987, q2_5=-9.77, q97_5=9.79)
        if row.source == "prior"
        else row
        for row in posterior.parameters
    )
    return replace(found, result=replace(found.result, posterior=replace(posterior, parameters=rows)))


def _good() -> Analysis:
    """Seven varied measurements with a calibrated laser: all identified."""
    run = _demo("good")
    provenance = {**run.header.provenance, "serial number": "1600-500123"}
    return _analysed(replace(run, header=run.header.model_copy(update={"provenance": provenance})))


def _x_pattern() -> Analysis:
    """θ1 hardly changes: δ2 and the target's position are not determined."""
    return _with_forbidden(_analysed(_demo("x-pattern")))


def _uncalibrated() -> Analysis:
    """An uncalibrated laser in few measurements: δ6 is held besides δ1, δ2 and some of the tool are weak."""
    plan = good_plan(8, tool=OPEN_LASER)
    return _analysed(_named(simulated(plan, TABLE_2, 1)[1], "uncalibrated.jsonl"))


def _longer_upper_arm(millimetres: float) -> Robot:
    """An IRB 1600 whose third joint is farther from its second than nominal."""
    robot = irb1600()
    joints = list(robot.joints)
    fixed = joints[2].fixed.copy()
    fixed[:3, 3] *= 1 + millimetres / np.linalg.norm(fixed[:3, 3])
    joints[2] = replace(joints[2], fixed=fixed)
    return replace(robot, joints=tuple(joints))


def _misfit() -> Analysis:
    """An arm that deviates from nominal: its upper arm is 6 mm longer. A probe in eight sockets, the tip
    nearly on axis 6, so that δ6 is weak; distances between the sockets."""
    places = {
        f"{side}_{i}{end}": (700.0 + 120 * i, y + dy, z)
        for side, y, z in (("left", 250.0, 450.0), ("right", -300.0, 650.0))
        for i in (1, 2)
        for end, dy in (("a", 0.0), ("b", 50.0))
    }
    tool = {"kind": "probe", "calibrated": True, "point_mm": [0.5, 0, 150]}
    distances = [
        {"between": [f"{side}_{i}a", f"{side}_{i}b"], "mm": 50.0, "sigma_mm": 0.1}
        for side in ("left", "right")
        for i in (1, 2)
    ]
    targets = {name: {"guess_mm": list(place)} for name, place in places.items()}
    own = header(tool, target=None, targets=targets, distances=distances)
    alone = header(tool, target=None)
    each = 12
    postures = [
        varied_postures(alone, irb1600(), place, each, seed) for seed, place in enumerate(places.values())
    ]
    names = [name for name in places for _ in range(each)]
    plan = plan_of(own, np.vstack(postures), names, _longer_upper_arm(6.0))
    run = simulated(plan, TABLE_2, 3)[1]
    return _analysed(_named(replace(run, robot=irb1600()), "sockets.jsonl"))


def _unconverged() -> Analysis:
    """As the good one, but the sampler has its slow move only, and may not go on for long enough."""
    short = dict.fromkeys(("_FEW_STEPS", "_FIRST_LOOK"), 20)
    slow = dict.fromkeys(("SHARE", "MANY_SHARE"), 1.0)
    with patch.multiple(sampler, BUDGET=0, _PER_ESS=0, _MANY=20, **short, **slow):
        return _analysed(_demo("good"))


def _outlier() -> Analysis:
    """Someone leaned on the bench at measurement 2; a robust fit was asked for."""
    run = simulated(good_plan(12), TABLE_2, 3)[1]
    x, y = run.shots[2].spot_mm or (0.0, 0.0)
    shots = list(run.shots)
    shots[2] = shots[2].model_copy(update={"spot_mm": (x + 4.0, y - 3.0)})
    return _analysed(_named(replace(run, shots=tuple(shots)), "outlier.jsonl"), robust="huber")


def three_targets(each: int) -> Plan:
    """A plan of so many measurements of each of three targets."""
    at = {"near": (900.0, 0.0, 0.0), "left": (700.0, 500.0, 200.0), "right": (800.0, -400.0, 300.0)}
    targets = {name: {"guess_mm": list(guess)} for name, guess in at.items()}
    postures = [
        varied_postures(header(target=guess), irb1600(), guess, each, seed)
        for seed, guess in enumerate(at.values())
    ]
    names = [name for name in at for _ in range(each)]
    return plan_of(header(target=None, targets=targets), np.vstack(postures), names)


def _held_out() -> Analysis:
    """Three targets, of which two were held out; the offsets hold there."""
    run = _named(simulated(three_targets(8), TABLE_2, 3)[1], "three-targets.jsonl")
    return _analysed(run, held_out=("left", "right"))


def _geometry() -> Analysis:
    """Three targets, an upper arm that is 0.4 mm longer, and the geometry estimated, the ladder included."""
    run = simulated(replace(three_targets(8), robot=_longer_upper_arm(0.4)), TABLE_2, 3)[1]
    own = run.header.model_copy(update={"geometry": StatedGeometry(scale="estimated")})
    return _analysed(_named(replace(run, robot=irb1600(), header=own), "links.jsonl"))


def _separate() -> Analysis:
    """Both noises up to a factor of their own: only that of the joints is observable, and weakly."""
    plan = good_plan(8, noise={"scale": "separate"}, spot_mm=0.01)
    return _analysed(_named(simulated(plan, TABLE_2, 3)[1], "separate.jsonl"))


def _hostile() -> Analysis:
    """Targets, run and provenance with every kind of bad name, in a degenerate plan with a robust fit and
    held-out targets.

    No reader lets all these names pass: they are put in behind it, since the reports rely on nobody.
    """
    # With a prior of 5 degrees delta5 would be lost without the other optimum already.
    own = header(target=(900.0, 0.0, 0.0), prior={"offset_deg": 6.0})
    names = [name for name in HOSTILE_NAMES for _ in range(2)]
    postures = pattern(own, irb1600(), np.array([900.0, 0.0, 0.0]), "x", len(names))
    postures[-1] = postures[-2]  # the last target is seen from one direction only: its name is in a reason
    run = simulated(plan_of(own, postures), TABLE_2, 2)[1]
    shots = [shot.model_copy(update={"target": name}) for shot, name in zip(run.shots, names, strict=True)]
    everything = " ".join(HOSTILE_NAMES)
    apart = StatedDistance.model_construct(
        between=(HOSTILE_NAMES[0], HOSTILE_NAMES[3]), mm=50.0, sigma_mm=0.1
    )
    bad = own.model_copy(
        update={
            "targets": {HOSTILE_NAMES[-1]: StatedTarget(guess_mm=(900.0, 0.0, 0.0), sigma_mm=100.0)},
            "distances": (apart,),
            "provenance": dict.fromkeys(HOSTILE_NAMES, everything),
        }
    )
    run = replace(
        run,
        header=bad,
        shots=tuple(shots),
        path=Path(everything.replace("/", "\u2044")),
        warnings=(everything,),
    )
    found = _with_forbidden(_analysed(run, robust="huber", held_out=HOSTILE_NAMES[:9]))
    # Causes that name a target, in plenty: what this run has is mostly of joints.
    facts = found.result.identifiability
    unseen = tuple(
        NullDirection({f"{name}.x": 1.0}, "noise", TargetUnseen(name, 2), 2.0) for name in HOSTILE_NAMES
    )
    facts = replace(facts, null_space=(*facts.null_space, *unseen))
    return replace(found, result=replace(found.result, identifiability=facts))


class Example(NamedTuple):
    """What reports are made of."""

    result: Result
    draws: Draws | None

    @classmethod
    def of(cls, analysis: Analysis) -> Example:
        return cls(analysis.result, analysis.draws)


_MADE: dict[str, Example] = {}


def analysed(name: str) -> Example:
    """An example, made once in a session."""
    if name not in _MADE:
        _MADE[name] = made_once(f"example {name}", lambda: Example.of(_MAKERS[name]()))
    return _MADE[name]


_ALL = (
    _good,
    _x_pattern,
    _uncalibrated,
    _misfit,
    _unconverged,
    _outlier,
    _held_out,
    _separate,
    _geometry,
    _hostile,
)
_MAKERS: dict[str, Callable[[], Analysis]] = {maker.__name__.removeprefix("_"): maker for maker in _ALL}


class _Examples(Mapping[str, Result]):
    """The results by their names; one that nobody asks for costs nothing."""

    def __getitem__(self, name: str) -> Result:
        return analysed(name).result

    def __iter__(self) -> Iterator[str]:
        return iter(_MAKERS)

    def __len__(self) -> int:
        return len(_MAKERS)


EXAMPLES = _Examples()


good, x_pattern, uncalibrated, misfit, unconverged, outlier, held_out, separate, geometry, hostile = (
    functools.partial(EXAMPLES.__getitem__, name) for name in EXAMPLES
)


def draws(result: Result) -> Draws:
    """The draws of an example, also where it was changed in other parts than its posterior."""
    found = _draws(result)
    assert found is not None
    return found


def _draws(result: Result) -> Draws | None:
    return next(own.draws for own in _MADE.values() if own.result.posterior is result.posterior)


def drawn(result: Result, of: Draws | None = None) -> dict[str, Picture]:
    """The figures of a result; those of an example as it stands are drawn once for all tests."""
    for name, own in _MADE.items():
        if of is None and result is own.result:
            return _drawn_once(name)
    return pictures(result, of or _draws(result))


@functools.cache
def _drawn_once(name: str) -> dict[str, Picture]:
    return made_once(f"figures of {name}", lambda: pictures(EXAMPLES[name], analysed(name).draws))
