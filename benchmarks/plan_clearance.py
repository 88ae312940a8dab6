"""What beams that clear the arm cost a plan: its largest u, over that of a plan that looks through the arm.

    python benchmarks/plan_clearance.py                       # every built-in arm, three targets
    python benchmarks/plan_clearance.py --arms ur5e,irb1600 --candidates 1000

Each plan is that of a new calibration with a laser, from the same seed and number of candidates. The u is the
largest of the offsets that both plans determine by more than what is assumed; the distance is by the plan's
own violations: a plan with one is named.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from zerobeam.analysis.observability.check import Check
from zerobeam.analysis.observability.clearance import Clearance
from zerobeam.analysis.status import known
from zerobeam.experiments.measuring_options import PlanOptions
from zerobeam.experiments.plans.make import PlanRequest, make_plan
from zerobeam.experiments.plans.new_calibration import PLACES, new_calibration, place_of
from zerobeam.model.errors import ZerobeamError
from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import built_in_robots, load_robot

PLACES_TRIED = ("front", "floor")
MOST = 1.15  # times as large a u, by issue 45


def request_of(arm: str, place: str, shots: int, count: int) -> PlanRequest:
    """The plan of a new calibration with a laser, by all other defaults."""
    robot, row = load_robot(arm, Path(".")), next(each for each in PLACES if each.kind == place)
    new = new_calibration("laser", robot, place_of(row.kind, robot, None), row.facing, shots, {})
    stated = dict(option[2:].split("=") for option in new.options)
    options = PlanOptions(
        shots=shots,
        candidates=count,
        facing=tuple(map(float, stated["facing"].split(","))),
        beam_mm=tuple(map(float, stated["beam"].split(","))),
    )
    header = Header.model_validate({"robot": arm, **new.header})
    return PlanRequest.of("optimal", header, Path("."), options)


def planned(request: PlanRequest) -> Check:
    checked = make_plan(request, None, lambda stage, share: None).checked
    assert checked is not None
    return checked


@contextmanager
def arm_transparent() -> Iterator[None]:
    """No link is in the way of a beam, as before plans judged it."""
    whole = Clearance.in_the_way

    def free(*at: Any, **by: Any) -> Any:
        found = whole(*at, **by)
        return found._replace(blocked=np.zeros_like(found.blocked))

    with mock.patch.object(Clearance, "in_the_way", free):
        yield


def largest(checks: Sequence[Check]) -> tuple[float, ...]:
    """Of each plan the largest u, deg, of the offsets that all of them determine."""
    rows = [{row.name: row for row in each.parameters if row.group == "offset"} for each in checks]
    both = [name for name in rows[0] if all(known(each[name].status) for each in rows)]
    return tuple(max(each[name].std or 0.0 for name in both) for each in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--arms", default=",".join(built_in_robots()))
    parser.add_argument("--places", default=",".join(PLACES_TRIED))
    parser.add_argument("--shots", type=int, default=12)
    parser.add_argument("--candidates", type=int, default=300)
    asked = parser.parse_args()
    ratios = []
    for place in asked.places.split(","):
        for arm in asked.arms.split(","):
            request = request_of(arm, place, asked.shots, asked.candidates)
            try:
                clear = planned(request)
                with arm_transparent():
                    through = planned(request)
            except ZerobeamError as error:
                print(f"{arm:24} {place:6} {error}", flush=True)
                continue
            now, before = largest((clear, through))
            ratios.append(now / before)
            blocked = sum(bool(each.violations) for each in clear.postures)
            print(
                f"{arm:24} {place:6} u {now:.4f}°, through the arm {before:.4f}°: {ratios[-1]:.3f}"
                f"{f'; {blocked} blocked' if blocked else ''}",
                flush=True,
            )
    beyond = sum(ratio > MOST for ratio in ratios)
    median, most = np.median(ratios), max(ratios)
    print(f"{len(ratios)} plans: median {median:.3f}, largest {most:.3f}; {beyond} above {MOST}")


if __name__ == "__main__":
    main()
