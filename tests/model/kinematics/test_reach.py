from __future__ import annotations

import numpy as np
import pytest

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.inverse import longest_reach


def test_the_reach_of_a_stretched_arm() -> None:
    # Axis 1 to 2, upper arm, forearm with its offset, and the flange in line with the stretched wrist.
    wrist, flange = np.hypot(35, 420), 80
    assert longest_reach(load_robot("kr6_r900")) == pytest.approx(25 + 455 + wrist + flange, abs=1.0)
    assert longest_reach(load_robot("kr6_r900")) < 25 + 455 + wrist + flange + 1e-9
    # Of the paper's arm the last frame is the centre of the wrist.
    assert longest_reach(load_robot("irb1600")) == pytest.approx(150 + 700 + 600, abs=0.5)
