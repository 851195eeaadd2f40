"""`edgemap export`: trained weights to a bundle."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from edgemap.cli.arguments import arg
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need

if TYPE_CHECKING:
    from edgemap.runtime.network.manifest import Manifest


def command(
    checkpoint: Annotated[
        Path | None,
        tyro.conf.Positional,
        arg(
            metavar="[CHECKPOINT]",
            help="What was trained: a detector's best.pt, or an odometry or floor head's, which names its backbone.",
        ),
    ] = None,
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="The bundle folder to write.")],
    backbone: Annotated[
        str | None,
        arg(
            metavar="NAME|FILE",
            help="yolov3, yolov3-tiny, yolox-nano, a Darknet .cfg, an .onnx file, or a detector's best.pt.",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        arg(metavar="FILE", help="The backbone's .weights (yolox-nano: .onnx); fetched for a NAME without it."),
    ] = None,
    head: Annotated[
        tuple[Path, ...],
        arg(
            metavar="CHECKPOINT",
            help="Trained heads: of the paper's odometry and of the floor mask.",
        ),
    ] = (),
    feature: Annotated[
        str | None,
        arg(
            metavar="NAME",
            help="Adds an untrained paper head that reads this, for timing: head (raw coarse map), neck, stride8, "
            "stride16, layer:N; for ONNX files a tensor's name or stride8, stride16, stride32.",
        ),
    ] = None,
    size: Annotated[
        tuple[int, int] | None, arg(metavar="W H", help="Input size in pixels of a Darknet backbone.")
    ] = None,
    random_weights: Annotated[
        bool, arg(help="Seeded random weights instead of a file, for timing only; detects nothing.")
    ] = False,
    int8: Annotated[
        bool, arg(help="Besides, a variant of 8-bit numbers for `--precision int8`; needs --calibrate.")
    ] = False,
    calibrate: Annotated[
        Path | None,
        arg(
            metavar="DIR",
            help="Pictures like those that the robot will see, for --int8: a folder of some hundreds. With images/ and "
            "YOLO labels/ the loss of AP50 is measured too.",
        ),
    ] = None,
) -> None:
    """Write a bundle that the robot loads, proven against its source.

    Random pictures and random states run through the source and through onnxruntime, a chain of steps; the largest
    difference goes into bundle.json. A bundle that fails is not left behind.
    """
    need("export", "edgemap export")
    from edgemap.export.exporter import export_backbone
    from edgemap.export.floor.checkpoint import load_floor
    from edgemap.export.odometry.checkpoint import load_head
    from edgemap.export.torch_files import kind_of
    from edgemap.runtime.network.manifest_file import read_manifest

    if int8 and calibrate is None:
        raise UsageError("--int8 needs pictures: --calibrate DIR")
    if calibrate is not None and not int8:
        raise UsageError(f"--calibrate {calibrate} is for --int8")
    heads = list(head)
    kind = kind_of(checkpoint) if checkpoint else ""
    if kind == "detector":
        if backbone is not None:
            raise UsageError(f"{checkpoint} is a detector itself: --backbone {backbone} does not go with it")
        backbone = str(checkpoint)
    elif checkpoint is not None:
        heads.insert(0, checkpoint)
        named = load_floor(checkpoint) if kind == "floor" else load_head(checkpoint)
        backbone = backbone or named.backbone
    if backbone is None:
        raise UsageError("what to export? edgemap export CHECKPOINT -o DIR, or edgemap export --backbone NAME -o DIR")
    export_backbone(
        backbone,
        output,
        weights=weights,
        heads=heads,
        feature=feature,
        size=size,
        random_seed=0 if random_weights else None,
        calibrate=calibrate,
    )
    describe(output, read_manifest(output))


def describe(folder: Path, manifest: "Manifest") -> None:
    """Prints a bundle's contents and its deviation from the source."""
    size = manifest.detector.input
    print(
        f"bundle {manifest.name} in {folder}/: {size.width}x{size.height} input, "
        f"{len(manifest.detector.classes)} classes"
    )
    for kind, head in manifest.odometry.items():
        print(f"  {kind} odometry: {head.parameters:,} parameters, {'trained' if head.trained else 'NOT trained'}")
    if (floor := manifest.detector.floor) is not None:
        print(
            f"  floor mask: {' and '.join(floor.labels)}, {floor.shape[2]}x{floor.shape[3]} cells of {floor.stride} px"
        )
    for name, proof in manifest.parity.items():
        print(
            f"  {name}: differs from its source by {proof.max_abs_difference:.2g} at most "
            f"(allowed {proof.tolerance:.2g}), {proof.cases} chains of {proof.steps} steps"
        )
    for precision, variant in manifest.variants.items():
        print(f"  {variant_line(precision, variant.measured)}")


def variant_line(precision: str, measured: dict[str, Any]) -> str:
    """Accuracy and speed of a backbone variant, in one line."""
    speed = (
        f"{measured['time']:.2f} of float32's time on {measured['processor']}" if "time" in measured else "not timed"
    )
    ap50 = measured.get("ap50")
    loss = f"AP50 {ap50[precision]:.3f} against {ap50['float32']:.3f}" if ap50 else "AP50 not measured"
    return f"{precision}: {speed}, {loss}"
