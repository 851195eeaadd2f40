"""Whatever is typed as an option's text is taken, or refused in one line."""

from contextlib import suppress
from importlib import import_module

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network import store

cli = {name: import_module(f"edgemap.cli.{name}") for name in ("camera_options", "calibrate_options", "map_show")}
READERS = {
    "--mount": ("0.6,11.5", cli["camera_options"].read_mount),
    "--intrinsics": ("587,587,319.5,239.5", lambda text: cli["camera_options"].read_intrinsics(text, 640, 480)),
    "--board": ("9x6", cli["calibrate_options"].read_board),
    "--near": ("1,2", lambda text: cli["map_show"].answers_to([], None, text, None, None)),
    "--inside": ("0,0;1,0;1,1", lambda text: cli["map_show"].answers_to([], None, None, text, None)),
    "--bundle": ("edgemap-nano", store.bundle_folder),
    "--data": ("kitti:/nowhere", open_drive),
    "--camera": ("demo", lambda text: open_camera(text).close()),
}
PIECES = (
    "kitti:", "tum:", "drive:", "sim:", ".", "..", "/", "/dev/null", "/proc/self/mem", "~nobody-here", ".mcap",
    "#/topic", ":", "//", "9" * 30, "١", "²", "%d", "%03d.png", "a" * 5000, "\udcff", "\n", "\x1b[2J", "\0", " ", "-",
    "nan", "inf", "1e400", ",",
)  # fmt: skip


@pytest.mark.parametrize("option", sorted(READERS))
@settings(max_examples=40)
@given(st.lists(st.sampled_from(PIECES) | st.text(max_size=3), max_size=3), st.integers(0, 20))
def test_any_text_is_taken_or_refused(option, parts, at):
    valid, read = READERS[option]
    with suppress(EdgemapError, OSError):  # what the command line prints as one line
        read(valid[:at] + "".join(parts) + valid[at:] if at < len(valid) else "".join(parts))
