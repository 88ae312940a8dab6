# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Tracker and PSD together
#
# A laser alone has no scale. A tracker with an unknown reflector has no offset of the last joint. Together
# they determine both, since it is stated how well the laser's mounting was measured (`sigma`). The page is a
# notebook in plain Python; a simulated arm gives the measurements.

# %%
import zerobeam as zb

header = {
    "robot": "irb1600",
    "tool": {
        "kind": "laser",
        "point_mm": [0, 0, 65],
        "direction": [1, 0, 0],
        "sigma": {"tilt_deg": 0.05, "shift_mm": 0.1},
    },
    "instruments": {
        "leica": {
            "kind": "tracker",
            "guess_mm": [3000, 500, 800],
            "sigma_mm": 0.03,
            "reflectors": {"R1": {"guess_mm": [60, 0, 80]}},
        }
    },
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    "targets": {"psd": {"guess_mm": [900, 0, 200], "sigma_mm": 50}},
}

# %% [markdown]
# ## The plan
#
# `measure` says how many measurements each instrument makes. The laser is called `tool`.

# %%
both = zb.optimal_plan(header, measure={"tool": 7, "leica": 4}, candidates=100)
both.check.offsets

# %% [markdown]
# With the tracker alone a rotation of the last joint is equivalent to one of the reflector. The offset of the
# last joint is held then, and has no number:

# %%
tracker_only = {key: value for key, value in header.items() if key not in ("tool", "targets")}
alone = zb.optimal_plan(tracker_only, shots=11, candidates=100)
print(alone.check["J6"].status, "alone;", both.check["J6"].status, "together")

# %% [markdown]
# ## The measurements
#
# A measurement says which instrument made it. In a run of yours they come from a file (`read_run`), or from
# arrays with `measured={"instrument": …, "measured_mm": …}`.

# %%
run = zb.simulate(both.plan, {"delta2": 0.3, "delta6": -0.2}, seed=1)
solution = zb.analyse(run, ess=100)
solution.offsets

# %%
solution.data.head()

# %% [markdown]
# The residuals of both instruments, each in its own standard deviations:

# %%
solution.plot.residuals()

# %% [markdown]
# ## What limits J6
#
# The share of the variance that stated tolerances set. Measuring more does not lower it; a better calibration
# of the beam does.

# %%
row = solution["J6"]
print(f"J6: {row.estimate:.3f} deg, u = {row.u:.3f} deg, {row.tolerance_share:.0%} by tolerances")
