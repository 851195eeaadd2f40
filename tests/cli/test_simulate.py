"""`edgemap simulate` and `sim:SEED` on the command line: what goes wrong is one line; a small drive is a drive."""

import sys

import pytest


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
