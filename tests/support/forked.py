"""The command line in processes forked from one that has imported its libraries: each saves a second of imports."""

import atexit
import contextlib
import gc
import importlib
import io
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from functools import cache
from pathlib import Path
from typing import NoReturn

LIBRARIES = (
    "cv2", "onnxruntime", "tyro", "threadpoolctl", "edgemap.runtime.session", "edgemap.cli.drive", "edgemap.cli.run",
    "edgemap.calibrate.first_pictures", "edgemap.runtime.network.open_bundle", "edgemap.bridges.ros2.cameras",
    "edgemap.cli.map_show", "edgemap.cli.doctor",
)  # fmt: skip
HOST_LIBRARIES = ("torch", "onnx")  # of `export` and `train`: imported before the first of them
TIMEOUT_S = 100.0


class ForkedCommands:
    """Call it with the words of a command line; `env` replaces this process's own environment."""

    def __init__(self) -> None:
        command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
        paths = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
        pipe, env = subprocess.PIPE, {**os.environ, "PYTHONPATH": paths}
        self._server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=env)

    def __call__(self, *arguments, cwd=None, env=None) -> subprocess.CompletedProcess[str]:
        """Runs it to its end; standard input is empty."""
        words = [*map(str, arguments)]
        with tempfile.TemporaryDirectory() as folder:
            files = [str(Path(folder, name)) for name in ("out", "err")]
            request = {"words": words, "cwd": str(cwd or Path.cwd()), "env": dict(env or os.environ), "files": files}
            assert self._server.stdin is not None
            assert self._server.stdout is not None
            print(json.dumps(request), file=self._server.stdin, flush=True)
            code = int(self._server.stdout.readline())
            texts = [Path(file).read_text("utf-8", "replace") for file in files]
            return subprocess.CompletedProcess(words, code, *texts)

    def ok(self, *arguments, cwd=None, env=None) -> subprocess.CompletedProcess[str]:
        """The same, of a command that must succeed."""
        done = self(*arguments, cwd=cwd, env=env)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    def close(self) -> None:
        """Ends the process that forks."""
        self._server.communicate()


def serve() -> None:
    """Forks a process for each line of standard input and writes its exit code."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    _import(LIBRARIES)
    _ask_for_help()
    gc.freeze()  # so that no child's collector writes to the memory that it shares
    while line := sys.stdin.readline():
        request = json.loads(line)
        if request["words"][:1] in (["export"], ["train"]) and len(request["words"]) > 1:
            _import(HOST_LIBRARIES)
            if request["words"][0] == "export":
                with contextlib.suppress(ImportError):
                    _prepare_export()
        child = os.fork()
        if not child:
            _become(request)
        if not select.select([os.pidfd_open(child)], [], [], TIMEOUT_S)[0]:
            os.kill(child, signal.SIGKILL)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), file=answers, flush=True)


def _ask_for_help() -> None:
    """What the first help costs, its parser and the metadata of packages, is then known to each child."""
    from edgemap.cli import main

    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main(["run", "--help"])


def _import(names: tuple[str, ...]) -> None:
    for name in names:
        with contextlib.suppress(ImportError):  # of an extra: the command itself reports it
            importlib.import_module(name)


@cache
def _prepare_export() -> None:
    """Torch's exporter loads itself with its first graph, which takes 4 s. Proofs take two steps; those of 2 x 8 are
    made by tests/export in their own process."""
    import torch

    from edgemap.export import parity

    parity.CASES, parity.STEPS = 1, 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(torch.nn.Identity(), (torch.zeros(1),), dynamo=True, verbose=False)


def _become(request: dict) -> NoReturn:
    """Runs the command, then ends without C++ destructors: that of onnxruntime waits for a thread that no fork has."""
    from edgemap.cli import main

    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["cwd"])
    for number, path in enumerate((os.devnull, *request["files"])):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT if number else os.O_RDONLY), number)
    sys.argv = ["edgemap", *request["words"]]
    code: object = 0
    try:
        main()
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code if isinstance(code, int) else int(code is not None))
