"""Two processes under `torchrun` take the very step that one takes with the doubled batch."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from edgemap import models  # noqa: E402

MODELS = Path(models.__file__).parent

STEP = """
import sys
from pathlib import Path
import msgspec, numpy as np, torch
from edgemap.export.detector.network import TorchNetwork, load_network
from edgemap.export.detector.store import Example
from edgemap.export.detector.train import DetectorSettings, Trainer

whole = load_network(sys.argv[3])
spec = msgspec.structs.replace(whole.detector.input, width=64, height=64)
detector = msgspec.structs.replace(whole.detector, input=spec)
start = TorchNetwork(whole.graph.model(), msgspec.structs.replace(whole.manifest, detector=detector))
known = start.copy()
for parameter in known.parameters():
    parameter.data.mul_(1.02)
generator = np.random.default_rng(1)
told = np.array([name == "chair" for name in start.names])
examples = []
for number in range(8):
    x, y = generator.integers(0, 30, 2)
    count = number % 3
    labels = np.full(count, start.names.index('chair'))
    boxes = np.array([[x, y, x + 24, y + 30]] * count, np.float32).reshape(-1, 4)
    picture = generator.integers(0, 255, (64, 64, 3)).astype(np.uint8)
    examples.append(Example(picture, boxes, labels, np.ones(count, np.float32), np.zeros(count, bool),
                            complete=told & (count > 0), kept=~told | (count == 0)))
batch = int(sys.argv[2])
settings = DetectorSettings(batch=batch, epochs=1, threads=1, keep=0.5, mosaic=0.0, rate=1e-3)
trainer = Trainer(start, examples, {"all": examples}, Path(sys.argv[1]), settings, known)
trainer.optimizer = torch.optim.SGD(trainer.learning, lr=1e-3)  # AdamW makes much of the smallest gradients' rounding
trainer.run()
if trainer.ranks.first:
    before, after = start.state_dict(), trainer.network.state_dict()
    change = {name: after[name] - tensor for name, tensor in before.items()}
    torch.save({"change": change, "rows": trainer.rows}, Path(sys.argv[1]) / "seen.pt")
trainer.ranks.close()
"""


def trained(folder: Path, processes: int, batch: int, name: str) -> dict:
    folder.mkdir()
    script = folder / "step.py"
    script.write_text(STEP)
    how = [sys.executable] if processes == 1 else [
        sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(processes)
    ]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    result = subprocess.run(
        [*how, script, folder, str(batch), MODELS / name],
        capture_output=True,
        text=True,
        timeout=170,
        env=environment,
        check=False,
    )
    assert result.returncode == 0, result.stderr[-2000:]
    return torch.load(folder / "seen.pt", weights_only=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["edgemap-pico", "edgemap-nano"])
def test_two_processes_train_as_one_with_the_doubled_batch(tmp_path, name):
    one, two = trained(tmp_path / "one", 1, 4, name), trained(tmp_path / "two", 2, 2, name)
    for name, tensor in one["change"].items():
        rounding = 2e-6 + 0.01 * float(tensor.abs().max())
        torch.testing.assert_close(two["change"][name], tensor, rtol=0.01, atol=rounding)
    assert max(float(tensor.abs().max()) for tensor in one["change"].values()) > 1e-4
    assert len(two["rows"]) == len(one["rows"]) == 1
    assert two["rows"][0]["pictures"] == one["rows"][0]["pictures"] == 8
