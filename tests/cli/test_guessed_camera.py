"""`run` with pictures that nobody has calibrated, as a new user types it."""

import json

from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml


def test_pictures_without_camera_yaml_are_mapped_by_a_guess(edgemap, painted_bundle, pictures, tmp_path):
    (pictures / "camera.yaml").unlink()
    out = tmp_path / "run"
    done = edgemap("run", "--camera", pictures, "--bundle", painted_bundle, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "does not say its lens and mount: guessed from 12 pictures" in done.stdout
    assert "focal length 51 +- 22 % px (usual field of view)" in done.stdout  # 0.8 of 64 px
    assert "map: good" not in done.stdout  # never of a guess
    record = json.loads((out / "run.json").read_text())
    assert record["camera_guess"]["focal_sigma_share"] == 0.22
    assert any("guessed" in reason for reason in record["verdict"]["reasons"])
    kept = read_camera_yaml(out / "camera.yaml")
    assert kept.mount is not None
    assert abs(kept.mount.height_m - record["mount"]["height_m"]) < 1e-6
    again = edgemap(
        "run", "--camera", pictures, "--bundle", painted_bundle, "--camera-file", out / "camera.yaml", "--out",
        tmp_path / "again",
    )  # fmt: skip
    assert again.returncode == 0, again.stderr
    assert "guessed" not in again.stdout


def test_what_is_given_is_not_guessed(edgemap, painted_bundle, pictures, tmp_path):
    (pictures / "camera.yaml").unlink()
    done = edgemap(
        "run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run", "--mount", "1.0,0"
    )
    assert done.returncode == 0, done.stderr
    assert "does not say its lens: guessed" in done.stdout
    mount = json.loads((tmp_path / "run" / "run.json").read_text())["mount"]
    assert (mount["height_m"], mount["pitch_deg"]) == (1.0, 0.0)


def test_a_lens_alone_leaves_the_mount_to_be_guessed(edgemap, painted_bundle, pictures, tmp_path):
    (pictures / "camera.yaml").unlink()
    run = ("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    done = edgemap(*run, "--intrinsics", "50,50,31.5,31.5")
    assert done.returncode == 0, done.stderr
    assert "does not say its mount: guessed from 12 pictures" in done.stdout
    kept = read_camera_yaml(tmp_path / "run" / "camera.yaml")
    assert (kept.intrinsics.fx, kept.intrinsics.cy) == (50.0, 31.5)
