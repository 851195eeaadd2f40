"""`edgemap bench --plot`: where the step's time goes, and what of a core a paced camera takes."""

from pathlib import Path
from typing import Any

from edgemap.plots.style import plt, save


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
