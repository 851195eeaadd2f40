"""Bundles: what is damaged is refused, variants of a network, and which bundle a source gets."""

import json
import re
from functools import partial

import msgspec
import numpy as np
import pytest
from support import painted
from support.recordings import noise, record
from support.refusal import refused

from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.frames.errors import BundleError, OdometryError
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest import BundleVariant
from edgemap.runtime.network.manifest_file import read_manifest, write_manifest
from edgemap.runtime.network.store import LENS, RENDERED, bundle_folder, default_bundle, install_folder

CHAIR = [("chair", 40.0, 30.0, 20.0, 24.0, 0.9)]


def change(folder, **fields):
    manifest = read_manifest(folder)
    write_manifest(folder, msgspec.structs.replace(manifest, **fields))


refusal = partial(refused, BundleError, load_bundle)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused_even_where_its_sum_was_made_right(tmp_path, share):
    folder = painted.write_painted(tmp_path / "b", CHAIR)
    data = (folder / "backbone.onnx").read_bytes()
    (folder / "backbone.onnx").write_bytes(data[: int(len(data) * share)])
    assert "has sha256" in refusal(folder)
    painted.resum(folder)
    assert re.search(r"not a model|no edgemap.contract", refusal(folder))


def flip(folder):
    data = bytearray((folder / "backbone.onnx").read_bytes())
    data[len(data) // 2] ^= 1
    (folder / "backbone.onnx").write_bytes(data)


def link_outside(folder):
    (folder / "backbone.onnx").rename(folder.parent / "outside.onnx")
    (folder / "backbone.onnx").symlink_to(folder.parent / "outside.onnx")


def drop_contract(folder):
    (folder / "backbone.onnx").write_bytes(painted.backbone_model(painted.head_with(CHAIR)).SerializeToString())
    painted.resum(folder)


def painted_with(**options):
    """A bundle whose network is not what its manifest says."""
    return lambda folder: painted.write_painted(folder, CHAIR, **options)


def with_floor(**changes):
    """A floor mask of two labels in cells of 4 px, of which the manifest says something else."""

    def harm(folder):
        detector = read_manifest(painted.with_floor(folder, np.ones((1, 2, 16, 16)), 4)).detector
        floor = msgspec.structs.replace(detector.floor, **changes)
        change(folder, detector=msgspec.structs.replace(detector, floor=floor))

    return harm


def with_variant(file):
    return lambda folder: change(folder, variants={"int8": BundleVariant(file=file)})


def rename_field(folder):
    path = folder / "bundle.json"
    path.write_text(path.read_text().replace('"licence"', '"license"'))


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (painted_with(outputs=("head", "surprise")), "output surprise is not in the manifest"),
        (painted_with(outputs=("other",)), "output head is missing"),
        (painted_with(metadata="{}"), "contract in its metadata differs"),
        (with_floor(stride=8), "but (1, 2, 8, 8) by its strides"),
        (with_floor(labels=("floor",)), "but (1, 1, 16, 16) by its strides"),
        (with_floor(labels=("wall", "floor")), "floor is the first"),
        (with_variant("../x.onnx"), "leaves the bundle's folder"),
        (with_variant("x.onnx"), "has no sha256"),
        (flip, "backbone.onnx has sha256"),
        (link_outside, "leaves the bundle's folder"),
        (drop_contract, "carries no edgemap.contract metadata"),
        (rename_field, "unknown field"),
        (lambda folder: change(folder, format="edgemap.bundle/99"), "format 'edgemap.bundle/99'"),
        (lambda folder: (folder / "bundle.json").write_text("{"), "not JSON"),
        (lambda folder: (folder / "bundle.json").write_text("{}"), "missing required field"),
        (lambda folder: (folder / "bundle.json").write_text('{"format": "edgemap.bundle/9"}'), "missing required"),
        (lambda folder: (folder / "bundle.json").unlink(), "no bundle.json"),
        (lambda folder: (folder / "backbone.onnx").unlink(), "file backbone.onnx is missing"),
        (lambda folder: folder.rename(folder.parent / "elsewhere"), "no such folder"),
    ],
)
def test_a_damaged_bundle_is_refused_by_what_is_wrong(tmp_path, harm, words):
    folder = painted.write_painted(tmp_path / "b", CHAIR)
    harm(folder)
    assert words in refusal(folder)


@pytest.mark.parametrize(
    ("cells", "side", "words"),
    [
        (4, {"dim_value": 64}, "output head has shape (1, 8, 4, 4), manifest says (1, 8, 2, 2)"),
        (2, {"dim_param": "N"}, "input image has shape (1, 3, 'N', 64), manifest says (1, 3, 64, 64)"),
        (2, {}, "input image has shape (1, 3, None, 64), manifest says (1, 3, 64, 64)"),
    ],
)
def test_a_model_of_another_shape_or_an_open_side_is_named(tmp_path, cells, side, words):
    folder = painted.write_painted(tmp_path / "b", CHAIR)
    model = painted.backbone_model(painted.head_with(CHAIR, cells=cells))
    dim = model.graph.input[0].type.tensor_type.shape.dim[2]
    dim.CopyFrom(type(dim)(**side))
    painted.save(folder / "backbone.onnx", model, painted.contract_metadata(read_manifest(folder).detector))
    painted.resum(folder)
    assert words in refusal(folder)


