"""What tests of several files look at: the answer and the plan that a notebook begins with."""

import pytest
from analysed_once import analysed_once
from exact_runs import demo_runs
from made_once import made_once

import zerobeam as zb

HEADER = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}


@pytest.fixture(scope="session")
def good() -> zb.Analysed:
    return analysed_once(zb.read_run(demo_runs()[0].path), ess=100)


@pytest.fixture(scope="session")
def best() -> zb.OptimalPlan:
    return made_once("best plan", lambda: zb.optimal_plan(HEADER, (900, 0, 0), candidates=300))
