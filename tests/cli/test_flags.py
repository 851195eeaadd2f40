"""The flags of `edgemap run`, as its parser prints them."""

import re

import pytest

from edgemap.cli import main

LIMIT = 34
CONTRACT = """camera bundle rate rotate pose-frame
odometry without-wheels without-imu mount intrinsics camera-file config config-options
classes confidence clustering no-loop-closure out frames realtime map view record engine ros2 foxglove mqtt threads
precision"""


def test_run_has_few_flags_and_those_of_the_contract(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    flags = set(re.findall(r"^. (?:-\w [A-Z]+, )?--(\w[\w-]*)", capsys.readouterr().out, re.MULTILINE)) - {"help"}
    print(f"edgemap run: {len(flags)} flags: {', '.join(sorted(flags))}")
    assert set(CONTRACT.split()) <= flags
    assert len(flags) <= LIMIT
