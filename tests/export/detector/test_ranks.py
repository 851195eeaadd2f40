"""Two processes under `torchrun` take the very step that one takes with the doubled batch."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

STEP = """
import sys
from pathlib import Path
import numpy as np, torch
from edgemap.export.detector.begin import begin
from edgemap.export.detector.network import Nano
from edgemap.export.detector.store import Example
from edgemap.export.detector.train import Settings, Trainer

torch.manual_seed(0)
start = begin("none", ("chair", "couch"), 64, seed=0)
network = Nano(2, norm=False)  # batch statistics are each process's own
start = type(start)(network, start.names, 64, "none", "", ())
generator = np.random.default_rng(1)
examples = []
for number in range(8):
    x, y = generator.integers(0, 30, 2)
    boxes = np.array([[x, y, x + 24, y + 30]] * (number % 3), np.float32).reshape(-1, 4)
    picture = generator.integers(0, 255, (64, 64, 3)).astype(np.uint8)
    examples.append(Example(picture, boxes, np.zeros(len(boxes), np.int64), np.ones(len(boxes), np.float32),
                            np.zeros(len(boxes), bool)))
batch = int(sys.argv[2])
settings = Settings(size=64, batch=batch, epochs=1, threads=1, keep=0.5, mosaic=0.0, rate=1e-2, frozen=("stem",))
trainer = Trainer(start, examples, {"all": examples}, Path(sys.argv[1]), settings)
trainer.run()
if trainer.ranks.first:
    torch.save({"weights": trainer.network.state_dict(), "rows": trainer.rows}, Path(sys.argv[1]) / "seen.pt")
trainer.ranks.close()
"""


def trained(folder: Path, processes: int, batch: int) -> dict:
    folder.mkdir()
    script = folder / "step.py"
    script.write_text(STEP)
    how = [sys.executable] if processes == 1 else [
        sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(processes)
    ]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    result = subprocess.run(
        [*how, script, folder, str(batch)], capture_output=True, text=True, timeout=170, env=environment, check=False
    )
    assert result.returncode == 0, result.stderr[-2000:]
    return torch.load(folder / "seen.pt", weights_only=False)


@pytest.mark.slow
def test_two_processes_train_as_one_with_the_doubled_batch(tmp_path):
    one, two = trained(tmp_path / "one", 1, 4), trained(tmp_path / "two", 2, 2)
    for name, tensor in one["weights"].items():
        torch.testing.assert_close(two["weights"][name], tensor, rtol=1e-4, atol=1e-5)
    assert len(two["rows"]) == len(one["rows"]) == 1
    assert two["rows"][0]["pictures"] == one["rows"][0]["pictures"] == 8
