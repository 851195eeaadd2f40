"""Ctrl-C: one line, whatever it interrupts."""

import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import edgemap.cli
from edgemap.cli.summary import with_map_so_far


def test_ctrl_c_that_a_library_turns_into_its_own_error_is_one_line(monkeypatch, capsys):
    """As extension modules do that are interrupted while they start: initialization failed."""

    def command(*_):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    monkeypatch.setattr("edgemap.cli._command", command)
    with pytest.raises(SystemExit) as ended:
        edgemap.cli.main(["cameras"])
    assert (ended.value.code, capsys.readouterr().err) == (130, "edgemap cameras: interrupted\n")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("result", "said"), [(object(), "the map so far is in runs/a/\n"), (None, "")])
def test_a_second_one_in_a_run_names_the_folder_of_its_map(capsys, result, said):
    summary: Any = SimpleNamespace(result=result)
    files: Any = SimpleNamespace(folder=Path("runs/a"))
    with pytest.raises(KeyboardInterrupt), with_map_so_far(summary, files):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == said
