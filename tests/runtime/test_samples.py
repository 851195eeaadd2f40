"""Samples that are none are dropped and counted, whatever is wrong with one of them; sound ones stay to the bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusal import refused

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import collected
from edgemap.runtime.frames.stamps import followed
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.inputs.drives.sensor_csv import read_imu_csv, read_wheel_csv

RISING = st.lists(st.floats(0.001, 3600.0), min_size=6, max_size=40).map(lambda steps: list(np.cumsum(steps)))


@given(stamps=RISING)
def test_rising_stamps_are_unchanged_to_the_bit(stamps):
    assert [(stamp, fault) for stamp, _, fault in followed((s, None) for s in stamps)] == [(s, "") for s in stamps]


@given(stamps=RISING, at=st.integers(2, 100), wrong=st.floats(-1e9, 1e9))
def test_one_stamp_costs_one_sample_and_one_fault_at_most(stamps, at, wrong):
    at %= len(stamps) - 2
    bad = [*stamps[:at], wrong, *stamps[at + 1 :]]
    found = list(followed((stamp, index) for index, stamp in enumerate(bad)))
    assert sum(bool(fault) for _, _, fault in found) <= 1 or wrong > stamps[at + 1]
    kept = [stamp for stamp, _, _ in found if stamp is not None]
    assert (np.diff(kept) > 0).all()
    assert len(kept) >= len(stamps) - 2


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        ("wheel", "{0},{0},0,0", ["sensor restarted", "{0},,0,0", "{0},nan,0,0", "0,0,0,0"]),
        ("imu", "{0},0,0,0,0,-9.8,0", ["# a comment", "{0},0,0,0,inf,0,0", "{0},0,0", "-1,0,0,0,0,-9.8,0"]),
        ("tum", "{0} {0} 0 0 0 0 0 1", ["lost", "{0} 0 0 0 0 0 0 0", "nan 0 0 0 0 0 0 1"]),
    ],
)
def test_rows_that_are_none_are_dropped_and_counted(tmp_path, coding, kind, good, bad):
    read, head = {
        "wheel": (read_wheel_csv, "stamp_s,x_m,y_m,yaw_rad"),
        "imu": (read_imu_csv, "stamp_s,gx,gy,gz,ax,ay,az"),
        "tum": (trajectory_of, "# stamp x y z qx qy qz qw"),
    }[kind]
    lines = [good.format(stamp) for stamp in range(1, 21)]
    for place, line in enumerate(bad):
        lines.insert(3 * place + 3, line.format(3 * place + 2.5))
    path = tmp_path / "trajectory.tum"
    path.write_text("\n".join([head, *lines, ""]), encoding=coding)
    with collected() as notes:
        found = read(path)
    np.testing.assert_array_equal(found.stamps_s, np.arange(1.0, 21.0))
    wrong = sum(not line.startswith("#") for line in bad)
    assert sum(int(note.text.split(": ")[1].split()[0]) for note in notes) == wrong


def test_wheels_that_are_none(tmp_path):
    path = tmp_path / "wheel{0}.csv"
    for rows, words in (
        ("0,0,0,0\n0.1,1e300,0,0\n", ":3: x_m is 1e+300, must be -1e+06 to 1e+06"),
        ("0,0,0,0\n\n0.1,nan,0,0\n", ":4: x_m is nan"),
        ("0,0,0,x\n", ":2: '0 0 0 x', expected 4 finite numbers a line, stamp_s x_m y_m yaw_rad"),
        ("0,0,0,0\n0,0,0,0\n", "not after 0.000000 s"),
        ("", "no rows"),
    ):
        path.write_text("stamp_s,x_m,y_m,yaw_rad\n" + rows)
        assert words in refused(CameraError, read_wheel_csv, path)
