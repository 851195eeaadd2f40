"""`edgemap bench`: speed, measured."""

from pathlib import Path
from typing import Annotated, Any, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.groups import Source
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import Json, above_zero, print_json
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import print_message


def command(
    source: Annotated[Source, arg(name="Camera")],
    network: Annotated[NetworkOptions, arg(name="Network")],
    rate: Annotated[
        tuple[float, ...],
        arg(metavar="HZ…", help="Frames per second that a camera delivers; the first one's figures lead."),
    ] = (10.0, 30.0),
    seconds: Annotated[float, arg(metavar="S", help="How long to measure at each rate, in seconds.")] = 10.0,
    against: Annotated[
        Literal["openvino", "opencv"] | None,
        arg(help="Run the same backbone by another runtime as well, in turn, and give ratios ours / theirs."),
    ] = None,
    soak: Annotated[
        float | None,
        arg(metavar="MINUTES", help="Go on at the first rate for so long: memory and times by the minute."),
    ] = None,
    at_rest: Annotated[
        bool, arg(help="Measure a robot that stands as well: the first picture again and again, with a sensor's noise.")
    ] = False,
    plot: Annotated[Path | None, arg(metavar="DIR", help="Draw stages and processor time into DIR/bench.png.")] = None,
    json: Json = False,
) -> None:
    """Measure what `run` costs: latency stage by stage and processor time, paced by a camera and as fast as it goes.

    The source's frames go in order through front end and back end, its IMU and wheels with them; decoding is reported
    apart. Every frame is searched (detect_every 1); a detector beside a companion at a camera's pace as many as it can.
    Compare two builds only within one run, as a ratio, on a quiet
    machine.
    """
    import resource
    import time

    import psutil

    from edgemap.benchmarks import bench
    from edgemap.runtime.frames.camera import Camera, next_frame
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.network.engines import processor_name
    from edgemap.runtime.step.slam import SemanticSlam, build_slam

    above_zero(seconds=seconds, rate=min(rate, default=0.0), soak=soak)
    source.check()
    paced = network.load(source.camera, pace="camera")

    def open_drive(loaded: Bundle = paced, at_rest: bool = False) -> tuple[Camera, SemanticSlam]:
        camera = source.open()
        camera = bench.standing_camera(camera, rate[0]) if at_rest else camera
        return camera, build_slam(camera, loaded, source.floor_camera(camera))

    camera, slam = open_drive()
    with camera:
        first = next_frame(camera, lambda _: None)
        if first is None:
            raise CameraError(f"{source.camera}: no frames")
        slam.step(first)
        cold_start_s = time.time() - psutil.Process().create_time()
        start, decoded = (
            time.perf_counter(),
            sum(next_frame(camera, lambda _: None) is not None for _ in range(bench.CHUNK)),
        )
        decode_ms = 1e3 * (time.perf_counter() - start) / max(1, decoded)
    legs = {f"{hz:g}": bench.measure(open_drive, seconds, hz) for hz in rate}
    peak_rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    files = network.load(source.camera)
    legs["unpaced"] = bench.measure(lambda: open_drive(files), seconds)
    lead, unpaced = legs[f"{rate[0]:g}"], legs["unpaced"]
    other = max(leg["other_cpu_percent"] for leg in legs.values())
    document: dict[str, Any] = {
        "bundle": paced.manifest.name,
        "camera": source.camera,
        **{key: unpaced[key] for key in ("fps", "searched_hz", "frames", "latency_ms", "stages_ms")},
        **{key: lead[key] for key in ("cpu_ms_per_frame", "cpu_percent", "stages_cpu_ms")},
        "paced": {name: {key: leg[key] for key in PACED} for name, leg in legs.items()},
        "quiet": other <= bench.QUIET_PERCENT,
        "other_cpu_percent": other,
        "decode_ms": round(decode_ms, 3),
        "cold_start_s": round(cold_start_s, 3),
        "peak_rss_mb": round(peak_rss_mb, 1),
        "threads": files.compute.threads,
        "paced_threads": paced.compute.threads,
        "detect_every": max(1, round(unpaced["fps"] / (unpaced["searched_hz"] or unpaced["fps"]))),
        "engine": files.compute.engine,
        "provider": f"{files.compute.engine} CPU",
        "precision": files.precision,
        "odometry": "hybrid",
        "processor": processor_name(),
    }
    if against:
        from edgemap.benchmarks.rivals import compare, opencv_network, openvino_network, picture_to_boxes
        from edgemap.runtime.network.decode import Detector

        spec = files.manifest.detector
        opener = openvino_network if against == "openvino" else opencv_network
        infer, their_precision = opener(files.folder / spec.file, spec, files.compute.threads)
        probe = files.backbone.zeros()
        tensor = probe[spec.input.name]
        networks = (lambda: files.backbone.run(probe), lambda: infer(tensor))
        height, width = first.image.shape[:2]
        fitted = files.for_pictures(width, height)  # as `run` has it
        boxes = Detector(fitted), picture_to_boxes(spec, infer, files.manifest.confidence)
        ratios = compare(boxes, networks, lambda: open_drive(files), seconds)
        document["against"] = {against: ratios | {"precision": their_precision}}
    if soak is not None:
        document["soak"] = bench.soak(open_drive, soak, rate[0])
    if at_rest:
        document["at_rest"] = bench.measure_at_rest(lambda: open_drive(at_rest=True), seconds, rate[0])
    if plot is not None:
        from edgemap.plots.charts import plot_bench

        print_message(f"see it:  {plot_bench(plot / 'bench.png', document)}")
    if json:
        print_json(document)
    else:
        _print_figures(document)


