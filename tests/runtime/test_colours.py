"""Marks are told apart by everybody: by shape, or by a colour that every kind of eye keeps apart."""

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from edgemap.runtime.frames.colours import MARKS, SHAPES, USUAL, label_colour, label_mark

# Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB.
EYES = {
    "usual": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = XYZ @ np.ones(3)
APART = 25.0  # CIE 1976 colour difference; 2.3 is just noticeable side by side
MODELS = Path(__file__).parents[2] / "models"


def linear(colour):
    """sRGB `#rrggbb` to linear light, (3,)."""
    v = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def luminance(colour):
    return float(linear(colour) @ [0.2126, 0.7152, 0.0722])


def lab(light):
    f = np.cbrt(np.maximum(XYZ @ light / WHITE, 0.008856))
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one, other, eye):
    seen = [lab(np.clip(np.array(EYES[eye]) @ linear(colour), 0, 1)) for colour in (one, other)]
    return float(np.linalg.norm(seen[0] - seen[1]))


@pytest.mark.parametrize("colour", sorted({mark.colour for mark in MARKS}))
@pytest.mark.parametrize("ground", ["#ffffff", "#1b1f25"])
def test_every_mark_has_3_to_1_contrast_on_both_pages(colour, ground):
    """WCAG 2.2, 1.4.11: white paper and light cards, dark cards."""
    low, high = sorted((luminance(colour), luminance(ground)))
    assert (high + 0.05) / (low + 0.05) >= 3.0


@pytest.mark.parametrize("eye", EYES)
def test_any_two_marks_differ_by_shape_or_by_a_colour_that_this_eye_tells(eye):
    assert len(set(MARKS)) == len(MARKS) == 3 * len(SHAPES)
    for one, other in combinations(MARKS, 2):
        assert one.shape != other.shape or difference(one.colour, other.colour, eye) >= APART, (one, other)


@pytest.mark.parametrize("bundle", sorted(path.parent.name for path in MODELS.glob("*/bundle.json")))
def test_all_that_a_bundle_maps_has_a_mark_of_its_own(bundle):
    classes = json.loads((MODELS / bundle / "bundle.json").read_text())["detector"]["classes"]
    mapped = [item["name"] for item in classes if item["mapped"]]
    assert mapped
    assert len({label_mark(name) for name in mapped}) == len(mapped)


def test_the_usual_have_marks_of_their_own_and_others_share():
    assert len({label_mark(label) for label in USUAL}) == len(USUAL) <= len(MARKS)
    assert len({label_mark(label).shape for label in USUAL[: len(SHAPES)]}) == len(SHAPES)
    assert label_mark("unicorn") == label_mark("unicorn") in MARKS
    assert label_colour("unicorn") == label_mark("unicorn").colour
