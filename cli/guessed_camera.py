"""`edgemap run` with an uncalibrated camera: intrinsics and mount are estimated from its first pictures."""

import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from edgemap.runtime.frames.reading import without_secrets

if TYPE_CHECKING:
    from collections.abc import Iterator

    from edgemap.calibrate.guess import Focal
    from edgemap.cli.groups import Source
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import HeightEstimate, Mount
    from edgemap.geometry.odometry.rolling import Rolling
    from edgemap.runtime.frames.camera import Camera, CameraOptions
    from edgemap.runtime.frames.frame import Frame
    from edgemap.runtime.motion.camera_guess import CameraGuess
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.step.frame_observations import FrameObservations

PICTURES, REACH = 40, 400  # pictures that are looked at, or more, of so many first ones of a file
SURE_AXLE_M = 0.03  # standard deviation; it is below after half a turn
LIVE_S, LIVE_EVERY_S = 8.0, 0.2  # of a live camera, and between two pictures
DEPTHS = 15  # live pictures with depth are enough


def floor_camera_of(
    camera: "Source", source: "Camera", bundle: "Bundle", how: "CameraOptions | None" = None
) -> "tuple[FloorCamera, CameraGuess | None]":
    """Intrinsics and mount as given; a missing mount by the floor in depth pictures, where there are any; else guessed,
    and printed with its uncertainty. The guess of an earlier run, in the camera file, is one still.

    Raises UsageError, or CalibrationError where the pictures show no floor or an impossible mount.
    """
    from edgemap.calibrate.guess import guess_camera
    from edgemap.calibrate.guess_upright import quarter_turns
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.network.decode import Decoder, Detector

    lens, mount, height_m, lacking = what_is_given(camera, source)
    if not lacking:
        return (floor := camera.floor_camera(source)), _earlier_guess(camera, source, floor)
    frames = guessing_frames(camera, source, how)
    if lens is not None and (measured := _by_depth(frames, lens)):
        return FloorCamera(lens, measured if height_m is None else replace(measured, height_m=height_m)), None
    print(f"{source.info.name} does not say its {lacking}: guessing from its first pictures", flush=True)
    manifest = bundle.manifest
    detector = Detector(bundle, Decoder(manifest.detector, manifest.confidence, one_name=True))
    pictures = [frame.image for frame in frames]
    guess = guess_camera(pictures, detector, lens, mount, _stated(camera.camera, source), height_m)
    guess = replace(guess, quarter_turns=quarter_turns(pictures, detector))
    print(f"guessed from {len(pictures)} pictures:")
    print("\n".join(f"  {line}" for line in guess.lines()))
    if guess.height_sigma and guess.sway_rad:
        print("  the height is the scale of the map; a tape, from floor to lens as you carry it: --mount HEIGHT_M")
    elif guess.height_sigma:
        print("  the drive corrects the height by sizes of objects; a tape, floor to lens, is exact: --mount HEIGHT_M")
    print("  edgemap calibrate measures all of it without guessing", flush=True)
    return FloorCamera(guess.lens, guess.mount), guess


def _by_depth(frames: "list[Frame]", lens: "Intrinsics") -> "Mount | None":
    """The mount by the floor in the frames' depth; None where they have none, or show no floor, which is printed."""
    from edgemap.calibrate.floor_depth import fit_floor_depth
    from edgemap.calibrate.gravity import gravity
    from edgemap.geometry.camera.imu import ImuSamples
    from edgemap.runtime.frames.errors import CalibrationError

    depths = [frame.depth for frame in frames if frame.depth is not None]
    if not depths:
        return None
    try:
        fit = fit_floor_depth(depths, lens, gravity(ImuSamples.joined([frame.imu for frame in frames])), mounted=False)
    except CalibrationError as error:
        print(f"no mount by depth: {error}", flush=True)
        return None
    mount = fit.mount
    print(
        f"mount by the floor in {fit.pictures} of {fit.examined} depth pictures: {mount.height_m:.2f} m, pitch "
        f"{math.degrees(mount.pitch_rad):.1f} deg down, roll {math.degrees(mount.roll_rad):.1f} deg",
        flush=True,
    )
    return mount


