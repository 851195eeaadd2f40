"""Two processes with torchrun's variables take the very step that one takes with the doubled batch."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from edgemap import models  # noqa: E402
from edgemap.export.detector.network import TorchNetwork, load_network  # noqa: E402
from edgemap.export.detector.store import Example  # noqa: E402
from edgemap.export.detector.train import Trainer  # noqa: E402
from edgemap.export.settings import DetectorSettings  # noqa: E402

PICO = Path(models.__file__).parent / "edgemap-pico"


def step(folder: Path, batch: int) -> tuple[dict, list]:
    """One pass over eight pictures: how far each weight moved, and the row of its validation."""
    whole = load_network(str(PICO))
    spec = msgspec.structs.replace(whole.detector.input, width=64, height=64)
    detector = msgspec.structs.replace(whole.detector, input=spec)
    start = TorchNetwork(whole.graph.model(), msgspec.structs.replace(whole.manifest, detector=detector))
    known = start.copy()
    for parameter in known.parameters():
        parameter.data.mul_(1.02)
    generator, examples = np.random.default_rng(1), []
    labelled = np.array([name == "chair" for name in start.names])
    for number in range(8):
        x, y = generator.integers(0, 30, 2)
        count = number % 3
        labels = np.full(count, start.names.index("chair"))
        boxes = np.array([[x, y, x + 24, y + 30]] * count, np.float32).reshape(-1, 4)
        picture = generator.integers(0, 255, (64, 64, 3)).astype(np.uint8)
        examples.append(
            Example(
                picture, boxes, labels, np.ones(count, np.float32), np.zeros(count, bool),
                complete=labelled & (count > 0), kept=~labelled | (count == 0),
            )
        )  # fmt: skip
    settings = DetectorSettings(batch=batch, epochs=1, threads=1, keep=0.5, mosaic=0.0, rate=1e-3)
    trainer = Trainer(start, examples, {"all": examples[1:2]}, folder, settings, known)
    trainer.optimizer = torch.optim.SGD(trainer.learning, lr=1e-3)  # AdamW makes much of the smallest roundings
    trainer.run()
    before, after = start.state_dict(), trainer.network.state_dict()
    if trainer.ranks.count > 1:
        torch.distributed.destroy_process_group()
    return {name: after[name] - tensor for name, tensor in before.items()}, trainer.rows


def test_two_processes_train_as_one_with_the_doubled_batch(tmp_path, monkeypatch):
    one, rows = step(tmp_path / "one", 4)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    shared = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "OMP_NUM_THREADS": "1"}
    second = subprocess.Popen(
        [sys.executable, __file__, tmp_path / "two", "2"],
        env=os.environ | shared | {"RANK": "1"}, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    for name, value in (shared | {"RANK": "0"}).items():
        monkeypatch.setenv(name, value)
    two, rows_of_two = step(tmp_path / "two", 2)
    _, errors = second.communicate(timeout=100)
    assert second.returncode == 0, errors[-2000:]
    for name, tensor in one.items():
        rounding = 2e-6 + 0.01 * float(tensor.abs().max())
        torch.testing.assert_close(two[name], tensor, rtol=0.01, atol=rounding)
    assert max(float(tensor.abs().max()) for tensor in one.values()) > 1e-4
    assert len(rows_of_two) == len(rows) == 1
    assert rows_of_two[0]["pictures"] == rows[0]["pictures"] == 8


if __name__ == "__main__":
    step(Path(sys.argv[1]), int(sys.argv[2]))
