"""`edgemap train odometry`: drives with true poses to an odometry head for one backbone."""

from pathlib import Path
from typing import Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.training import TORCH, FeatureCache, Resume, check_training
from edgemap.export.settings import OdometrySettings
from edgemap.runtime.frames.errors import UsageError


def command(
    settings: Annotated[OdometrySettings, arg(name="Training")],
    data: Annotated[
        tuple[str, ...],
        arg(metavar="KIND:DIR...", help="Drives with true poses and a mount: drive, locobot, kitti, tum, c2w."),
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
    head: Annotated[
        Literal["flow", "paper"], arg(help="flow: ours. paper: the paper's ConvLSTM by its own recipe.")
    ] = "flow",
    feature: Annotated[
        str | None,
        arg(metavar="NAME", help="What the head reads; by default stride4 for flow, the raw coarse map for paper."),
    ] = None,
    start: Annotated[
        Path | None, arg(metavar="FILE", help="A head's best.pt to go on from, for the same feature.")
    ] = None,
    larger: Annotated[
        Path | None,
        arg(metavar="FILE", help="A flow head to begin a smaller one with, fitted to it; --steps 0 gives just that."),
    ] = None,
    resume: Resume = False,
    length: Annotated[int | None, arg(metavar="T", help="Frames per clip; by default 8, paper 10.")] = None,
    kernel: Annotated[Literal[3, 5], arg(help="Side of the paper head's kernels.")] = 3,
    relu: Annotated[bool, arg(help="The paper head with ReLU, not leaky ReLU.")] = False,
    first: Annotated[int, arg(metavar="N", help="Leave out the first N frames of each drive.")] = 0,
    frames: Annotated[int | None, arg(metavar="N", help="Only N frames of each training drive.")] = None,
    views: Annotated[
        int | None,
        arg(
            metavar="N",
            help="Train a flow head on N rotated, zoomed or mirrored views of each drive besides; by default 8 of "
            "up to three drives, which it would learn by heart.",
        ),
    ] = None,
    validation_first: Annotated[int, arg(metavar="N", help="The same for validation drives.")] = 0,
    validation_frames: Annotated[int | None, arg(metavar="N", help="The same for validation drives.")] = None,
    workers: Annotated[int, arg(metavar="N", help="Processes that compute features, each a drive.")] = 1,
    cache: FeatureCache = None,
) -> None:
    """Train an odometry head on features of a frozen backbone, which are computed once and kept.

    Interrupted runs go on with --resume. `edgemap export DIR/best.pt -o BUNDLE` makes a bundle of backbone and head.
    """
    from edgemap.cli.options import at_least
    from edgemap.runtime.frames.extras import need

    need("export", "edgemap train odometry", TORCH)
    at_least(1, workers=workers, frames=frames, validation_frames=validation_frames)
    at_least(2, length=length)
    at_least(0, steps=settings.steps, first=first, views=views, validation_first=validation_first)
    check_training(settings, len(data))
    if views and (head != "flow" or larger is not None):
        raise UsageError("--views: for a flow head, which knows how its camera is mounted, and without --larger")
    from edgemap.export.exporter import is_onnx, open_backbone
    from edgemap.export.odometry.data import FeatureStore, usual_views
    from edgemap.export.odometry.flow import FlowHead
    from edgemap.export.odometry.recipe import FewDrives, flow_recipe, paper_recipe
    from edgemap.export.odometry.start import begin
    from edgemap.export.odometry.train import HeadTraining
    from edgemap.runtime.network.store import cache_folder

    feature = feature or {"flow": "stride4", "paper": "head"}[head]
    if feature == "head" and is_onnx(backbone):
        feature = "stride32"
    part = open_backbone(backbone, weights, [feature])
    store = FeatureStore(part, feature, cache or cache_folder() / "features")
    print(f"features {feature} {store.shape} of {part.name} in {store.folder}", flush=True)
    if views is None:
        views = usual_views(data) if head == "flow" and larger is None else 0
    train = store.load(data, first, frames, workers, views)
    held_back = store.load(validation, validation_first, validation_frames, workers)
    seen = f"{len(data)} drives" + (f" and {views} views of each" if views else "")
    print(f"{sum(map(len, train))} frames of {seen} to train on, {sum(map(len, held_back))} to validate on")
    begun = begin(
        head, store, train, backbone, feature, seed=settings.seed, start=start, larger=larger, device=settings.device,
        kernel=kernel, slope=0.0 if relu else 0.1,
    )  # fmt: skip
    print(f"{head} head: {begun.head.parameters_count:,} parameters", flush=True)
    if isinstance(begun.head, FlowHead):
        print(f"lengths in units of {begun.head.unit_m:g} m, after the nearest floor in view", flush=True)
        recipe = flow_recipe(settings.rate or 1e-3, length or 8, FewDrives() if views else None)
    else:
        recipe = paper_recipe(length or 10, (settings.rate or 5e-3) / 5e-3)
    trainer = HeadTraining(begun, recipe, train, held_back, output, settings)
    if resume:
        trainer.resume()
    best = trainer.run()
    summary = f"validation score {best['score']:.3g} after {best['steps']} steps, {best['minutes']:g} min"
    print(f"{output / 'best.pt'}: {summary}")
