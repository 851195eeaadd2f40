"""`edgemap calibrate intrinsics`: the lens from pictures of a chessboard."""

from __future__ import annotations

from pathlib import Path

from edgemap.cli.calibrate_options import BoardText, OutYaml, Pictures, check_out, read_board, views_of, write_yaml
from edgemap.cli.camera_options import CameraFile, CameraSpec
from edgemap.cli.options import at_least


def command(
    camera: CameraSpec,
    board: BoardText = "9x6",
    out: OutYaml = Path("camera.yaml"),
    frames: Pictures = None,
    camera_file: CameraFile = None,
) -> None:
    """Measure focal lengths, principal point and distortion with a printed chessboard.

    Show the complete board in 10 to 40 sharp pictures: near and far, in all corners of the picture, tilted to all
    sides. Refuses where the boards do not determine the lens well enough. A --camera-file keeps its mount.
    """
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.step.calibration.lens import fit_lens

    at_least(1, frames=frames)
    chessboard = read_board(board)
    check_out(out, camera_file)
    mount = read_camera_yaml(camera_file).mount if camera_file else None
    with open_camera(camera) as source:
        fit = fit_lens(views_of(source, chessboard, frames), chessboard, source.size)
    lens, sigma = fit.intrinsics, fit.sigma_px
    print(f"{fit.views} views, {fit.rms_px:.3f} px off (root mean square), {fit.worst_view_px:.3f} px in the worst")
    for name in fit.dropped:
        print(f"left out, it fits badly: {name}")
    for name, value, sigma_px in zip(
        ("fx", "fy", "cx", "cy"), (lens.fx, lens.fy, lens.cx, lens.cy), sigma, strict=True
    ):
        print(f"  {name} {value:8.2f} +- {sigma_px:.2f} px")
    k1, k2, p1, p2, _ = lens.distortion.coefficients
    print(f"  k1 {k1:.5f}  k2 {k2:.5f}  p1 {p1:.5f}  p2 {p2:.5f}  (k3 held at 0)")
    write_yaml(out, camera_file, lens, mount, "intrinsics", fit.record())
