"""`edgemap eval detection`: how good the boxes are."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import Json, at_least, figure, in_unit, listed, print_json
from edgemap.runtime.frames.errors import CameraError, UsageError

if TYPE_CHECKING:
    from edgemap.evaluation.detection import ScoredPicture
    from edgemap.runtime.network.bundle import Bundle

LOWEST = 0.05  # score of a box that a calibration looks at


def command(
    network: Annotated[NetworkOptions, arg(name="Network")],
    data: Annotated[
        str,
        arg(
            aliases=["--camera"],
            metavar="yolo:DIR|drive:DIR|sim:SEED",
            help="Labelled pictures, a drive with boxes.json, or one that is rendered: 450 frames by default.",
        ),
    ],
    frames: Annotated[int | None, arg(metavar="N", help="Only the first N pictures.")] = None,
    confidence: Annotated[
        float, arg(metavar="0..1", help="Minimum score of a box; low, so that the whole curve counts.")
    ] = 0.001,
    nms: Annotated[float, arg(metavar="0..1", help="Overlap (IoU) above which the weaker box goes.")] = 0.6,
    classes: Annotated[
        str | None,
        arg(metavar="NAME,…", help="Score these classes only, so that bundles compare; by default all."),
    ] = None,
    plot: Annotated[
        Path | None,
        arg(metavar="DIR", help="Draw the worst false boxes and the largest misses into this folder."),
    ] = None,
    calibrate: Annotated[
        bool,
        arg(
            help="Write into the bundle from which score on boxes of each class are more often right than wrong: from "
            "there on a box counts fully as evidence of an object, at 0.1 below half, at 0.2 below not at all."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Average precision on labelled pictures, COCO protocol: AP over IoU 0.50 to 0.95, and AP50.

    Classes are matched by name; true boxes of classes that the bundle does not know are left out and counted apart.
    Precision and recall are those at the bundle's own threshold, with the suppression of a run, at IoU 0.50.
    Boxes that are known to be seen too little (under 30 % visible, or under 24 px) are ignored: neither hit nor miss.
    """
    from functools import partial

    from tqdm import tqdm

    from edgemap.cli.simulated import as_data
    from edgemap.evaluation.detection import ScoredPicture, average_precision, operating_point
    from edgemap.runtime.inputs.drives.open import labelled_pictures, open_drive
    from edgemap.runtime.network.decode import Decoder, Detector

    at_least(1, frames=frames)
    in_unit(confidence=confidence, nms=nms)
    loaded = network.load(data, alone=True)
    spec = loaded.manifest.detector
    detector, every = Detector(loaded), Decoder(spec, confidence, nms)
    as_run = Decoder(spec, loaded.manifest.confidence, one_name=True)
    number = {name: index for index, name in enumerate(loaded.names)}
    if classes is not None:
        chosen = set(listed(classes))
        if not chosen or chosen - set(number):
            raise UsageError(f"--classes {classes!r}: the bundle knows {', '.join(loaded.names)}")
        number = {name: index for name, index in number.items() if name in chosen}
    every_name = Decoder(spec, LOWEST, one_name=True)
    pictures, shown, possible, unknown = [], [], [], 0
    mistakes = None
    if plot:
        from edgemap.plots.detection import Mistakes

        mistakes = Mistakes(loaded.names)
    with as_data(data, frames, quiet=json) as folder:
        drive = open_drive(folder)
        if not drive.boxes:
            raise CameraError(f"{folder}: no true boxes in it (yolo labels, or boxes.json beside a drive)")
        known, count = labelled_pictures(drive, frames), len(drive.boxes[:frames])
        for image, truth in tqdm(known, total=count, unit=" pictures", disable=json or None):
            unknown += sum(label not in number for label in truth.labels)
            outputs = detector.raw(image)
            compare = partial(ScoredPicture.compare, truth.boxes, truth.labels, truth.ignorable())
            pictures.append(compare(every(*outputs), number))
            shown.append(compare(as_run(*outputs), number))
            if calibrate:
                possible.append(compare(every_name(*outputs), number))
            if mistakes:
                mistakes.add(image, shown[-1])
    document: dict[str, Any] = {"data": data, "bundle": loaded.manifest.name}
    document |= {"precision": loaded.precision, "engine": loaded.compute.engine}
    document |= average_precision(pictures, loaded.names)
    point = operating_point(shown, loaded.names)
    at_point = point.pop("per_class")
    for name, figures in document["per_class"].items():
        figures |= at_point[name]
    document |= {"threshold": loaded.manifest.confidence, **point}
    drawn = mistakes.save(plot) if mistakes and plot else []
    document["boxes_of_unknown_classes"] = unknown
    if calibrate:
        document["calibrated"] = _calibrate(loaded, possible)
    if json:
        print_json(document)
        return
    print(f"{document['bundle']} on {data}: {document['pictures']} pictures, {document['boxes_true']} true boxes")
    print(f"  AP {document['ap']:.3f}   AP50 {document['ap50']:.3f}")
    text = f"precision {figure(document['precision'], '.3f')}   recall {figure(document['recall'], '.3f')}"
    print(f"  at the bundle's threshold, {document['threshold']:g}: {text}")
    for name, figures in sorted(document["per_class"].items(), key=lambda item: -item[1]["ap50"]):
        line = f"AP {figures['ap']:.3f}   AP50 {figures['ap50']:.3f}"
        point = "   ".join(f"{key} {figure(figures[key], '.3f')}" for key in ("precision", "recall"))
        print(f"  {name:<16} {line}   {point}")
    if calibrate:
        shown_scores = (f"{one or 'all'} {score:g}" for one, score in document["calibrated"].items())
        print(f"  counts fully from: {', '.join(shown_scores)}")
    for path in drawn:
        print(f"  {path}")
    if unknown:
        print(f"  ({unknown} true boxes of classes that are not scored were left out)")
    if document["boxes_ignored"]:
        print(f"  ({document['boxes_ignored']} true boxes that are seen too little were ignored)")


def _calibrate(loaded: "Bundle", pictures: "list[ScoredPicture]") -> dict[str, float]:
    """Writes the scores at which boxes count fully into the bundle, or FILE.bundle.json beside FILE.onnx; all under "".
    Raises UsageError for a bundle of the package, and DiskError."""
    import msgspec

    from edgemap.evaluation.detection import break_even_scores
    from edgemap.geometry.observations.sighting import WEIGHT_SPAN
    from edgemap.runtime.network.manifest_file import MANIFEST_NAME, write_manifest
    from edgemap.runtime.network.store import shipped_folder

    spec, found = loaded.manifest.detector, break_even_scores(pictures, loaded.names)
    half = {name: round(max(score - WEIGHT_SPAN / 2.0, 0.0), 3) for name, score in found.items()}
    all_classes = half.pop("")
    name = MANIFEST_NAME if spec.reading is None else f"{Path(spec.file).stem}.bundle.json"
    if loaded.folder.parent == shipped_folder():
        raise UsageError(
            f"--calibrate: {loaded.manifest.name} comes with edgemap, which stays as it is: copy its folder"
        )
    manifest = msgspec.structs.replace(loaded.manifest, sure_confidence=all_classes, class_scores=half)
    write_manifest(loaded.folder, manifest, name)
    return found
