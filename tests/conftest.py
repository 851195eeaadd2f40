"""What several rooms' tests share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real weights and pictures, $EDGEMAP_SHARED/data; the test skips where it is absent."""
    root = Path(os.environ.get("EDGEMAP_SHARED", Path(__file__).parents[2] / "shared"))
    if not (root / "data").is_dir():
        pytest.skip(f"real data not here: no folder {root / 'data'} (set EDGEMAP_SHARED)")
    return root / "data"
