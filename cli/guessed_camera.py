"""`edgemap run` with an uncalibrated camera: intrinsics and mount are estimated from its first pictures."""

import math
import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edgemap.runtime.frames.reading import without_secrets

if TYPE_CHECKING:
    from edgemap.cli.groups import Source
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import HeightEstimate, Mount
    from edgemap.geometry.odometry.rolling import Rolling
    from edgemap.runtime.frames.camera import Camera, CameraOptions
    from edgemap.runtime.motion.camera_guess import CameraGuess
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.step.frame_observations import FrameObservations

SURE_AXLE_M = 0.03  # standard deviation; it is below after half a turn


def floor_camera_of(
    camera: "Source", source: "Camera", bundle: "Bundle", how: "CameraOptions | None" = None
) -> "tuple[FloorCamera, CameraGuess | None]":
    """Intrinsics and mount as given; a missing mount by the floor in depth pictures, where there are any; else guessed,
    and printed with its uncertainty. The guess of an earlier run, in the camera file, is one still.

    Raises UsageError, or CalibrationError where the pictures show no floor or an impossible mount.
    """
    from edgemap.calibrate.first_pictures import by_first_pictures, earlier_guess
    from edgemap.cli.camera_options import read_mount_numbers

    lens, mount, height_m, lacking = what_is_given(camera, source)
    if not lacking:
        stated = set() if camera.intrinsics is None else {"intrinsics"}
        if numbers := read_mount_numbers(camera.mount):
            stated.add("height" if numbers[1] is None else "mount")
        floor = camera.floor_camera(source)
        return floor, earlier_guess(camera.camera, camera.camera_file, source, floor, stated)
    again = replace(how, realtime=False) if how else None
    floor, guess, count = by_first_pictures(
        source, lambda: camera.open(again), camera.camera, bundle, lens, mount, height_m, partial(print, flush=True)
    )
    if guess is None:
        return floor, None
    print(f"guessed from {count} pictures:")
    print("\n".join(f"  {line}" for line in guess.lines()))
    if guess.height_sigma and guess.sway_rad:
        print("  the height is the scale of the map; a tape, from floor to lens as you carry it: --mount HEIGHT_M")
    elif guess.height_sigma:
        print("  wheels or depth correct the height in the drive; a tape, floor to lens, is exact: --mount HEIGHT_M")
    print("  edgemap calibrate measures all of it without guessing", flush=True)
    return floor, guess


def what_is_given(camera: "Source", source: "Camera") -> "tuple[Intrinsics | None, Mount | None, float | None, str]":
    """Lens and mount as given, None for what a run guesses; the height, where it alone is given; and in words what is
    guessed, empty where nothing is. Raises UsageError."""
    from edgemap.calibrate.first_pictures import lacking_of
    from edgemap.cli.camera_options import read_intrinsics, read_mount, read_mount_numbers

    lens = read_intrinsics(camera.intrinsics, *source.info.size) or source.info.intrinsics
    height_m, pitch_deg = read_mount_numbers(camera.mount) or (None, None)
    stated = camera.mount if pitch_deg is not None or source.info.mount is not None else None
    mount = read_mount(stated, source.info.mount)
    return lens, mount, height_m, lacking_of(lens, mount, height_m)


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
        scale = shlex.join(["edgemap", "map", "scale", str(folder), "--height", "HEIGHT_M", "-o", f"{folder}-scaled"])
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
            f"with it; measure it with a tape, from floor to {lens}, in metres, and run again:",
            f"  {again} --mount HEIGHT_M",
            *(["or scale this map by it:", f"  {scale}"] if alone else []),
        ]
        return "\n".join(lines)

    def _write(self, calibration: dict[str, Any]) -> None:
        from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, write_camera_yaml

        file = CameraFile(self._floor.intrinsics, self._floor.mount, calibration=calibration)
        write_camera_yaml(self._path, file)
