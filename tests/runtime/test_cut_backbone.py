"""Rows of the input that a camera's pictures do not reach are not computed, and nothing else changes."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.manifest import InputSpec
from edgemap.runtime.network.preprocess import EDGE_PX, place, rows_of
from edgemap.runtime.network.store import bundle_folder

ENGINES = ["onnxruntime", "openvino"]


@pytest.fixture(scope="module")
def pictures():
    with open_camera("demo") as camera:
        frames = [frame for _ in range(12) if (frame := camera.read()) is not None]
    return [frame.image for frame in frames[::4]]


@pytest.mark.parametrize("engine", ENGINES)
def test_boxes_are_those_of_the_whole_input(pictures, engine):
    pytest.importorskip(engine)
    whole = load_bundle(bundle_folder("edgemap-nano"), 1, engine=engine)
    cut = whole.for_pictures(640, 480)
    assert (whole.detector.input.height, cut.detector.input.height) == (416, 320)
    found = {}
    for bundle in (whole, cut):
        detector, decode = Detector(bundle), Decoder(bundle.detector, 0.3, one_name=True)
        for index, picture in enumerate(pictures):
            outputs, placement = detector.raw(picture)
            found[bundle is cut, index] = decode(outputs, placement)
    for index in range(len(pictures)):
        boxes, own_boxes = found[False, index], found[True, index]
        assert len(boxes) > 0
        assert list(own_boxes.labels) == list(boxes.labels)
        np.testing.assert_allclose(own_boxes.scores, boxes.scores, atol=0.02)
        assert np.median(np.abs(own_boxes.boxes - boxes.boxes)) < 0.5


@pytest.mark.parametrize(
    ("size", "rows"), [((640, 480), 320), ((1280, 720), 256), ((480, 640), 416), ((416, 416), 416)]
)
def test_rows_follow_the_shape_of_the_pictures(size, rows):
    bundle = load_bundle(bundle_folder("edgemap-nano"), 1).for_pictures(*size)
    assert bundle.backbone.inputs["image"] == (1, 3, rows, 416)


@pytest.mark.parametrize("name", ["yolox-nano", "edgemap-pico"])
def test_a_file_of_fixed_size_is_left_as_it_is(name):
    bundle = load_bundle(bundle_folder(name), 1)
    assert bundle.for_pictures(640, 480).backbone.inputs == bundle.backbone.inputs


@given(st.integers(40, 4000), st.integers(40, 4000), st.sampled_from(["stretch", "letterbox", "letterbox_topleft"]))
def test_a_cut_input_holds_the_whole_picture_where_it_was(width, height, resize):
    whole = InputSpec(name="image", width=416, height=416, resize=resize, colour="rgb", scale=1.0)
    first, rows = rows_of(whole, width, height, 32)
    cut = msgspec.structs.replace(whole, height=rows)
    before, after = place(whole, width, height), place(cut, width, height)
    assert (first % 32, rows % 32) == (0, 0)
    assert (after.width, after.height, after.left) == (before.width, before.height, before.left)
    assert after.top == before.top - first
    assert after.top >= 0
    assert after.top + after.height <= rows
    assert min(before.top + before.height + EDGE_PX, 416) <= first + rows  # the edge's features see the padding
