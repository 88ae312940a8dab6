"""The arm, laser and PSD that the studies of laser plans share, and how their postures are chosen."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.files.from_arrays import Laser
from ...model.files.header import EXACT, Header
from ...model.files.robot_file import load_robot
from ...model.kinematics.robot import Robot
from ..plans.candidates import CandidatePostures, candidates
from ..plans.optimal import Planner
from ..plans.patterns import pattern

MEASUREMENTS = 7
SIGMA_MM = 30.0  # to which a person knows the PSD; without a camera the beam is searched for around it
_TARGET = (950.0, 150.0, 100.0)


def laser_header(joint_deg: float, spot_mm: float, sigma_mm: float | None = None) -> Header:
    """The paper's arm with a calibrated laser, both exact as in the paper, and a PSD near _TARGET, with the
    prior `sigma_mm` if any."""
    psd = {"guess_mm": list(_TARGET), **({} if sigma_mm is None else {"sigma_mm": sigma_mm})}
    return Header.model_validate(
        {
            "robot": "irb1600",
            "tool": Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)).content(),
            "noise": {"joint_deg": joint_deg, "spot_mm": spot_mm},
            "targets": {"psd": psd},
            "geometry": EXACT,
        }
    )


def robot_of(header: Header) -> Robot:
    """The built-in arm of a header."""
    return load_robot(header.robot, Path())


def y_postures(header: Header, span: float | None = None) -> Matrix:
    """(7, n) rad: our Y-Pattern over the arm's whole reach, or a share `span` of it."""
    return pattern(header, robot_of(header), np.array(_TARGET), "y", MEASUREMENTS, span=span)


def candidate_postures(header: Header, count: int, seed: int) -> CandidatePostures:
    return candidates(header, robot_of(header), np.array(_TARGET), count, seed=seed)


def planner(header: Header, count: int, seed: int) -> Planner:
    """The planner that chooses the best of `count` random postures."""
    random_postures = candidate_postures(header, count, seed)
    return Planner(header, robot_of(header), {"psd": np.array(_TARGET)}, [random_postures])


def optimal_postures(header: Header, count: int, seed: int) -> Matrix:
    """(7, n) rad: the A-optimal ones of `count` random postures."""
    return planner(header, count, seed).optimal(MEASUREMENTS, seed=seed).postures
