# %% [markdown]
# # A walk through a room
#
# Reads the recording of `examples/room`, solves it with two methods, follows the tag, and compares the errors. In
# cells, as Jupyter (with jupytext), VS Code and Spyder read them; `python room.py` runs it too.

# %%
from pathlib import Path

import numpy as np

import baliza

folder = Path(__file__).parents[2] / "examples" / "room"
recording = baliza.read(folder)
print(f"{len(recording.anchors)} anchors, {len(recording.ranges()['range_m'])} ranges")

# %% [markdown]
# Each epoch by itself, with the tag's height known. Errors come from `truth.csv`.

# %%
solved = {name: recording.solve(name, dims=2, height_from_truth=True) for name in ["nls", "robust"]}
solved["track"] = recording.track(dims=2, height_from_truth=True)
for name, positions in solved.items():
    errors = positions.error_m[np.isfinite(positions.error_m)]
    print(f"{name:7} {len(errors)} of {len(positions)} fixed, median error {np.median(errors):.3f} m")

# %% [markdown]
# Is the uncertainty right? The squared error in units of the covariance has the mean 2 where it is.

# %%
robust = solved["robust"]
known = np.isfinite(robust.error_m)
off = (robust.position_m - robust.truth_m)[known, :2]
inverse = np.linalg.inv(robust.covariance_m2[known][:, :2, :2])
print(f"normalised squared error: {np.einsum('ni,nij,nj->n', off, inverse, off).mean():.2f}")

# %% [markdown]
# A live track: one step for each round.

# %%
anchors = dict(zip(recording.anchors, recording.anchors_m))
track = baliza.Track(anchors, dims=2, height_m=1.2)
tag = np.array([3.0, 2.0, 1.2])
for step in range(20):
    fix = track.step(0.1 * step, {name: float(np.linalg.norm(at - tag)) for name, at in anchors.items()})
print(f"at {fix.position_m[:2].round(2)} ± {fix.sigma_m[:2].round(2)} m, {fix.velocity_m_s[:2].round(2)} m/s")

# %%
assert np.median(solved["robust"].error_m[known]) < np.nanmedian(solved["nls"].error_m)
assert np.abs(fix.position_m[:2] - tag[:2]).max() < 0.05
