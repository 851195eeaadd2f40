"""`edgemap bench`: speed, measured."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import tyro

from edgemap.cli.errors import OptionError
from edgemap.cli.options import (
    BundleName,
    CameraFile,
    CameraSpec,
    IntrinsicsText,
    Json,
    MountText,
    PrecisionName,
    Threads,
    find_bundle,
    lens_and_mount,
    open_described,
)


def command(
    bundle: BundleName = None,
    camera: CameraSpec = "demo",
    seconds: Annotated[float, tyro.conf.arg(metavar="S", help="How long to measure, in seconds.")] = 10.0,
    threads: Threads = None,
    precision: PrecisionName = "float32",
    against: Annotated[
        Literal["openvino", "opencv"] | None,
        tyro.conf.arg(help="Run the same backbone by another runtime as well, in turn, and give ratios ours / theirs."),
    ] = None,
    mount: MountText = None,
    intrinsics: IntrinsicsText = None,
    camera_file: CameraFile = None,
    json: Json = False,
) -> None:
    """Measure frames per second and latency of the whole step, stage by stage.

    Up to 64 decoded frames are cycled forwards and backwards; decoding is reported apart. Every frame is detected
    (detect_every 1). Times in milliseconds; compare two builds only within one run, as a ratio.
    """
    import time

    import psutil

    from edgemap.benchmarks.bench import compare, measure, read_ring
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.cameras.reading import next_frame
    from edgemap.runtime.detector import Detector
    from edgemap.runtime.errors import CameraError
    from edgemap.runtime.mapper import Mapper
    from edgemap.runtime.odometry import open_odometry
    from edgemap.runtime.pipeline import Pipeline
    from edgemap.runtime.processor import processor_name
    from edgemap.runtime.slam import SemanticSlam

    if not 0.0 < seconds < 1e6:
        raise OptionError(f"--seconds {seconds}: must be a positive number")
    loaded = find_bundle(bundle, threads, precision, camera)
    with open_described(camera, camera_file) as source:
        floor = FloorCamera(*lens_and_mount(source, intrinsics, mount))

        def new_slam() -> SemanticSlam:
            # The ring's stamps are its own: no wheels.
            odometry = open_odometry("hybrid", loaded, source, floor, wheels=False)
            return SemanticSlam(Pipeline(loaded, floor, odometry), Mapper())

        pipeline = new_slam()
        first = next_frame(source, lambda _: None)
        if first is None:
            raise CameraError(f"{camera}: no frames")
        pipeline.step(first)
        cold_start_s = time.time() - psutil.Process().create_time()
        ring = read_ring(source, first)
    figures = measure(new_slam(), ring, seconds)
    document: dict[str, Any] = {
        "bundle": loaded.manifest.name,
        "camera": camera,
        **figures,
        "cold_start_s": round(cold_start_s, 3),
        "threads": loaded.compute.threads,
        "detect_every": 1,
        "provider": "onnxruntime CPUExecutionProvider",
        "precision": loaded.precision,
        "odometry": "hybrid",
        "processor": processor_name(),
    }
    if against:
        from edgemap.benchmarks.rivals import opencv_network, openvino_network, picture_to_boxes

        opener = openvino_network if against == "openvino" else opencv_network
        infer, their_precision = opener(loaded, loaded.compute.threads)
        spec = loaded.manifest.detector
        tensor = _probe(spec.input.height, spec.input.width)
        ratios = compare(
            Detector(loaded),
            new_slam().step,
            picture_to_boxes(spec, infer, 0.3),
            (lambda: loaded.backbone.run({spec.input.name: tensor}), lambda: infer(tensor)),
            ring,
            seconds,
        )
        document["against"] = {against: ratios | {"precision": their_precision}}
    if json:
        import json as json_module

        print(json_module.dumps(document, indent=1))
    else:
        _tell(document)


def _probe(height: int, width: int):
    import numpy as np

    return np.random.default_rng(0).uniform(0, 255, (1, 3, height, width)).astype(np.float32)


def _tell(document: dict[str, Any]) -> None:
    latency = document["latency_ms"]
    how = f"{document['threads']} threads, {document['precision']}, {document['processor']}"
    print(f"{document['bundle']} on {document['camera']}, {how}")
    print(f"  {document['fps']:.1f} frames/s over {document['frames']} frames, every frame detected")
    print(f"  {'stage':<12} {'p50':>8} {'p95':>8} {'p99':>8}  ms")
    rows = [*document["stages_ms"].items(), ("whole step", latency)]
    for name, values in rows:
        print(f"  {name:<12} {values['p50']:8.2f} {values['p95']:8.2f} {values['p99']:8.2f}")
    print(f"  decoding a picture {document['decode_ms']:.2f} ms (not in the step)")
    print(
        f"  cold start {document['cold_start_s']:.2f} s, peak memory {document['peak_rss_mb']:.0f} MB, "
        f"cpu {document['cpu_percent']:.0f} %"
    )
    for name, ratios in document.get("against", {}).items():
        print(f"  ours / {name} ({ratios['precision']}): network {ratios['network_ratio']:.2f}, ", end="")
        print(f"picture to boxes {ratios['end_to_end_ratio']:.2f}, our whole step {ratios['full_ratio']:.2f}")
