"""`edgemap calibrate intrinsics`: the lens from pictures of a chessboard."""

from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.calibrate_options import BoardText, CalibrationOptions, print_board_fit, read_board


def command(calibration: Annotated[CalibrationOptions, arg(name="Camera")], board: BoardText = "9x6") -> None:
    """Measure focal lengths, principal point and distortion with a printed chessboard.

    Show the complete board in 10 to 40 sharp pictures: near and far, in all corners of the picture, tilted to all
    sides. Refuses where the boards do not determine the lens well enough. A --camera-file keeps its mount.
    """
    from edgemap.calibrate.lens import fit_lens
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
    from edgemap.runtime.inputs.open import open_camera

    chessboard = read_board(board)
    calibration.check()
    known = calibration.camera_file
    mount = read_camera_yaml(known).mount if known else None
    with open_camera(calibration.camera) as source:
        fit = fit_lens(calibration.views(source, chessboard), chessboard, source.info.size)
    lens, record = fit.intrinsics, fit.record()
    print_board_fit(record)
    for name in fit.dropped:
        print(f"left out, it fits badly: {name}")
    for name, sigma_px in zip(("fx", "fy", "cx", "cy"), fit.sigma_px, strict=True):
        print(f"  {name} {getattr(lens, name):8.2f} +- {sigma_px:.2f} px")
    k1, k2, p1, p2, _ = lens.distortion.coefficients
    print(f"  k1 {k1:.5f}  k2 {k2:.5f}  p1 {p1:.5f}  p2 {p2:.5f}  (k3 held at 0)")
    calibration.write(lens, mount, "intrinsics", record)
