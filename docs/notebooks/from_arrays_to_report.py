# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # From arrays to a report
#
# This page is a notebook in plain Python ([jupytext](https://jupytext.readthedocs.io) percent format): open
# it in Jupyter, or run it as a script. It needs `pip install "zerobeam[notebook]"` for the tables and the
# draws.
#
# What all measurements have in common: the robot, the laser on its flange (a point of the beam and its
# direction, in the flange frame), and the noise of the readings as standard deviations.

# %%
import numpy as np

import zerobeam as zb

common = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}
target_mm = (900, 0, 0)  # base frame

# %% [markdown]
# ## A plan that cannot work
#
# Five postures in a row from back to front, joint 1 at rest. Ask before you measure:

# %%
in_a_row = zb.Plan.from_arrays(
    **common,
    postures=[[0, 10 * k, 20 - 5 * k, 0, 50 - 5 * k, 0] for k in range(5)],
    unit="deg",
    target_priors={"psd": {"guess_mm": target_mm}},
)
zb.check(in_a_row)

# %% [markdown]
# J2 (δ2) is unidentifiable: no number of such measurements would determine it, and no output gives it a
# number. Were the plan measured all the same, the answer would say so too. Here a simulated arm measures
# it, whose offset of joint 2 is 0.3°:

# %%
degenerate = zb.analyse(zb.simulate(in_a_row, {"delta2": 0.3}, seed=1))
delta2 = degenerate["delta2"]
print(degenerate.verdict, delta2.status, delta2.estimate, delta2.u)
print("delta2" in degenerate.covariance.names)

# %% [markdown]
# ## A plan that works
#
# `optimal_plan` chooses the best postures from many random ones that can reach the target.

# %%
best = zb.optimal_plan(common, target_mm, shots=7, candidates=2000, seed=0)
best

# %%
best.check.plot.scene()

# %% [markdown]
# ## The measurements
#
# Recorded joint positions are an array, one posture a row. Here they are of the same simulated arm, as it
# would be servoed onto the target; yours come from the controller.

# %%
recorded = np.degrees(zb.simulate(best.plan, {"delta2": 0.3, "delta5": -0.1}, seed=1).joints)
print(recorded.round(3))

# %%
run = zb.Run.from_arrays(**common, joints=recorded, unit="deg", name="from arrays")
solution = zb.analyse(run, seed=0)
solution

# %% [markdown]
# The correction is: true angle = recorded angle + offset. Each offset has a standard uncertainty `u` and a
# 95 % interval:

# %%
delta2 = solution["delta2"]
low, high = delta2.interval95
print(f"J2: {delta2.estimate:.3f} deg, u = {delta2.u:.3f} deg, {low:.3f} to {high:.3f} deg, {delta2.status}")

# %%
solution.offsets.to_frame()

# %% [markdown]
# ## Figures

# %%
solution.plot.offsets()

# %%
solution.plot.residuals()

# %%
solution.plot.scene()

# %% [markdown]
# ## Covariance and posterior
#
# The covariance is labelled, and has rows for what the data determine and for nothing else.

# %%
offsets = [row.name for row in solution.offsets if row.u is not None]
solution.covariance.select(offsets).to_frame()

# %%
solution.plot.posterior()

# %% [markdown]
# The draws are an `xarray.DataTree` with a group `posterior`, as ArviZ takes it. A function of the offsets
# has the uncertainty that its values over the draws have: here the sum of two.

# %%
draws = solution.posterior["posterior"]
total = draws["delta2"] + draws["delta3"]
print(f"J2 + J3: {float(total.mean()):.3f} deg, u = {float(total.std()):.3f} deg")

# %% [markdown]
# ## The report
#
# HTML, PDF, `result.json`, the draws and the figures:

# %%
paths = solution.report("report")
print(sorted(path.name for path in paths.folder.iterdir()))
