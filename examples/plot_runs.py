# %% [markdown]
# # Plots of diptych's measurements
#
# Reads the folder given by `--out` and plots every data file in it: `frames.csv` and `run.json` of any command,
# `scale.csv` and `simulate.csv` of `scale`, `bench.csv`, and the tables of `study`. Missing files are skipped. As a program:
#
#     python examples/plot_runs.py out/play [FOLDER OF THE PLOTS]
#
# In an editor or notebook that supports `# %%` cells, set `FOLDER` below and run the cells in order.

# %%
import io
import json
import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pandas as pd

IS_NOTEBOOK = "ipykernel" in sys.modules
if IS_NOTEBOOK:
    FOLDER = Path("out/play")
elif len(sys.argv) in (2, 3):
    FOLDER = Path(sys.argv[1])
    matplotlib.use("Agg")
else:
    sys.exit("usage: plot_runs.py FOLDER [FOLDER OF THE PLOTS]")
PLOTS = FOLDER / "plots" if IS_NOTEBOOK or len(sys.argv) < 3 else Path(sys.argv[2])
PLOTS.mkdir(parents=True, exist_ok=True)


def table(name):
    """The CSV file of that name as a data frame, empty where there is none. `frames.csv` of `play` grows by a line per
    frame, so a last line without its newline is not whole and is left out."""
    path = FOLDER / name
    if not path.exists():
        return pd.DataFrame()
    whole, newline, _ = path.read_text(encoding="utf-8").rpartition("\n")
    return pd.read_csv(io.StringIO(whole + newline)) if whole else pd.DataFrame()


def keep(figure, name):
    """Writes a figure and says so."""
    figure.tight_layout()
    path = PLOTS / f"{name}.png"
    figure.savefig(path, dpi=150)
    print(path)


run_file = FOLDER / "run.json"
run = json.loads(run_file.read_text(encoding="utf-8")) if run_file.exists() else {"settings": {}, "frames": []}
settings = run["settings"]
title = f"{settings.get('shot', FOLDER.name)} at {settings.get('size', '?')}"

# %% [markdown]
# ## Frames: `frames.csv`, every command
#
# One line per frame. `scale` lists the frames of each count of `devices`, `bench` those of each setting.

# %%
frames = table("frames.csv")
if not frames.empty:
    figure, axes = plt.subplots(figsize=(9, 4))
    if "play" in run:
        low_ms, high_ms = run["play"]["budget_ms"]
        axes.axhspan(low_ms, high_ms, color="tab:green", alpha=0.15, label="budget")
    named = [name for name in ("denoiser", "foveation", "seam_policy", "resolution", "arrangement") if name in frames]
    named += ["devices", "spp", "bounces", "iterations", "scale"]
    varied = [name for name in named if frames[name].nunique() > 1]
    if "rung" in frames or not varied:
        axes.plot(frames["frame"], frames["makespan_ms"], ".-", label="measured")
        axes.plot(frames["frame"], frames["predicted_ms"], ".", label="predicted")
        axes.set_xlabel("frame")
        axes.legend()
    else:
        groups = list(frames.groupby(varied))
        axes.boxplot([group["makespan_ms"] for _, group in groups])
        axes.set_xticks(range(1, len(groups) + 1), [", ".join(map(str, key)) for key, _ in groups], rotation=90)
        axes.set_xlabel(", ".join(varied))
    axes.set_ylabel("makespan, ms")
    axes.set_title(title)
    keep(figure, "frames")

# %% [markdown]
# ## Quality over time: the control loop's columns of `frames.csv`, `play`

# %%
if "rung" in frames:
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(9, 5))
    above.step(frames["frame"], frames["rung"], where="post")
    above.set_ylabel("rung, 0 the cheapest")
    below.step(frames["frame"], frames["spp"] * frames["scale"] ** 2, where="post")
    below.set_ylabel("samples per pixel")
    below.set_xlabel("frame")
    share = f": {run['play']['in_band_share']:.1%} of frames in budget" if "play" in run else ""
    above.set_title(title + share)
    keep(figure, "rungs")

# %% [markdown]
# ## Time by stage: the sums of each frame's `stages` in `run.json`
#
# A line per frame, stage, view and device; transfers are the stages `download` and `upload`.

# %%
stages = pd.DataFrame(
    {"number": number, "devices": frame["devices"], **stage}
    for number, frame in enumerate(run["frames"])
    for stage in frame["stages"]
)
if not stages.empty:
    per_frame = stages.groupby(["number", "devices", "device", "stage"], as_index=False)["busy_ms"].sum()
    median = per_frame.groupby(["devices", "device", "stage"])["busy_ms"].median().unstack(fill_value=0.0)
    median.index = [f"device {device} of {devices}" for devices, device in median.index]
    figure, axes = plt.subplots(figsize=(10, 2.5 + 0.5 * len(median)))
    median[median.sum().sort_values(ascending=False).index].plot.barh(stacked=True, ax=axes, colormap="tab20")
    axes.invert_yaxis()
    axes.set_xlabel("busy, ms of a frame (median)")
    axes.set_title(title)
    axes.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1, 0.5))
    keep(figure, "stages")

