"""Ctrl-C in the middle of an import: the module loads to its end, then the command does."""

import importlib
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from edgemap.cli.interrupt import interrupts_after_imports
from edgemap.cli.summary import with_map_so_far

LOADING = """import os, signal, time
for _ in range({times}):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)
"""


@pytest.fixture
def interrupted_module(tmp_path, monkeypatch):
    """interrupted_module(times) -> the name of a module that is interrupted so often while it loads."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(times):
        (tmp_path / f"interrupted_{times}.py").write_text(LOADING.format(times=times))
        return f"interrupted_{times}"

    return write


def test_the_module_loads_to_its_end_first(interrupted_module):
    name, reached = interrupted_module(1), []
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():  # noqa: PT012
        importlib.import_module(name)
        reached.append(name)
        time.sleep(60)
    assert reached == [name]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_second_one_does_not_wait(interrupted_module):
    name = interrupted_module(2)
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        importlib.import_module(name)
    assert name not in sys.modules


def test_between_imports_it_is_raised_at_once():
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        signal.raise_signal(signal.SIGINT)


def test_who_gave_ctrl_c_another_meaning_keeps_it():
    calls = []
    before = signal.signal(signal.SIGINT, lambda *_: calls.append(1))
    try:
        with interrupts_after_imports():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert calls == [1]


@pytest.mark.parametrize(("result", "said"), [(object(), "the map so far is in runs/a/\n"), (None, "")])
def test_a_second_one_in_a_run_names_the_folder_of_its_map(capsys, result, said):
    summary: Any = SimpleNamespace(result=result)
    files: Any = SimpleNamespace(folder=Path("runs/a"))
    with pytest.raises(KeyboardInterrupt), with_map_so_far(summary, files):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == said
