"""A recorded drive as a camera: its pictures or its video, with its lens, mount and truth."""

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.cameras.pictures import PicturesCamera
from edgemap.runtime.cameras.video import VideoCamera
from edgemap.runtime.drives.drive import Drive


def drive_camera(
    drive: Drive, name: str, intrinsics: Intrinsics | None = None, mount: Mount | None = None
) -> PicturesCamera | VideoCamera:
    """The drive's frames at the drive's stamps; given intrinsics or mount go before its own.

    A mount that was given does not move the truth: that was taken to the turn axis by the drive's own lever arm.
    """
    intrinsics, mount = intrinsics or drive.intrinsics, mount or drive.mount
    if drive.video is not None:
        camera = VideoCamera(name, drive.video, intrinsics, mount, [float(stamp) for stamp in drive.stamps_s])
    else:
        camera = PicturesCamera(name, drive.images, drive.stamps_s, intrinsics, mount)
    camera.rate_hz = drive.rate_hz
    camera.truth, camera.attitudes = drive.truth, drive.attitudes
    camera.wheel, camera.imu, camera.depth = drive.wheel, drive.imu, drive.depth
    return camera
