"""The networks that training starts from, for small pictures."""

from functools import cache
from pathlib import Path

import msgspec
import pytest


@pytest.fixture(scope="session")
def small():
    """A shipped bundle's network, its contract for pictures of 64 px: the same operators and weights, quick."""
    pytest.importorskip("torch")
    from edgemap import models
    from edgemap.export.detector.network import TorchNetwork, load_network

    @cache
    def load(name: str) -> TorchNetwork:
        whole = load_network(str(Path(models.__file__).parent / name))
        spec = msgspec.structs.replace(whole.detector.input, width=64, height=64)
        detector = msgspec.structs.replace(whole.detector, input=spec)
        return TorchNetwork(whole.graph.model(), msgspec.structs.replace(whole.manifest, detector=detector))

    return load


@pytest.fixture(scope="session")
def start(small):
    """`edgemap-pico` for small pictures."""
    return small("edgemap-pico")
