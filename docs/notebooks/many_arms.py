# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Many arms
#
# The same plan on several arms of one type: which arm is off, and do repeated runs of one arm agree? The page
# is a notebook in plain Python; simulated arms give the measurements. `zerobeam batch` and `zerobeam history`
# do the same with files.

# %%
import pickle
from pathlib import Path

import pandas as pd

import zerobeam as zb

header = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    "geometry": "exact",
}
plan = zb.optimal_plan(header, (900, 0, 0), shots=10, candidates=300).plan

# %% [markdown]
# ## One run of each arm
#
# Joint 3 of the third arm has a zero error of half a degree.

# %%
serials = ["16-101", "16-102", "16-103", "16-104"]
zero_errors = [{"delta2": 0.02}, {"delta4": -0.05}, {"delta3": 0.5}, {"delta5": 0.01}]
runs = [zb.simulate(plan, errors, seed=k, name=serials[k]) for k, errors in enumerate(zero_errors)]
solutions = {serial: zb.analyse(run, ess=100) for serial, run in zip(serials, runs, strict=True)}

# %% [markdown]
# The offsets side by side, degrees. An offset that the data do not determine would be empty.

# %%
table = pd.DataFrame(
    {serial: solution.offsets.to_frame()["estimate"] for serial, solution in solutions.items()}
)
table.round(3)

# %% [markdown]
# Which offsets are larger than their expanded uncertainty and than 0.1°?

# %%
large = [
    (serial, row.name, round(row.estimate, 3))
    for serial, solution in solutions.items()
    for row in solution.offsets
    if row.u is not None and abs(row.estimate) > max(2 * row.u, 0.1)
]
large

# %% [markdown]
# ## Repeated runs of one arm
#
# `compare` tests the scatter of the runs against their stated uncertainty.

# %%
repeated = [zb.simulate(plan, {"delta3": 0.5}, seed=10 + k, name=f"16-103 run {k}") for k in range(4)]
zb.compare(repeated)

# %% [markdown]
# ## Keep the answers
#
# A solution can be pickled. `report` writes files for people, with `result.json` for programs.

# %%
Path("solutions.pickle").write_bytes(pickle.dumps(solutions))
again = pickle.loads(Path("solutions.pickle").read_bytes())
print(again["16-103"] == solutions["16-103"])
