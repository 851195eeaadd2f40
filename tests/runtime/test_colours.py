from itertools import combinations

import numpy as np
import pytest

from edgemap.runtime.colours import PALETTE, USUAL, label_colour


def linear(colour):
    """sRGB `#rrggbb` to linear light, (3,)."""
    v = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def luminance(colour):
    return float(linear(colour) @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("colour", PALETTE)
def test_colours_are_seen_on_white_and_on_dark(colour):
    """WCAG contrast of at least 2 against white paper and against the dark page's ground."""
    dark = luminance("#14171b")
    assert 1.05 / (luminance(colour) + 0.05) >= 2.0
    assert (luminance(colour) + 0.05) / (dark + 0.05) >= 2.5


def test_usual_labels_have_colours_of_their_own():
    assert len({label_colour(label) for label in USUAL}) == len(USUAL) == len(PALETTE)
    assert label_colour("unicorn") == label_colour("unicorn") in PALETTE


def test_the_commonest_labels_differ_for_deuteranopes():
    """Vienot 1999: long and middle cones see the same; the first six stay apart in what is left."""
    to_lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
    blind = np.array([[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]])
    seen = [
        np.clip(np.linalg.solve(to_lms, blind @ to_lms @ linear(colour)), 0, 1) ** (1 / 2.2) for colour in PALETTE[:6]
    ]
    assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) > 0.1
