"""`edgemap train floor`: pictures with floor labels to a floor head."""

from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.options import at_least
from edgemap.cli.training import TORCH, FeatureCache, Resume, check_training
from edgemap.export.settings import FloorSettings
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need


def command(
    settings: Annotated[FloorSettings, arg(name="Training")],
    data: Annotated[
        tuple[str, ...],
        arg(
            metavar="KIND:DIR...",
            help="Labelled pictures: floor:DIR with images/ and floor/NAME.png: 1 floor, 2 wall, 0 other, 255 "
            "unknown, as simulate --pictures writes; or a plain folder of pictures, which the teacher labels.",
        ),
    ],
    validation: Annotated[
        tuple[str, ...],
        arg(metavar="KIND:DIR...", help="Other pictures, other rooms! The highest mean IoU chooses best.pt."),
    ],
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="Gets best.pt and last.pt.")],
    backbone: Annotated[
        str, arg(metavar="NAME|DIR|FILE", help="The bundle, or the best.pt, whose frozen features the head reads.")
    ] = "edgemap-pico",
    start: Annotated[Path | None, arg(metavar="FILE", help="A floor head's best.pt to go on from.")] = None,
    teacher: Annotated[
        Path | None,
        arg(
            metavar="FILE.tflite",
            help="Labels plain folders of pictures: a network of ADE20K's 32 most frequent classes (extra teacher).",
        ),
    ] = None,
    source: Annotated[
        tuple[str, ...], arg(metavar="TEXT...", help="Where the labels come from, for the bundle's manifest.")
    ] = (),
    resume: Resume = False,
    views: Annotated[
        int, arg(metavar="N", help="Of each picture: cut, mirrored, relit, on another floor. 1.7 MB of disk each.")
    ] = 4,
    cache: FeatureCache = None,
) -> None:
    """Train a floor head on a detector's frozen features, which are computed once and kept.

    Views of a picture differ by cut, light, and floor: dyed, sunlit, wet, with rugs and litter.

    `edgemap export --backbone NAME --head ODOMETRY_HEAD DIR/best.pt -o BUNDLE` joins it to its network, whose other
    outputs stay bit for bit the same.
    """
    need("export", "edgemap train floor", TORCH)
    at_least(1, views=views)
    at_least(4, batch=settings.batch)
    check_training(settings, len(data))

    from edgemap.export.floor.cache import cached_views
    from edgemap.export.floor.checkpoint import load_floor
    from edgemap.export.floor.features import Features
    from edgemap.export.floor.labels import labelled, open_teacher
    from edgemap.export.floor.train import FloorTrainer
    from edgemap.runtime.network.store import cache_folder

    first = None if start is None else load_floor(start)
    features = Features(backbone, settings.threads)
    if first is not None and first.taps != tuple(tap.name for tap in features.taps):
        raise UsageError(f"--start {start}: reads {', '.join(first.taps)}, features of {first.backbone}")
    teach = None if teacher is None else open_teacher(teacher, settings.threads)
    sources = [labelled(spec, teach, output / "labels" / Path(spec).name) for spec in data]
    held_back = {spec: labelled(spec, teach, output / "labels" / Path(spec).name) for spec in validation}
    print(
        f"{sum(map(len, sources))} pictures to train on, {sum(map(len, held_back.values()))} to validate on", flush=True
    )
    folder = cache or cache_folder() / "features"
    records = [cached_views(features, pairs, views, folder) for pairs in sources]
    trainer = FloorTrainer(features, records, held_back, output, settings, first and first.head, source)
    if resume:
        trainer.resume()
    best = trainer.run()
    print(f"{output / 'best.pt'}: IoU {best['iou']:.3f} on the validation pictures, after {best['minutes']:g} minutes")