PACED = ("cpu_ms_per_frame", "cpu_percent", "latency_ms", "fps", "searched_hz", "other_cpu_percent")


def _print_figures(document: dict[str, Any]) -> None:
    how = f"{document['threads']} threads, {document['precision']}, {document['processor']}"
    print(f"{document['bundle']} on {document['camera']}, {how}")
    if not document["quiet"]:
        print(f"  NOT QUIET: other programs or the host took {document['other_cpu_percent']:.0f} % of a core meanwhile")
    rates = f"{document['fps']:.1f} frames/s, {document['searched_hz']:.1f} of them searched"
    print(f"  {rates}, over {document['frames']} frames")
    print(f"  {'stage':<14} {'p50':>8} {'p95':>8} {'p99':>8} {'cpu':>8}  ms")
    for name, values in [*document["stages_ms"].items(), ("full step", document["latency_ms"])]:
        cpu_ms = document["stages_cpu_ms"].get(name, document["cpu_ms_per_frame"])
        print(f"  {name:<14} {values['p50']:8.2f} {values['p95']:8.2f} {values['p99']:8.2f} {cpu_ms:8.2f}")
    for name, leg in document["paced"].items():
        title = name if name == "unpaced" else f"at {name} Hz"
        print(
            f"  {title}: {leg['searched_hz']:.1f} pictures/s searched, {leg['cpu_ms_per_frame']:.1f} ms of processor "
            f"time a frame, {leg['cpu_percent']:.0f} % of one core, step p50 {leg['latency_ms']['p50']:.1f} ms, "
            f"p99 {leg['latency_ms']['p99']:.1f} ms"
        )
    print(f"  decoding a picture {document['decode_ms']:.2f} ms (not in the step)")
    print(f"  cold start {document['cold_start_s']:.2f} s, peak memory {document['peak_rss_mb']:.0f} MB")
    for name, ratios in document.get("against", {}).items():
        print(
            f"  ours / {name} ({ratios['precision']}): network {ratios['network_ratio']:.2f}, picture to boxes "
            f"{ratios['end_to_end_ratio']:.2f} (processor time {ratios['cpu_ratio']:.2f}), our full step "
            f"{ratios['full_ratio']:.2f}"
        )
    if rest := document.get("at_rest"):
        print(
            f"  at rest: {rest['cpu_ms_per_frame']:.1f} ms of processor time a frame, {rest['cpu_percent']:.1f} % of "
            f"one core, {rest['cpu_percent_with_decoding']:.1f} % with the decoding of a JPEG"
        )
    for minute, row in enumerate(document.get("soak", {}).get("minutes", ()), 1):
        print(f"  minute {minute}: {row['rss_mb']:.0f} MB, step p99 {row['latency_ms']['p99']:.1f} ms")
