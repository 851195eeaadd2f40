"""Charts of `bench --plot` and `eval map --plot`: stage times and processor load; confidences against precision."""

from pathlib import Path
from typing import Any

from edgemap.plots.style import INK, plt, save


def plot_bench(path: Path, document: dict[str, Any]) -> Path:
    """Draw the stages' medians (line: p99), processor time by rate and, where measured, the soak's memory; the path."""
    soak = document.get("soak", {}).get("minutes", [])
    figure, axes = plt.subplots(1, 3 if soak else 2, figsize=(5.0 * (3 if soak else 2), 3.6), layout="constrained")
    stages = document["stages_ms"]
    names = list(stages)[::-1]
    axes[0].barh(names, [stages[name]["p50"] for name in names], xerr=[
        [0.0] * len(names), [stages[name]["p99"] - stages[name]["p50"] for name in names]
    ])  # fmt: skip
    axes[0].set(xlabel="ms, median and p99", title=f"{document['bundle']}: step {document['latency_ms']['p50']:.1f} ms")
    legs = document["paced"]
    labels = [name if name == "unpaced" else f"{name} Hz" for name in legs]
    bars = axes[1].bar(labels, [leg["cpu_ms_per_frame"] for leg in legs.values()])
    axes[1].bar_label(bars, [f"{leg['cpu_percent']:.0f} % of a core" for leg in legs.values()])
    axes[1].set(ylabel="processor time a frame, ms", title=document["processor"])
    if soak:
        axes[2].plot(range(1, len(soak) + 1), [row["rss_mb"] for row in soak])
        axes[2].set(xlabel="minute", ylabel="resident memory, MB", ylim=(0, None))
    return save(figure, path)


def plot_reliability(path: Path, reliability: dict[str, Any]) -> Path:
    """Draw what `evaluation.objects.reliability` gives: a bar per bin with its count, and the diagonal; the path."""
    figure, axes = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
    bins, error = reliability["bins"], reliability["ece"]
    bars = axes.bar(
        [one["from"] for one in bins],
        [one["real"] / one["objects"] for one in bins],
        width=[one["to"] - one["from"] for one in bins],
        align="edge", edgecolor=INK, alpha=0.5, label="share that is real",
    )  # fmt: skip
    axes.bar_label(bars, [f"{one['real']} of {one['objects']}" for one in bins], fontsize=8)
    axes.plot([0.0, 1.0], [0.0, 1.0], color=INK, linewidth=1.0, label="as it should be")
    means = [one["mean_confidence"] for one in bins]
    axes.plot(means, [one["real"] / one["objects"] for one in bins], "o", color=INK, label="mean confidence")
    title = "no objects" if error is None else f"expected calibration error {error:.3f}"
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.1), xlabel="confidence", ylabel="real (matched within 0.5 m)", title=title)
    axes.legend(loc="upper left", fontsize=8)
    return save(figure, path)
