# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A plan for my arm
#
# Before the first measurement: which postures, how many of them, and what will be known afterwards. The page
# is a notebook in plain Python; the tables need `pip install "zerobeam[notebook]"`.
#
# First the arm. Compare its forward kinematics with the position that the pendant shows.

# %%
import numpy as np

import zerobeam as zb

robot = zb.load_robot("ur5e")
pose = robot.fk([0, -90, 90, -90, -90, 0], unit="deg")
print(pose[:3, 3].round(1), "mm")

# %% [markdown]
# What all measurements have in common: arm, tool and noise. The beam leaves the flange sideways here. The
# target is a PSD that faces up.

# %%
header = {
    "robot": "ur5e",
    "tool": zb.Laser(point_mm=(0, 0, 40), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}
target_mm = (500, 100, 50)

# %% [markdown]
# ## How many measurements
#
# `optimal_plan` chooses postures among random candidates. More measurements lower the uncertainty, until the
# tolerances of the arm set it.

# %%
plans = {count: zb.optimal_plan(header, target_mm, shots=count, candidates=300) for count in (7, 12, 20)}
for count, each in plans.items():
    worst = max(row.u for row in each.check.offsets if row.u is not None)
    print(f"{count:2} measurements: largest u = {worst:.3f} deg, {each.check.verdict}")

# %% [markdown]
# ## What it will determine

# %%
best = plans[12]
best.check.offsets

# %%
best.check.plot.scene()

# %% [markdown]
# ## A plan of your own
#
# Any postures can be checked. These have joint 1 at rest, so that joint 2 is unidentifiable:

# %%
postures = np.degrees(best.plan.postures)
postures[:, 0] = postures[0, 0]
still = zb.Plan.from_arrays(
    **header, postures=postures, unit="deg", target_priors={"psd": {"guess_mm": target_mm}}
)
zb.check(still)["J2"].status

# %% [markdown]
# ## To the controller
#
# The postures are in radians. Degrees are what a pendant takes; `zerobeam export plan` writes programs of the
# makers.

# %%
print(np.degrees(best.plan.postures[:3]).round(2))