def what_is_given(camera: "Source", source: "Camera") -> "tuple[Intrinsics | None, Mount | None, float | None, str]":
    """Lens and mount as given, None for what a run guesses; the height, where it alone is given; and in words what is
    guessed, empty where nothing is. Raises UsageError."""
    from edgemap.cli.camera_options import read_intrinsics, read_mount, read_mount_numbers

    lens = read_intrinsics(camera.intrinsics, *source.info.size) or source.info.intrinsics
    height_m, pitch_deg = read_mount_numbers(camera.mount) or (None, None)
    stated = camera.mount if pitch_deg is not None or source.info.mount is not None else None
    mount = read_mount(stated, source.info.mount)
    tilt = "mount" if height_m is None else "pitch"
    lacking = " and ".join(name for name, value in (("lens", lens), (tilt, mount)) if value is None)
    return lens, mount, height_m, lacking


def _earlier_guess(camera: "Source", source: "Camera", floor: "FloorCamera") -> "CameraGuess | None":
    """What lens and mount of a camera file or a recording were guessed in an earlier run, without what options give
    now."""
    from edgemap.cli.camera_options import read_mount_numbers
    from edgemap.runtime.frames.reading import user_path
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
    from edgemap.runtime.motion.camera_guess import CameraGuess

    folder = user_path(camera.camera.partition(":")[2] or camera.camera)
    path = camera.camera_file or folder / "camera.yaml"
    recorded = {} if camera.camera_file else source.info.calibration
    if not recorded and not path.is_file():
        return None
    stated = set() if camera.intrinsics is None else {"intrinsics"}
    if numbers := read_mount_numbers(camera.mount):
        stated.add("height" if numbers[1] is None else "mount")
    calibration, where = recorded or read_camera_yaml(path).calibration, camera.camera if recorded else str(path)
    return CameraGuess.of_record(calibration, floor.intrinsics, floor.mount, where, stated)


class CameraKeeper:
    """A run's camera.yaml: the mount set on the live page, else the guess, with angles estimated during the drive.
    spec: the camera, for the command that it suggests."""

    def __init__(self, folder: Path, floor: "FloorCamera", guess: "CameraGuess | None", spec: str = "demo") -> None:
        self._path, self._floor, self._guess, self._by_hand = folder / "camera.yaml", floor, guess, False
        again = shlex.join(["--camera-file", str(self._path)])
        self._line = f"lens and mount are kept in {self._path}  (the next run: {again})"
        self._spec = without_secrets(spec)

    def begin(self) -> None:
        """Saves the guess as it is, for a run that is killed or whose camera is lost. Raises DiskError."""
        if self._guess is not None:
            self._write(self._guess.record())

    def set_mount(self, height_m: float, pitch_deg: float) -> Path:
        """Saves a mount that a person has set; roll and lever arm stay. Raises GeometryError, CameraError."""
        from edgemap.geometry.camera.floor import FloorCamera

        mount = replace(self._floor.mount, height_m=height_m, pitch_rad=math.radians(pitch_deg))
        self._floor = FloorCamera(self._floor.intrinsics, mount)
        self._write(self._guess.record() | {"mount": "by hand"} if self._guess else {"method": "by hand"})
        self._by_hand = True
        return self._path

    def at_end(
        self,
        observed: "FrameObservations | None" = None,
        seen: "HeightEstimate | None" = None,
        axle: "Rolling | None" = None,
        alone: bool = True,
    ) -> str | None:
        """Saves the guess, unless a person has set the mount. Returns the lines to print: where it is, and where the
        height is guessed the commands that take one by tape measure. observed: of the last frame; seen: the height;
        axle: by the turns. alone: whether no wheels and no depth measured the path."""
        from edgemap.calibrate.guess_sizes import HEIGHT_SIGMA
        from edgemap.geometry.camera.floor import FloorCamera

        guess = self._guess
        if guess is None or self._by_hand:
            return self._line if self._by_hand else None
        mount, estimate = self._floor.mount, observed and observed.mount_estimate
        if estimate is not None and not guess.sway_rad:  # a carried camera's last angles are no mount
            mount = replace(mount, pitch_rad=estimate.mount.pitch_rad, roll_rad=estimate.mount.roll_rad)
        if seen is not None and guess.height_sigma and not guess.sway_rad:
            mount = replace(mount, height_m=seen.height_m)
            guess = self._guess = replace(guess, height_sigma=seen.sigma_m / seen.height_m)
        no_arm = mount.forward_m == mount.left_m == 0.0 and guess.pitch_sigma_rad and not guess.sway_rad
        if no_arm and alone and axle is not None and axle.axle_sigma_m < SURE_AXLE_M:
            mount = replace(mount, forward_m=(observed.scale if observed else 1.0) * axle.axle_m)
            side = "before" if axle.axle_m >= 0.0 else "behind"
            ahead = f"{abs(mount.forward_m):.2f} +- {axle.axle_sigma_m:.2f} m {side} the turn axis"
            self._line += f"\nthe lens is {ahead}, by its turns: the next run has that axis for its origin"
        self._floor = FloorCamera(self._floor.intrinsics, mount)
        self._write(guess.record())
        if not guess.height_sigma:
            return self._line
        height = f"{mount.height_m:.2f}"
        again = shlex.join(["edgemap", "run", "--camera", self._spec, "--camera-file", str(self._path)])
        folder = self._path.parent
        scale = shlex.join(["edgemap", "map", "scale", str(folder), "--height", height, "-o", f"{folder}-scaled"])
        what = "the scale of the map" if alone else "the distance of each object"
        height_by, lens = f"by the sizes of objects it is {height} m, to {100 * guess.height_sigma:.0f} %", "lens"
        if guess.sway_rad:
            height_by = f"as people carry a camera it is {height} m, to {100 * guess.height_sigma:.0f} %"
            lens = "lens as you carry it"
        elif guess.height_sigma >= HEIGHT_SIGMA:
            height_by = f"no object of a usual size was seen; {height} m is usual for a robot"
        lines = [
            self._line,
            f"nobody measured the height of the lens: {height_by}, and {what}",
            f"with it; measure it with a tape, from floor to {lens}, and run again with it instead of {height}:",
            f"  {again} --mount {height}",
            *(["or scale this map by it:", f"  {scale}"] if alone else []),
        ]
        return "\n".join(lines)

    def _write(self, calibration: dict[str, object]) -> None:
        from edgemap.runtime.inputs.drives.camera_yaml import write_camera_yaml

        write_camera_yaml(self._path, self._floor.intrinsics, self._floor.mount, calibration=calibration)


