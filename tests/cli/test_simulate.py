"""`edgemap simulate` and `sim:SEED` on the command line: what goes wrong is one line; a small drive is a drive."""

import sys

import pytest
from support.refusal import one_line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "--frames", "0", "-o", "x"), "--frames 0: must be 1 or more"),
        (("simulate", "--seed", "-3", "-o", "x"), "--seed -3: must be 0 or more"),
        (("simulate", "--pictures", "4", "-o", "x"), "--seeds None: expected A:B"),
        (("simulate", "--pictures", "4", "--seeds", "9:2", "-o", "x"), "--seeds '9:2': expected A:B"),
        (("simulate", "--seeds", "0:9", "--shard", "0/3", "-o", "x"), "--shard '0/3': expected I/N"),
        (("simulate", "--seeds", "0:2", "--shard", "3/3", "-o", "x"), "--shard 3/3: no home of 0:2 is left"),
        (("simulate", "--mount", "high", "-o", "x"), "--mount 'high': expected HEIGHT_M or HEIGHT_M,PITCH_DEG"),
        (("bench", "--camera", "sim:kitchen", "--bundle", "BUNDLE"), "camera 'sim:kitchen': expected sim:SEED"),
        (("eval", "map", "--camera", "sim:-1", "--bundle", "BUNDLE"), "camera 'sim:-1': expected sim:SEED"),
    ],
)
def test_what_goes_wrong_is_one_line(edgemap, painted_bundle, tmp_path, arguments, words):
    places = {"x": tmp_path / "x", "BUNDLE": painted_bundle}
    assert words in one_line(edgemap(*(places.get(word, word) for word in arguments)), 2)
    assert not (tmp_path / "x").exists()


def test_shards_share_the_homes():
    from edgemap.cli.simulate import homes_of

    parts = [homes_of("3:14", f"{part}/4") for part in range(1, 5)]
    assert list(parts[1]) == [4, 8, 12]
    assert sorted(home for part in parts for home in part) == list(homes_of("3:14", None)) == list(range(3, 14))


def test_without_the_extra_one_line_names_it(monkeypatch):
    from edgemap.runtime.frames.errors import MissingExtraError
    from edgemap.runtime.inputs.open import open_camera

    monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(MissingExtraError, match=r"^sim:3 needs moderngl: .*pip install .*\[simulation\]'$"):
        open_camera("sim:3")
