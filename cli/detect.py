"""`edgemap detect`: single pictures."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import read_intrinsics, read_mount
from edgemap.cli.groups import Optics
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import Confidence, Json, minimum_score, print_json
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import one_line

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.observations.detections import Detections
    from edgemap.geometry.observations.sighting import Sighting


def command(
    network: Annotated[NetworkOptions, arg(name="Network")],
    optics: Annotated[Optics, arg(name="Camera")],
    images: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        arg(metavar="IMAGE...", help="Pictures, or folders of them."),
    ],
    confidence: Confidence = None,
    plot: Annotated[
        Path | None,
        arg(
            metavar="DIR",
            help="Write per picture its boxes; with a mount also which stand on the floor, distances, 2-D map (the "
            "paper's Fig. 4), and the horizon with a metre grid.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Find objects in single pictures; with a mount, also where they stand on the floor.

    Distances are horizontal, in metres from the lens; positions are in the base frame, x forward and y left. A box has
    them when it stands on the floor by the rule of `run`, whose maps leave out people, pets and what is far. Without
    --intrinsics or a camera file a lens of 60 degrees across is assumed, and the output states it.
    """
    from edgemap.geometry.observations.sighting import FloorRule, sightings_of
    from edgemap.runtime.frames.frame import png
    from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
    from edgemap.runtime.network.decode import Decoder, Detector
    from edgemap.runtime.network.preprocess import floor_mask
    from edgemap.runtime.step.overlay import draw_detections, draw_floor_mask

    if not images:
        raise UsageError("no pictures given: edgemap detect PICTURE... or a folder of them")
    optics.check()
    if plot and optics.mount:
        need("plot", "--plot with --mount")
    images = tuple(path for given in images for path in (list_pictures(given) if given.is_dir() else (given,)))
    loaded = network.load(str(images[0]), alone=True)
    confidence = minimum_score(confidence, loaded)
    spec = loaded.manifest.detector
    detector, decode = Detector(loaded), Decoder(spec, confidence, one_name=True)
    documents, every_box = [], FloorRule()  # people and pets too
    try:
        for path in images:
            picture = read_picture(path)
            outputs = detector.raw(picture)
            detections = decode(*outputs)
            camera, guessed = _floor_camera(picture.shape[1], picture.shape[0], optics)
            sightings = sightings_of(detections, camera, every_box) if camera else []
            document = {"image": str(path), "width": picture.shape[1], "height": picture.shape[0]}
            document |= _found(detections, sightings, camera, guessed)
            if plot:
                mask, target = floor_mask(*outputs, spec.floor), plot / f"{path.stem}.png"
                drawn = picture if mask is None else draw_floor_mask(picture, mask)
                if camera is not None:
                    from edgemap.plots.frame import plot_frame

                    plot_frame(target, drawn, detections, sightings, camera)
                else:
                    make_folder(plot)
                    write_atomically(target, png(draw_detections(drawn, detections, None)))
                document["plot"] = str(target)
            documents.append(document)
            if not json:
                _print_result(document)
    finally:  # a picture that cannot be read does not lose those before it
        if json:
            print_json(documents, allow_nan=False)


def _found(
    detections: "Detections", sightings: "list[Sighting]", camera: "FloorCamera | None", guessed: bool
) -> dict[str, Any]:
    """The boxes of one picture as JSON, with places where a mount is known. sigma_m: one standard deviation."""
    document: dict[str, Any] = {"detections": []}
    placed = {sighting.detection: sighting for sighting in sightings}
    if camera:
        document["horizon_row_px"] = round(camera.horizon_row(), 2)
        document["lens_guessed"] = guessed
    for index, (label, score) in enumerate(zip(detections.labels, detections.scores, strict=True)):
        entry: dict[str, Any] = {
            "label": label,
            "score": round(float(score), 6),
            "box": [round(float(v), 3) for v in detections.boxes[index]],
        }
        if camera:
            entry["on_floor"] = index in placed
        if sighting := placed.get(index):
            variance_m2 = float((sighting.covariance_m2 + sighting.shared_m2).trace()) / 2.0
            entry["distance_m"] = round(sighting.distance_m, 4)
            entry["x_m"], entry["y_m"] = (round(float(v), 4) for v in sighting.position_base_m)
            entry["sigma_m"] = round(variance_m2**0.5, 4)
            entry["width_m"], entry["height_m"] = round(sighting.width_m, 4), round(sighting.height_m, 4)
        document["detections"].append(entry)
    return document


def _floor_camera(width: int, height: int, optics: Optics) -> "tuple[FloorCamera | None, bool]":
    """The picture's FloorCamera where a mount is known, and whether its lens is a guess."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml

    described = read_camera_yaml(optics.camera_file) if optics.camera_file else None
    mount = read_mount(optics.mount, described and described.mount)
    lens = read_intrinsics(optics.intrinsics, width, height) or (described and described.intrinsics)
    if mount is None:
        return None, False
    if lens is None:
        focal = width / 2.0 * 3.0**0.5
        return FloorCamera(Intrinsics(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0), mount), True
    if (lens.width, lens.height) != (width, height):
        raise UsageError(f"the picture is {width}x{height} px, the camera file says {lens.width}x{lens.height}")
    return FloorCamera(lens, mount), False


def _print_result(document: dict) -> None:
    print(f"{one_line(document['image'])}: {len(document['detections'])} objects")
    if document.get("lens_guessed"):
        print("  (lens unknown: 60 degrees across assumed, distances are rough; pass --intrinsics)")
    for entry in document["detections"]:
        where = ""
        if "distance_m" in entry:
            where = f"{entry['distance_m']:.2f} m away, x {entry['x_m']:.2f} y {entry['y_m']:.2f} m"
            where += f" +- {entry['sigma_m']:.2f}"
        elif "on_floor" in entry:
            where = "not on the floor, or part of another box"
        box = ", ".join(f"{v:.0f}" for v in entry["box"])
        print(f"  {entry['label']:<16} {entry['score']:.3f}  box {box:<24} {where}")
    if "plot" in document:
        print(f"  drawn in {document['plot']}")