def guessing_frames(camera: "Source", source: "Camera", how: "CameraOptions | None" = None) -> "list[Frame]":
    """Pictures spread over a live camera's first seconds, or over the first part of a file, which is opened again as
    `how` says: of each view one, where that leaves enough, as a camera at rest shows nothing of how it is carried."""
    import time

    from edgemap.calibrate.board import frames_of
    from edgemap.calibrate.guess_focal import FEWEST_ROOMS
    from edgemap.runtime.motion.views import views_of

    if source.info.live:
        frames = list["Frame"]()
        until_s, next_s = time.monotonic() + LIVE_S, -math.inf
        for frame in frames_of(source, None, lambda: time.monotonic() > until_s):
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + LIVE_EVERY_S
                frames.append(frame)
                if sum(one.depth is not None for one in frames) >= DEPTHS:
                    break
        return frames

    def sampled(every: int) -> "Iterator[Frame]":
        with camera.open(replace(how, realtime=False) if how else None) as again:
            yield from (frame for frame in frames_of(again, count) if frame.index % every == 0)

    count = min(source.info.frame_count or REACH, REACH)
    every = max(1, count // PICTURES)
    frames = list(sampled(every))
    if every > 1 and len(frames) < PICTURES // 2:  # a short file that does not say its length
        every = max(1, every * len(frames) // PICTURES)
        frames = list(sampled(every))
    views = list(views_of(frames))
    if FEWEST_ROOMS <= len(views) < len(frames):  # as many again from what is not at rest
        return list(views_of(sampled(max(1, every * len(views) // len(frames)))))[: 2 * PICTURES]
    return frames


def _stated(spec: str, source: "Camera") -> "Focal | None":
    """The focal length that the source's own file states."""
    from edgemap.calibrate.guess import Focal
    from edgemap.runtime.frames.reading import user_path
    from edgemap.runtime.inputs.cameras.stated_focal import stated_focal_px

    focal = None if source.info.live else stated_focal_px(user_path(spec), *source.info.size)
    return focal and Focal(focal[0], 0.05, focal[1])
