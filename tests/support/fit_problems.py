"""Problems of every kind that a fit climbs on: tools, targets, what is held, a slide, the noise, links."""

import functools

import numpy as np
from cells import OPEN_LASER, OPEN_PROBE, good_plan, header, plan_of, random_robot

from zerobeam.model.likelihood.problem import Problem

TARGETS = {"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [800, 100, 200], "sigma_mm": 500.0}}


KINDS = [
    *("laser", "two targets, open laser", "b not measured yet", "a held", "prismatic, open probe", "links"),
    *("separate noise", "all targets held"),
]


@functools.cache
def fit_problems() -> dict[str, Problem]:
    postures = good_plan(8).postures
    robot, slide = random_robot("rprrr", 4), header(OPEN_PROBE, noise={"joint_mm": 0.02})
    joints = np.random.default_rng(3).uniform(-1, 1, (6, 5)) * np.where(robot.display > 1, 1.0, 100.0)
    two = plan_of(header(OPEN_LASER, targets=TARGETS), postures, ["a", "b"] * 4)
    held = plan_of(header(targets=TARGETS, held=["delta1", "delta4", "a.y"]), postures, ["a", "b"] * 4)
    fixed = header(held=["delta1", "psd.x", "psd.y", "psd.z"])
    return {
        "laser": Problem.from_plan(good_plan(8)),
        "two targets, open laser": Problem.from_plan(two),
        "b not measured yet": Problem.from_plan(two).select(np.arange(0, 8, 2)),
        "a held": Problem.from_plan(held),
        "prismatic, open probe": Problem.build(slide, robot, joints, ["psd"] * 6),
        "links": Problem.from_plan(plan_of(header(geometry={}), postures)),
        "separate noise": Problem.from_plan(plan_of(header(noise={"scale": "separate"}), postures)),
        "all targets held": Problem.from_plan(plan_of(fixed, postures)),
    }
