"""`edgemap eval map --plot`: confidences of mapped objects against the share of them that is real."""

from pathlib import Path
from typing import Any

from edgemap.plots.style import INK, plt, save


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
