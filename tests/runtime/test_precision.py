"""The int8 variant of a backbone: its own file, checked like any other."""

import msgspec
import numpy as np
import pytest
from support import painted

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest import BundleVariant
from edgemap.runtime.network.manifest_file import read_manifest, write_manifest

CHAIR, COUCH = ("chair", 40.0, 30.0, 20.0, 24.0, 0.9), ("couch", 40.0, 30.0, 20.0, 24.0, 0.9)


def test_without_a_variant_int8_is_refused(tmp_path):
    folder = painted.write_painted(tmp_path / "b", [CHAIR])
    with pytest.raises(BundleError, match=r"^bundle painted has no int8 variant \(edgemap export --int8 makes one\)$"):
        load_bundle(folder, precision="int8")


def test_int8_runs_its_own_file(tmp_path):
    folder = painted.with_int8(painted.write_painted(tmp_path / "b", [CHAIR]), [COUCH], {})
    bundle = load_bundle(folder, precision="int8")
    found = bundle.backbone.run({"image": np.zeros((1, 3, 64, 64), np.float32)})["head"]
    np.testing.assert_array_equal(found, painted.head_with([COUCH]))


@pytest.mark.parametrize(("file", "words"), [("../x.onnx", "leaves the bundle's folder"), ("x.onnx", "has no sha256")])
def test_a_variants_file_is_checked_like_any_other(tmp_path, file, words):
    folder = painted.write_painted(tmp_path / "b", [CHAIR])
    manifest = msgspec.structs.replace(read_manifest(folder), variants={"int8": BundleVariant(file=file)})
    write_manifest(folder, manifest)
    with pytest.raises(BundleError, match=words):
        load_bundle(folder)


def test_a_variant_with_another_contract_is_refused(tmp_path):
    folder = painted.with_int8(painted.write_painted(tmp_path / "b", [CHAIR]), [COUCH], {})
    painted.save(folder / "backbone.int8.onnx", painted.backbone_model(painted.head_with([COUCH])), "{}")
    painted.resum(folder)
    with pytest.raises(BundleError, match=r"backbone\.int8\.onnx: the contract in its metadata differs"):
        load_bundle(folder, precision="int8")
