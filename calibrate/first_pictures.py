"""A guess of lens and mount from the first pictures of a source, as `run` and `edgemap.open` make it."""

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2

from edgemap.calibrate.board import PICTURES, frames_of
from edgemap.calibrate.floor_depth import fit_floor_depth, gravity
from edgemap.calibrate.guess import guess_camera, quarter_turns
from edgemap.calibrate.stated_focal import stated_focal_px
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.robust import FEWEST
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.motion.health import HealthRule, Views
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.decode import Decoder, Detector

LIVE_S = 8.0  # of a live camera
DEPTHS = 15  # live pictures with depth are enough


def by_first_pictures(
    source: Camera,
    again: Callable[[], Camera],
    spec: str,
    bundle: Bundle,
    lens: Intrinsics | None,
    mount: Mount | None,
    height_m: float | None,
    report: Callable[[str], object] = lambda _: None,
) -> tuple[FloorCamera, CameraGuess | None, int]:
    """Lens and mount by a source's first pictures, and the number of these: the mount by the floor in their depth,
    where they have any and the lens is given; else a guess.

    again: opens a file again. spec: the source, whose file may state a focal length. lens, mount, height_m: what is
    given, which stays. report: called with lines on what is done. Raises CalibrationError where the pictures show no
    floor or an impossible mount.
    """
    frames = guessing_frames(source, again)
    measured, note = (None, "") if lens is None else mount_by_depth(frames, lens)
    if note:
        report(note)
    if lens is not None and measured is not None:
        measured = measured if height_m is None else replace(measured, height_m=height_m)
        return FloorCamera(lens, measured), None, len(frames)
    report(f"{source.info.name} does not say its {lacking_of(lens, mount, height_m)}: guessing from its first pictures")
    manifest = bundle.manifest
    detector = Detector(bundle, Decoder(manifest.detector, manifest.confidence, one_name=True))
    pictures = [frame.image for frame in frames]
    stated = None if source.info.live else stated_focal_px(user_path(spec), *source.info.size)
    guess = guess_camera(pictures, detector, lens, mount, stated, height_m)
    guess = replace(guess, quarter_turns=quarter_turns(pictures, detector))
    return FloorCamera(guess.lens, guess.mount), guess, len(frames)


def lacking_of(lens: Intrinsics | None, mount: Mount | None, height_m: float | None) -> str:
    """What is guessed, in words; empty where nothing is."""
    tilt = "mount" if height_m is None else "pitch"
    return " and ".join(name for name, value in (("lens", lens), (tilt, mount)) if value is None)


def mount_by_depth(frames: Sequence[Frame], lens: Intrinsics) -> tuple[Mount | None, str]:
    """The mount by the floor in the frames' depth, and the result in words; None where they have none, or show no
    floor."""
    depths = [frame.depth for frame in frames if frame.depth is not None]
    if not depths:
        return None, ""
    try:
        fit = fit_floor_depth(depths, lens, gravity(ImuSamples.joined([frame.imu for frame in frames])), mounted=False)
    except CalibrationError as error:
        return None, f"no mount by depth: {error}"
    mount, tilt_deg = fit.mount, [math.degrees(angle) for angle in (fit.mount.pitch_rad, fit.mount.roll_rad)]
    of = f"mount by the floor in {fit.pictures} of {fit.examined} depth pictures: {mount.height_m:.2f} m"
    return mount, f"{of}, pitch {tilt_deg[0]:.1f} deg down, roll {tilt_deg[1]:.1f} deg"


def earlier_guess(
    spec: str, camera_file: Path | None, source: Camera, floor: FloorCamera, stated: Collection[str]
) -> CameraGuess | None:
    """What lens and mount of a camera file or a recording were guessed in an earlier run, without what is stated now:
    of intrinsics, mount and height. Raises CameraError."""
    path = camera_file or (user_path(spec.partition(":")[2] or spec) / "camera.yaml" if spec else None)
    recorded = {} if camera_file else source.info.calibration
    if not recorded and (path is None or not path.is_file()):
        return None
    calibration, where = (recorded, spec) if recorded else (read_camera_yaml(path or Path()).calibration, str(path))
    return CameraGuess.of_record(calibration, floor.intrinsics, floor.mount, where, stated)


def guessing_frames(source: Camera, again: Callable[[], Camera]) -> list[Frame]:
    """Pictures spread over a live camera's first seconds, or over the first part of a file, which is opened again: of
    each view one, where that leaves enough, as a camera at rest shows nothing of how it is carried."""
    if source.info.live:
        frames = list[Frame]()
        until_s, next_s = time.monotonic() + LIVE_S, -math.inf
        for frame in frames_of(source, None, lambda: time.monotonic() > until_s):
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + LIVE_S / PICTURES
                frames.append(frame)
                if sum(one.depth is not None for one in frames) >= DEPTHS:
                    break
        return frames

    def sampled(every: int) -> Iterator[Frame]:
        with again() as opened:
            yield from (frame for frame in frames_of(opened, count) if frame.index % every == 0)

    reach = 10 * PICTURES  # first pictures of a file, among which `PICTURES` or more are used
    count = min(source.info.frame_count or reach, reach)
    every = max(1, count // PICTURES)
    frames = list(sampled(every))
    if every > 1 and len(frames) < PICTURES // 2:  # a short file that does not say its length
        every = max(1, every * len(frames) // PICTURES)
        frames = list(sampled(every))
    views = list(views_of(frames))
    if FEWEST <= len(views) < len(frames):  # as many again from what is not at rest
        return list(views_of(sampled(max(1, every * len(views) // len(frames)))))[: 2 * PICTURES]
    return frames


def views_of(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The pictures that show another view than the previous one of the result; the first one is included."""
    views = Views(HealthRule().moved)
    return (frame for frame in frames if views.is_another(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)))
