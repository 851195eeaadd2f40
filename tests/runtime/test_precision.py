"""Which backbone runs: asked for, allowed by the report, faster here."""

import msgspec
import numpy as np
import pytest
from support import painted

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network import bundle as session
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.compute import PAIRED_ROUNDS, WARM_UP, multiplies_int8, time_ratio
from edgemap.runtime.network.manifest import BundleVariant
from edgemap.runtime.network.manifest_file import read_manifest, write_manifest

CHAIR, COUCH = ("chair", 40.0, 30.0, 20.0, 24.0, 0.9), ("couch", 40.0, 30.0, 20.0, 24.0, 0.9)
GOOD, BAD = {"ap50": {"float32": 0.70, "int8": 0.69}}, {"ap50": {"float32": 0.70, "int8": 0.68}}


def test_without_a_variant_int8_is_refused_and_auto_is_float32(tmp_path):
    folder = painted.write_painted(tmp_path / "b", [CHAIR])
    with pytest.raises(BundleError, match=r"^bundle painted has no int8 variant \(edgemap export --int8 makes one\)$"):
        load_bundle(folder, precision="int8")
    assert load_bundle(folder, precision="auto").precision == "float32"


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


@pytest.mark.parametrize(
    ("measured", "ratio", "chosen"),
    [(GOOD, 0.5, "int8"), (GOOD, 0.95, "float32"), (BAD, 0.5, "float32"), ({}, 0.5, "float32")],
)
def test_auto_takes_int8_where_it_is_good_and_clearly_faster(tmp_path, monkeypatch, measured, ratio, chosen):
    folder = painted.with_int8(painted.write_painted(tmp_path / "b", [CHAIR]), [COUCH], measured)
    monkeypatch.setattr(session, "time_ratio", lambda one, other: (one(), other(), ratio)[-1])
    monkeypatch.setattr(session, "multiplies_int8", lambda: True)
    assert load_bundle(folder, precision="auto").precision == chosen
    monkeypatch.setattr(session, "multiplies_int8", lambda: False)
    assert load_bundle(folder, precision="auto").precision == "float32"


@pytest.mark.parametrize(
    ("machine", "flags", "exact"),
    [
        ("x86_64", "avx2", False),
        ("x86_64", "avx2 avx_vnni", True),
        ("AMD64", "avx512_vnni", True),
        ("aarch64", "", True),
    ],
)
def test_x86_without_vnni_does_not_add_8_bit_products_exactly(tmp_path, monkeypatch, machine, flags, exact):
    monkeypatch.setattr("platform.machine", lambda: machine)
    (tmp_path / "cpuinfo").write_text(f"model name : x\nflags : fpu {flags} mmx\n")
    assert multiplies_int8(tmp_path / "cpuinfo") is exact


def test_the_trial_compares_medians_of_runs_in_turn():
    now, order = [0.0], []

    def call(name, lasts):
        def run():
            order.append(name)
            now[0] += next(lasts)

        return run

    slow_start = [100.0] * WARM_UP
    first = call("a", iter([*slow_start, *[2.0] * (PAIRED_ROUNDS - 1), 90.0]))
    second = call("b", iter([*slow_start, *[8.0] * PAIRED_ROUNDS]))
    assert time_ratio(first, second, clock=lambda: now[0], rest_s=0.0) == 0.25
    assert order == ["a", "b"] * (WARM_UP + PAIRED_ROUNDS)
