"""`edgemap doctor`: what works here, what is missing, what to type."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import degrees
from pathlib import Path
from typing import Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.groups import Source
from edgemap.cli.guessed_camera import what_is_given
from edgemap.cli.options import BundleName, Json, print_json
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import CameraFault
from edgemap.runtime.frames.extras import EXTRAS, install_hint, pip
from edgemap.runtime.frames.reading import library_path, without_secrets

WAIT_S = 20.0  # for the first frame of a camera
TAPE = (
    "measure the height of the lens above the floor with a tape and pass it to run, in metres: --mount HEIGHT_M; "
    "edgemap calibrate measures the rest"
)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One line of the report. remedy: what to type where something is missing."""

    topic: str
    state: Literal["ok", "missing", "broken"]
    text: str
    remedy: str = ""

    def __post_init__(self) -> None:
        for name in ("text", "remedy"):
            object.__setattr__(self, name, without_secrets(getattr(self, name)))


def command(
    camera: Annotated[Source, arg(name="Camera")],
    bundle: BundleName = None,
    plot: Annotated[
        Path | None,
        arg(
            metavar="PICTURE",
            help="Write the camera's first picture with horizon and metre grid: lines must lie flat on the floor.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Check processor, libraries, camera, bundle and mount, and say what to type for what is missing.

    Exit code 1 where the run that these options describe would not start.
    """
    findings = [_processor(), *_libraries(), *_cameras(), _bundle(bundle, camera.camera), *_camera(camera, plot)]
    if json:
        print_json([asdict(finding) for finding in findings])
    else:
        signs = {"ok": "ok     ", "missing": "missing", "broken": "BROKEN "}
        for finding in _gathered(findings):
            print(f"{signs[finding.state]}  {finding.topic:<12} {finding.text}")
            if finding.remedy:
                print(f"{'':<22} -> {finding.remedy}")
    if any(finding.state == "broken" for finding in findings):
        raise SystemExit(1)


def _gathered(findings: list[Diagnosis]) -> list[Diagnosis]:
    """For reading: the extras that are not installed, of which most users need none, as one."""
    extras = [one for one in findings if one.topic == "extra" and one.state == "missing"]
    if len(extras) < 2:
        return findings
    uses = "; ".join(one.text.partition(" lacks ")[0].removeprefix("extra ") for one in extras)
    together = Diagnosis("extras", "missing", f"not installed, each for one use: {uses}", install_hint("NAME"))
    first = findings.index(extras[0])
    return [*findings[:first], together, *(one for one in findings[first:] if one not in extras)]


def _processor() -> Diagnosis:
    import os
    import platform

    import psutil

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    flags = ""
    if Path("/proc/cpuinfo").is_file():
        words = set(Path("/proc/cpuinfo").read_text().split())
        wanted = ("avx2", "avx512f", "avx512_vnni", "avx_vnni", "amx_int8", "asimd", "asimddp")
        flags = ", " + " ".join(word for word in wanted if word in words)
    memory_gb = psutil.virtual_memory().total / 1e9
    text = f"{platform.machine()}, {usable} cores usable, {memory_gb:.1f} GB memory{flags}"
    return Diagnosis("processor", "ok", text)


def _libraries() -> Iterator[Diagnosis]:
    from importlib.metadata import PackageNotFoundError, version
    from importlib.util import find_spec

    base = ("numpy", "scipy", "opencv-python-headless", "onnxruntime")
    yield Diagnosis("libraries", "ok", ", ".join(f"{name} {version(name)}" for name in base))
    with suppress(PackageNotFoundError):
        text = f"the package edgemap {version('edgemap')}, another project's, has the same import name"
        yield Diagnosis("libraries", "broken", text, f"{pip()} uninstall edgemap, then install edgemap-robot again")
    for extra, (purpose, modules) in EXTRAS.items():
        lacking = [package for module, package in modules.items() if find_spec(module) is None]
        if lacking:
            text = f"extra {extra} ({purpose}) lacks {', '.join(lacking)}"
            yield Diagnosis("extra", "missing", text, install_hint(extra))
            continue
        try:
            text = f"{extra} ({purpose}): " + ", ".join(f"{name} {version(name)}" for name in modules.values())
        except PackageNotFoundError:
            text = f"{extra} ({purpose})"
        yield Diagnosis("extra", "ok", text)


def _cameras() -> Iterator[Diagnosis]:
    from edgemap.cli.cameras import command_line
    from edgemap.runtime.inputs.cameras.connected import connected_cameras

    cameras, notes = connected_cameras()
    for note in notes:
        yield Diagnosis("cameras", "missing", note)
    if not cameras:
        yield Diagnosis("cameras", "missing", "no camera is plugged in")
    for camera in cameras:
        yield Diagnosis(
            "cameras", "missing" if camera.problem else "ok", camera.problem or camera.name, command_line(camera)
        )


def _bundle(name: str | None, camera: str) -> Diagnosis:
    from edgemap.cli.export import variant_line
    from edgemap.runtime.inputs.cameras.kinds import recorded_from
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder, default_bundle

    choice = ""
    if name is None:
        name, reason = default_bundle(recorded_from(camera))
        choice = f"; {reason}"
    try:
        folder = bundle_folder(name)
        if not folder.exists():
            from edgemap.cli.pull import KNOWN

            if name in KNOWN:
                return Diagnosis("bundle", "missing", f"{name} is not in the cache", f"edgemap pull {name}")
            return Diagnosis(
                "bundle", "broken", f"{name} is neither a bundle folder nor a known model", "edgemap pull --help"
            )
        loaded = load_bundle(folder)
        for precision in loaded.manifest.variants:
            load_bundle(folder, precision=precision)
    except EdgemapError as error:
        return Diagnosis("bundle", "broken", str(error), f"edgemap pull {name}")
    detector = loaded.manifest.detector
    heads = [
        f"{kind} ({'trained' if head.trained else 'untrained'})" for kind, head in loaded.manifest.odometry.items()
    ]
    variants = [f"{variant_line(name, item.measured)}; " for name, item in loaded.manifest.variants.items()]
    return Diagnosis(
        "bundle",
        "ok",
        f"{loaded.manifest.name}: {detector.input.width}x{detector.input.height}, {len(loaded.names)} classes, "
        f"odometry: {', '.join(heads) or 'none of its own'}; {''.join(variants)}sums and contract hold{choice}",
    )


def _camera(described: Source, plot: Path | None) -> Iterator[Diagnosis]:
    from time import monotonic

    from edgemap.runtime.frames.camera import next_frame

    faults: list[CameraFault] = []
    spec, topic = described.camera, "camera"
    try:
        with described.open() as source:
            until_s = monotonic() + WAIT_S
            frame = next_frame(source, faults.append, lambda: monotonic() > until_s)
            if frame is None:
                yield Diagnosis("camera", "broken", f"{spec}: no frames within {WAIT_S:.0f} s")
                return
            for fault in faults:
                yield Diagnosis("camera", "broken", str(fault))
            rate = f"{source.info.rate_hz:.1f} Hz" if source.info.rate_hz else "rate unknown"
            width, height = source.info.size
            yield Diagnosis("camera", "ok", f"{spec}: {width}x{height}, {rate}")
            for found in (*source.info.notes, *map(str, source.info.faults)):
                yield Diagnosis("camera", "ok", found)
            topic = "mount"
            if lacking := what_is_given(described, source)[3]:
                text = f"{spec} does not say its {lacking}: run guesses from the pictures"
                yield Diagnosis("mount", "missing", text, TAPE)
                return
            floor = described.floor_camera(source)
    except EdgemapError as error:
        yield Diagnosis(topic, "broken", str(error))
        return
    placed, row = floor.mount, floor.horizon_row()
    nearest = floor.floor_points([(floor.intrinsics.cx, floor.intrinsics.height - 1.0)])[0, 0]
    yield Diagnosis(
        "mount",
        "ok",
        f"lens {placed.height_m:.3f} m above the floor, {degrees(placed.pitch_rad):.1f} deg down; horizon at row "
        f"{row:.0f} of {floor.intrinsics.height}, nearest floor {nearest:.2f} m ahead",
        "" if plot else "edgemap doctor --plot mount.png  draws the metre grid: check it against the floor by eye",
    )
    if plot:
        import cv2

        from edgemap.runtime.step.overlay import draw_floor_grid

        written = cv2.imwrite(library_path(plot), draw_floor_grid(frame.image, floor))
        state = "ok" if written else "broken"
        yield Diagnosis("mount", state, f"grid drawn in {plot}" if written else f"{plot} cannot be written")