def test_an_older_bundle_with_a_flow_head_loads(tmp_path):
    folder = painted.write_painted(tmp_path / "b", CHAIR, odometry=True)
    path = folder / "bundle.json"
    document = json.loads(path.read_text())
    head = document["odometry"].pop("paper") | {"kind": "flow", "geometry": {"cells": "cells", "stride": 16}}
    path.write_text(json.dumps(document | {"odometry": {"flow": head}, "envelope": {"height_m": [0.2, 1.2]}}))
    with pytest.raises(OdometryError, match="no paper odometry; edgemap-nano has one"):
        load_bundle(folder).odometry_head("paper")


def test_the_minimum_score_that_a_bundle_states_weighs_boxes_as_without_one(tmp_path):
    folder = painted.write_painted(tmp_path / "b", CHAIR)
    change(folder, confidence=0.3, sure_confidence=0.5)
    scores = [load_bundle(folder).evidence(None, confidence).full_weight_score for confidence in (None, 0.3, 0.2, 0.6)]
    assert scores == pytest.approx([0.5, 0.5, 0.4, 0.5])


def test_a_variant_with_another_contract_is_refused(tmp_path):
    couch = [("couch", *CHAIR[0][1:])]
    folder = painted.with_int8(painted.write_painted(tmp_path / "b", CHAIR), couch, {})
    painted.save(folder / "backbone.int8.onnx", painted.backbone_model(painted.head_with(couch)), "{}")
    painted.resum(folder)
    with pytest.raises(BundleError, match=r"backbone\.int8\.onnx: the contract in its metadata differs"):
        load_bundle(folder, precision="int8")


def test_rendered_pictures_and_those_of_a_lens_get_the_bundle_that_was_trained_for_them(tmp_path):
    (tmp_path / "simulation.json").write_text("{}")
    for spec in ("demo", "sim:8000", "drive:home", f"yolo:{tmp_path}"):
        assert default_bundle(spec) == (RENDERED, f"trained for rendered pictures, as those of {spec}")
    (tmp_path / "own").mkdir()
    assert default_bundle(f"drive:{tmp_path / 'own'}")[0] == LENS
    photographs = "realsense realsense:a.db3 0 /dev/video0 drive.mp4 pictures/ kitti:a tum:a c2w:a locobot:a yolo:a"
    for spec in (*photographs.split(), "rtsp://robot/camera", "gone.mcap", "photo.jpg"):
        assert default_bundle(spec) == (LENS, f"trained for real cameras, as {spec} is")
    assert default_bundle("demo", "kitti:a") == (LENS, "trained for real cameras, as kitti:a is")  # one lens decides


@pytest.mark.parametrize(("camera", "expected"), [("demo", RENDERED), ("sim:4", RENDERED), ("realsense", LENS)])
def test_a_recording_gets_the_bundle_of_what_was_recorded(tmp_path, camera, expected):
    tape = record(tmp_path / "a.mcap", CameraInfo(camera), noise(2))
    assert default_bundle(recorded_from(f"{tape}#/camera"))[0] == expected


@pytest.mark.parametrize("name", [LENS, RENDERED])
def test_both_come_with_the_package(name, tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    manifest = read_manifest(bundle_folder(name))
    assert manifest.licence.startswith("Apache-2.0")
    assert [head.trained for head in manifest.odometry.values()] == ([True] if name == RENDERED else [])
    load_bundle(bundle_folder(name))


EMPTY = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"  # of no bytes at all


def with_sums(folder, sums):
    """A bundle whose manifest names these files as well."""
    painted.write_painted(folder, [])
    document = json.loads((folder / "bundle.json").read_text())
    document["sha256"] |= sums
    (folder / "bundle.json").write_text(json.dumps(document))
    return folder


@pytest.mark.parametrize("digest", ["/home/u/evil", "../../evil", "A" * 64, "0" * 63, "0" * 64 + "\n", ""])
def test_a_sum_that_is_a_path_never_becomes_one(tmp_path, digest):
    assert "sha256" in refused(BundleError, read_manifest, with_sums(tmp_path / "b", {"extra.bin": digest}))


@pytest.mark.parametrize("name", ["bundle.json", "a/bundle.json", "../x", "/x", "a\\b", "x\x00", "\u202ex", "."])
def test_a_name_that_leaves_the_folder_is_never_copied(tmp_path, monkeypatch, name):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    refused(BundleError, install_folder, with_sums(tmp_path / "b", {name: EMPTY}))
    assert not (tmp_path / "cache").exists()


def test_a_file_that_would_be_a_folder_too_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    folder = with_sums(tmp_path / "b", {"x": EMPTY, "x/y": EMPTY})
    (folder / "x").write_bytes(b"")
    refused(BundleError, install_folder, folder)
