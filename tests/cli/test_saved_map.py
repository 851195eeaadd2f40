"""`run --map SAVED` as a user calls it; the painted bundle sees one chair 5 m ahead, always."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.rooms import mapped

from edgemap.runtime.step.map_file import load_map, save_map


@pytest.fixture
def saved(tmp_path):
    chair, table = mapped([("chair", 7.2, 0.0), ("dining table", 0.0, 4.0)])
    save_map(tmp_path / "saved.json", [replace(chair, id="chair-5"), table])
    return tmp_path / "saved.json"


def run(edgemap, bundle, pictures, out, *arguments):
    return edgemap("run", "--camera", pictures, "--bundle", bundle, "--out", out, *arguments)


def test_a_run_goes_on_with_a_saved_map(edgemap, painted_bundle, pictures, saved, tmp_path):
    done = run(edgemap, painted_bundle, pictures, tmp_path / "run", "--map", saved, "--start", "2,0,0")
    assert done.returncode == 0, done.stderr
    before, after = load_map(saved), load_map(tmp_path / "run")
    assert [item.id for item in after] == ["chair-5", "dining table-1"]  # 2 m + 5 m + half a chair: the saved one
    assert (after[0].count, after[1].count) == (before[0].count + 12, before[1].count)
    assert after[1].position_m == pytest.approx(before[1].position_m)
    first = (tmp_path / "run" / "trajectory.tum").read_text().split()
    assert [float(value) for value in first[1:3]] == [2.0, 0.0]
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (record["map"], record["start"]) == (str(saved), "2,0,0")


@pytest.mark.parametrize(("misses", "stays"), [(5, False), (1000000, True)])
def test_a_chair_that_is_gone_leaves_the_map(edgemap, painted_bundle, pictures, tmp_path, misses, stays):
    # Saved 3 m ahead and seen from here before; the detector sees only the chair 5 m ahead. Ten looks from two places.
    for index in range(80):  # of noise, which shows no tilt
        noise = np.random.default_rng(index).integers(0, 255, (64, 64, 3), dtype=np.uint8)
        cv2.imwrite(str(pictures / f"{index}.png"), noise)
    places = ((index / 10, 0.1 if index // 7 % 2 else -0.1) for index in range(80))
    (tmp_path / "poses.tum").write_text("".join(f"{stamp:.1f} 0 {y} 0 0 0 0 1\n" for stamp, y in places))
    chair, other = mapped([("chair", 3.0, 0.8), ("chair", 5.25, 0.0)])
    objects = [replace(item, seen_from_m=((0.25, 0.25), (-1.75, 0.25))) for item in (chair, other)]
    save_map(tmp_path / "saved.json", objects)
    saved, out = tmp_path / "saved.json", tmp_path / "run"
    driven = "--odometry", tmp_path / "poses.tum", "--start", "0,0,0", "--config", tmp_path / "c.yaml"
    (tmp_path / "c.yaml").write_text(f"config: {{forgetting: {{misses: {misses}}}}}")
    done = run(edgemap, painted_bundle, pictures, out, "--map", saved, *driven)
    assert done.returncode == 0, done.stderr
    assert [item.id for item in load_map(out)] == (["chair-1", "chair-2"] if stays else ["chair-2"])


def test_a_place_that_is_not_found_is_said(edgemap, painted_bundle, pictures, saved, tmp_path):
    done = run(edgemap, painted_bundle, pictures, tmp_path / "run", "--map", saved)
    assert done.returncode == 0, done.stderr
    assert "not found in" in done.stdout
    assert "share 1 objects by label" in done.stdout
    assert [item.id for item in load_map(tmp_path / "run")] == ["chair-6"]  # never an id that the saved map has
