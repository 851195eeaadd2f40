"""`edgemap train odometry`: drives with true poses to the paper's odometry head for one backbone."""

from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.options import at_least
from edgemap.cli.training import TORCH, FeatureCache, Resume, check_training
from edgemap.export.settings import OdometrySettings
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need


def command(
    settings: Annotated[OdometrySettings, arg(name="Training")],
    data: Annotated[
        tuple[str, ...],
        arg(metavar="KIND:DIR...", help="Drives with true poses: drive, locobot, kitti, tum, c2w."),
    ],
    output: Annotated[
        Path,
        arg(aliases=["-o"], metavar="DIR", help="Gets best.pt, last.pt, curves.csv and curves.png."),
    ],
    validation: Annotated[
        tuple[str, ...],
        arg(metavar="KIND:DIR...", help="Other drives, that choose best.pt; other rooms!"),
    ],
    backbone: Annotated[
        str,
        arg(metavar="NAME|FILE", help="edgemap-nano, yolox-nano, yolov3-tiny, yolov3, a .cfg, .onnx or .pt."),
    ] = "edgemap-nano",
    weights: Annotated[Path | None, arg(metavar="FILE", help="The backbone's weights.")] = None,
    head: Annotated[str, arg(metavar="paper", help="The paper's ConvLSTM by its own recipe, the only one.")] = "paper",
    feature: Annotated[
        str | None,
        arg(metavar="NAME", help="What the head reads; by default the raw coarse map, of an .onnx file stride32."),
    ] = None,
    start: Annotated[
        Path | None, arg(metavar="FILE", help="A head's best.pt to go on from, for the same feature.")
    ] = None,
    resume: Resume = False,
    length: Annotated[int, arg(metavar="T", help="Frames per clip.")] = 10,
    first: Annotated[int, arg(metavar="N", help="Leave out the first N frames of each drive.")] = 0,
    frames: Annotated[int | None, arg(metavar="N", help="Only N frames of each training drive.")] = None,
    validation_first: Annotated[int, arg(metavar="N", help="The same for validation drives.")] = 0,
    validation_frames: Annotated[int | None, arg(metavar="N", help="The same for validation drives.")] = None,
    cache: FeatureCache = None,
) -> None:
    """Train an odometry head on features of a frozen backbone, which are computed once and kept.

    Interrupted runs go on with --resume. `edgemap export DIR/best.pt -o BUNDLE` makes a bundle of backbone and head.
    """
    need("export", "edgemap train odometry", TORCH)
    if head != "paper":
        raise UsageError(f"--head {head}: the only learned odometry is paper; motion needs no head (--odometry hybrid)")
    at_least(1, frames=frames, validation_frames=validation_frames)
    at_least(2, length=length)
    at_least(0, steps=settings.steps, first=first, validation_first=validation_first)
    check_training(settings, len(data))
    from edgemap.export.exporter import is_onnx, open_backbone
    from edgemap.export.odometry.data import FeatureStore
    from edgemap.export.odometry.train import HeadTraining, begin
    from edgemap.export.torch_files import parameter_count
    from edgemap.runtime.network.store import cache_folder

    feature = feature or ("stride32" if is_onnx(backbone) else "head")
    part = open_backbone(backbone, weights, feature)
    store = FeatureStore(part, cache or cache_folder() / "features", settings.threads)
    print(f"features {feature} {store.shape} of {part.manifest.name} in {store.folder}", flush=True)
    train = store.load(data, first, frames)
    held_back = store.load(validation, validation_first, validation_frames)
    print(f"{sum(map(len, train))} frames of {len(data)} drives to train on, {sum(map(len, held_back))} to validate on")
    begun = begin(store, train, backbone, feature, settings.seed, start)
    print(f"paper head: {parameter_count(begun.head):,} parameters", flush=True)
    trainer = HeadTraining(begun, train, held_back, output, settings, length, store.mirror)
    if resume:
        trainer.resume()
    best = trainer.run()
    summary = f"validation score {best['score']:.3g} after {best['steps']} steps, {best['minutes']:g} min"
    print(f"{output / 'best.pt'}: {summary}")
