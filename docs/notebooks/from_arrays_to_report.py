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
# Seven postures in a row from back to front, joint 1 at rest (the X-Pattern of the paper). Check it before
# you measure:

# %%
in_a_row = zb.Plan.from_arrays(
    **common,
    postures=[
        [0, 4.0, 35.8, 0, -50.1, 0],
        [0, 12.4, 24.6, 0, -39.1, 0],
        [0, 20.4, 12.1, 0, -26.5, 0],
        [0, 28.8, -1.9, 0, -12.8, 0],
        [0, 37.9, -18.3, 0, 1.9, 0],
        [0, 49.0, -39.2, 0, 18.5, 0],
        [0, 69.3, -80.4, 0, 45.5, 0],
    ],
    unit="deg",
    target_priors={"psd": {"guess_mm": target_mm}},
)
zb.check(in_a_row)

# %% [markdown]
# J2 (δ2) is unidentifiable: measuring more postures of this kind does not help. If the plan is carried out
# all the same, J2 has no estimate and no uncertainty in any output. Here a simulated arm carries it out;
# the true offset of its joint 2 is 0.3°:

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
# The recorded joint positions are an array, one posture a row. Here a simulated arm gives them; yours come
# from the controller.

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
# The covariance is labelled. An unidentifiable parameter has no row in it.

# %%
offsets = [row.name for row in solution.offsets if row.u is not None]
solution.covariance.select(offsets).to_frame()

# %%
solution.plot.posterior()

# %% [markdown]
# The draws are an `xarray.Dataset`, which ArviZ takes: `az.summary(solution.posterior)`. The uncertainty of a
# function of offsets follows from its values over the draws. Here it is the sum of two:

# %%
draws = solution.posterior
total = draws["delta2"] + draws["delta3"]
print(f"J2 + J3: {float(total.mean()):.3f} deg, u = {float(total.std()):.3f} deg")

# %% [markdown]
# ## The report
#
# HTML, PDF, `result.json`, the draws and the figures:

# %%
paths = solution.report("report")
print(sorted(path.name for path in paths.folder.iterdir()))
