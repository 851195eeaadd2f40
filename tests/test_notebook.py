"""The notebook of the docs runs, and shows what it says it shows."""

from base64 import b64decode
from pathlib import Path

import cv2
import numpy as np
import pytest

NOTEBOOK = Path(__file__).parents[1] / "docs" / "notebook.ipynb"


def test_the_notebook_runs_and_shows_pictures_and_maps(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient", reason="no nbclient here (extra dev)")
    pytest.importorskip("ipykernel", reason="no kernel here (extra dev)")
    notebook = nbformat.read(NOTEBOOK, 4)
    told = [output.output_type for cell in notebook.cells for output in cell.get("outputs", [])]
    assert "execute_result" in told, "the repository's notebook shows its outputs"
    assert "error" not in told
    client.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert not [output for output in shown if output.output_type == "error"]
    data = [output.data for output in shown if output.output_type == "execute_result"]
    (picture,) = [item["image/png"] for item in data if "image/png" in item]
    image = cv2.imdecode(np.frombuffer(b64decode(picture), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (480, 640, 3)
    (drawn,) = [item["text/html"] for item in data if "text/html" in item]
    assert "suitcase-1" in drawn
    assert (tmp_path / "map.json").is_file()
