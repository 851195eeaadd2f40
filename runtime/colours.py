"""One colour per label, the same in every figure, on the live page and in reports."""

from __future__ import annotations

from zlib import crc32

# Okabe and Ito's colours, which colour-blind eyes tell apart, with two changes so that all are seen on white and on
# black: their yellow is darker, their black is left out. After them three of Paul Tol's muted scheme, and what is left
# between them.
PALETTE = (
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#b5a300", "#aa4499", "#44aa99", "#999933",
    "#c81e5a", "#7766cc", "#8a5a32", "#8a9099",
)  # fmt: skip

# What stands in most rooms has a colour of its own; other labels share by chance, and their names stand beside them.
USUAL = (
    "chair", "couch", "potted plant", "bed", "dining table", "tv", "refrigerator", "toilet", "suitcase", "bench",
    "oven", "sink", "backpack", "vase",
)  # fmt: skip


def label_colour(label: str) -> str:
    """The colour of a label as `#rrggbb`; depends on the label alone."""
    return PALETTE[USUAL.index(label) if label in USUAL else crc32(label.encode()) % len(PALETTE)]