# %% [markdown]
# ## References: `references` of `run.json`, `render --reference`

# %%
references = pd.json_normalize(run.get("references", []))
if "noise.left.rmse" in references:
    figure, axes = plt.subplots(figsize=(6, 4))
    references.plot.bar(x="index", y=["noise.left.rmse", "noise.right.rmse"], ax=axes)
    axes.set_xlabel("frame")
    axes.set_ylabel("standard error of the mean, RMSE")
    axes.set_title(f"{title}: {references['spp'].min()} samples per pixel or more")
    keep(figure, "references")

# %% [markdown]
# ## Speed-up: `scale.csv` and `simulate.csv`, `scale`

# %%
scale = table("scale.csv")
if not scale.empty:
    figure, axes = plt.subplots(figsize=(6, 4))
    axes.plot(scale["devices"], scale["devices"] / scale["base_devices"], "--", color="grey", label="ideal")
    error = scale["speedup_error"]
    axes.errorbar(scale["devices"], scale["speedup"], yerr=error, marker="o", capsize=3, label="measured")
    over = scale[scale["oversubscribed"]]
    if not over.empty:
        axes.plot(over["devices"], over["speedup"], "rx", label="more threads than cores")
    axes.set_xticks(scale["devices"])
    axes.set_xlabel("devices")
    axes.set_ylabel(f"speed-up over {scale['base_devices'].iloc[0]} device")
    axes.set_title(title)
    axes.legend()
    keep(figure, "scale")

# %%
simulated = table("simulate.csv")
if not simulated.empty:
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4))
    left.plot(simulated["devices"], simulated["predicted_ms"], "o-", label="simulated")
    left.plot(simulated["devices"], simulated["measured_ms"], "x", label="measured")
    left.set_xlabel("devices")
    left.set_ylabel("makespan, ms")
    left.set_ylim(bottom=0)
    left.legend()
    path = simulated.set_index("devices").filter(regex="^critical_.*_share$")
    path.columns = path.columns.str.removeprefix("critical_").str.removesuffix("_share")
    path.plot.bar(stacked=True, ax=right, colormap="tab20", rot=0)
    right.set_ylabel("share of the critical path")
    right.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1, 0.5))
    left.set_title(title)
    keep(figure, "simulate")

# %% [markdown]
# ## Time against error: `bench.csv`, `bench`
#
# A line per setting and eye.

# %%
bench = table("bench.csv")
if not bench.empty:
    knobs = ["denoiser", "iterations", "bounces", "foveation", "scale", "spp", "time_ms", "on_front"]
    both = bench.groupby(knobs, as_index=False)["flip"].mean()
    figure, axes = plt.subplots(figsize=(7, 5))
    for denoiser, rows in both.groupby("denoiser"):
        axes.loglog(rows["time_ms"], rows["flip"], "o", label=denoiser)
    front = both[both["on_front"]].sort_values("time_ms")
    axes.loglog(front["time_ms"], front["flip"], "k-", linewidth=0.8, label="front")
    axes.set_xlabel("time of a frame, ms")
    axes.set_ylabel("FLIP, mean of both eyes")
    axes.set_title(title)
    axes.legend()
    keep(figure, "bench")

# %% [markdown]
# ## Seams: `seams.csv`, `study seams`

# %%
seams = table("seams.csv")
if not seams.empty:
    figure, axes = plt.subplots(figsize=(6, 4))
    striped = seams[seams["seam_policy"] != "one_device"]
    striped.pivot_table(index="devices", columns="seam_policy", values="seam_over_one").plot.bar(ax=axes, rot=0)
    axes.axhline(1.0, color="grey", linewidth=0.8)
    axes.set_ylabel("RMSE near seams, over that of one device")
    axes.set_title(title)
    keep(figure, "seams")

# %% [markdown]
# ## Published experiments: `NAME.csv`, `study NAME`

# %%
for study in "leria", "leria-lightfield", "bmfr", "koskela", "andersson", "peres":
    rows = table(f"{study}.csv")
    if rows.empty:
        continue
    value, label = ("speedup", "speed-up") if "speedup" in rows else ("time_ms", "time of a frame, ms")
    labels = ["source", "conditions", "scene", "resolution", "camera", "devices"]
    rows["row"] = [" ".join(str(label) for label in row if label == label) for row in rows[labels].itertuples(index=False)]
    figure, axes = plt.subplots(figsize=(12, 7))
    rows.pivot_table(index="row", columns="arrangement", values=value, sort=False).plot.bar(ax=axes)
    axes.set_xlabel("")
    axes.set_ylabel(label)
    keep(figure, study)
