# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # My own instrument
#
# A kind of instrument is one class: what it reads, and what is unknown of it. Jacobians, identifiability,
# plans and reports follow. Here a camera on the flange measures where it sees a mark.
# [The how-to page](../how-to/own-instrument.md) explains each member.

# %%
from dataclasses import dataclass
from typing import Literal

import numpy as np

import zerobeam as zb
from zerobeam.model.instruments import registry
from zerobeam.model.instruments.kind import Station, Unknown, Words
from zerobeam.model.parsing.validation import FileModel, Positive, Vector


class StatedCamera(FileModel):
    kind: Literal["camera"]
    eye_mm: Vector  # the centre of the camera in the flange frame; it looks along z
    sigma_mrad: Positive


@dataclass(frozen=True, eq=False)
class Camera(Station):
    Stated = StatedCamera
    name, also_called, columns = "camera", ("eye",), {"measured_mrad": 2}
    target, target_is, met = "mark", "point", False
    residual_size = reading_size = 2
    words = Words(
        is_="a camera that sees a mark",
        part="camera",
        motion="shift of the camera",
        unit="mm",
        reading="place in the picture",
        method="a camera on the flange",
        posture="the line to the mark",
        to_do="Take a picture of the mark.",
        fields=(),
        traced=(),
    )
    eye: np.ndarray
    sigma: float

    @classmethod
    def of(cls, label, entry, *, exact):
        return cls(label, np.array(entry.eye_mm), entry.sigma_mrad)

    @property
    def key(self):
        return b"camera"

    @property
    def std(self):
        return self.sigma

    @property
    def unknowns(self):  # known to half a millimetre
        return tuple(
            Unknown(axis, "mm", value, 0.5, f"{self.label}.eye", tolerated=True)
            for axis, value in zip("xyz", self.eye.tolist(), strict=True)
        )

    def reading(self, measured, sigma, target):
        return np.array(measured.get("measured_mrad", (0.0, 0.0)))

    def recorded(self, reading, shift):
        return {"measured_mrad": tuple((reading + shift).tolist())}

    def predicted(self, flange, target, unknowns, reading, variant):
        mark = flange.in_flange(target) - unknowns
        return 1000 * mark[:2] / mark[2]

    def residual(self, flange, target, unknowns, reading, variant):
        return self.predicted(flange, target, unknowns, reading, variant) - reading

    def start_target(self, poses, readings, unknowns):  # nearest to all lines of sight
        eyes = poses[:, :3, :3] @ unknowns + poses[:, :3, 3]
        lines = np.column_stack([readings / 1000, np.ones(len(readings))])
        lines = np.einsum("nij,nj->ni", poses[:, :3, :3], lines / np.linalg.norm(lines, axis=1)[:, None])
        across = np.eye(3) - lines[:, :, None] * lines[:, None, :]
        return np.linalg.solve(across.sum(0), (across @ eyes[:, :, None]).sum(0)[:, 0])


# %% [markdown]
# A package names its kind by an entry point. For a trial in a notebook, enter it by hand:

# %%
registry.KINDS["camera"] = Camera
header = {
    "robot": "irb1600",
    "instruments": {"eye": {"kind": "camera", "eye_mm": [10, 20, 30], "sigma_mrad": 0.1}},
    "noise": zb.Noise(joint_deg=0.005),
    "geometry": "exact",
}
mark_mm = (1200, 300, 200)

# %% [markdown]
# ## Postures that see the mark
#
# Random postures, kept where the mark is at least 200 mm in front of the camera and not far from its axis.

# %%
robot, rng = zb.load_robot("irb1600"), np.random.default_rng(3)
joints = rng.uniform(0.4 * np.degrees(robot.lower), 0.4 * np.degrees(robot.upper), (20_000, 6))
poses = robot.fk(joints, unit="deg")
marks = np.einsum("nji,nj->ni", poses[:, :3, :3], mark_mm - poses[:, :3, 3])
in_front = (marks[:, 2] > 200) & (np.hypot(marks[:, 0], marks[:, 1]) < 0.3 * marks[:, 2])
postures = joints[in_front][:24]
print(len(postures), "postures")

# %% [markdown]
# ## Check, rehearse, analyse

# %%
plan = zb.Plan.from_arrays(
    **header,
    postures=postures,
    unit="deg",
    targets="mark",
    target_priors={"mark": {"guess_mm": mark_mm, "sigma_mm": 50}},
)
zb.check(plan)

# %%
solution = zb.analyse(zb.simulate(plan, {"delta2": 0.3, "delta5": -0.1}, seed=1), ess=100)
solution.offsets

# %%
solution.residuals.head()
