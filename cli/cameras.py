"""`edgemap cameras`: which cameras are here, and what to type for each."""

from dataclasses import asdict
from typing import TYPE_CHECKING

from edgemap.cli.options import Json, print_json

if TYPE_CHECKING:
    from edgemap.runtime.inputs.cameras.connected import ConnectedCamera


def command(json: Json = False) -> None:
    """List RealSense devices, V4L2 devices and what installed camera kinds find, each with the command to type."""
    from edgemap.runtime.inputs.cameras.connected import connected_cameras

    cameras, notes = connected_cameras()
    if json:
        found = [asdict(camera) | {"command": command_line(camera)} for camera in cameras]
        print_json({"cameras": found, "notes": notes})
        return
    for camera in cameras:
        print(f"{camera.spec:<24} {camera.name}" + (f"; {camera.problem}" if camera.problem else ""))
        print(f"{'':<24} -> {command_line(camera)}")
        if not camera.knows_lens:
            print(f"{'':<24} -> edgemap run --camera {camera.spec} --mount HEIGHT_M      (lens and pitch are guessed)")
    if not cameras:
        print("no camera found; without one:  edgemap run  (the demo)")
    for note in notes:
        print(f"not looked for: {note}")
    print("network cameras are not searched for:  --camera rtsp://ADDRESS or http://ADDRESS")


def command_line(camera: "ConnectedCamera") -> str:
    """The command that runs with this camera; words in capitals are placeholders."""
    lens = "" if camera.knows_lens else " --intrinsics FX,FY,CX,CY"
    return f"edgemap run --camera {camera.spec} --mount HEIGHT_M,PITCH_DEG{lens}"
