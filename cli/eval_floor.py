"""`edgemap eval floor`: how good the floor mask is."""

from typing import TYPE_CHECKING, Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import Json, at_least, figure, print_json
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.reading import user_path

if TYPE_CHECKING:
    from pathlib import Path

    from edgemap.geometry.camera.floor import FloorCamera


def command(
    network: Annotated[NetworkOptions, arg(name="Network")],
    data: Annotated[
        str,
        arg(
            metavar="floor:DIR|drive:DIR",
            help="DIR/images and DIR/floor/NAME.png: 1 floor, 255 unknown, all else no floor. Pictures without labels "
            "are left out. With DIR/camera.yaml the contact error is in metres too.",
        ),
    ],
    frames: Annotated[int | None, arg(metavar="N", help="Only the first N labelled pictures.")] = None,
    json: Json = False,
) -> None:
    """Overlap (IoU) of the floor mask with true labels, pooled over pixels, and where the floor ends in each column.

    The contact is the lower edge of what stands on the floor: where, from below, an image column's first run of floor
    ends. boundary_px is the median distance of the mask's from the true one; contact_m the same on the floor, for
    true contacts within 3 m.
    """
    from tqdm import tqdm

    from edgemap.evaluation.floor import FloorScore
    from edgemap.runtime.inputs.drives.pictures import read_picture
    from edgemap.runtime.inputs.drives.truth import floor_pairs, read_floor_labels
    from edgemap.runtime.network.decode import Detector
    from edgemap.runtime.network.preprocess import floor_mask

    at_least(1, frames=frames)
    kind, colon, name = data.partition(":")
    if not colon or kind not in ("floor", "drive"):
        raise UsageError(f"--data {data}: expected floor:DIR or drive:DIR")
    folder = user_path(name)
    pairs = floor_pairs(folder)[:frames]
    camera = _camera(folder)
    loaded = network.load(data, alone=True)
    spec = loaded.manifest.detector.floor
    if spec is None:
        raise UsageError(f"bundle {loaded.manifest.name} has no floor head (edgemap train floor makes one)")
    score, detectors = FloorScore(), dict[tuple[int, int], Detector]()
    for picture, labels in tqdm(pairs, unit=" pictures", disable=json or None):
        image = read_picture(picture)
        height, width = image.shape[:2]
        if (width, height) not in detectors:
            detectors[width, height] = Detector(loaded.for_pictures(width, height))
        mask = floor_mask(*detectors[width, height].raw(image), spec)
        assert mask is not None
        score.add(mask, read_floor_labels(labels, (mask.width, mask.height)), camera)
    document: dict[str, Any] = {"data": data, "bundle": loaded.manifest.name}
    document |= {"precision": loaded.precision, "engine": loaded.compute.engine, **score.row()}
    if json:
        print_json(document)
        return
    print(f"{document['bundle']} on {data}: {document['pictures']} pictures")
    print(f"  IoU {figure(document['iou'], '.3f')}   floor ends {figure(document['boundary_px'], '.1f')} px off")
    if camera is not None:
        print(f"  contacts within 3 m: {figure(document['contact_m'], '.3f')} m off (median)")


def _camera(folder: "Path") -> "FloorCamera | None":
    """The lens and mount of camera.yaml beside the pictures, where there is one with both."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml

    path = folder / "camera.yaml"
    if not path.is_file():
        return None
    described = read_camera_yaml(path)
    return None if described.mount is None else FloorCamera(described.intrinsics, described.mount)
