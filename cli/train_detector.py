"""`edgemap train detector`: pictures with boxes to a small detector."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import at_least
from edgemap.cli.training import TORCH, Resume, check_training
from edgemap.export.settings import DetectorSettings
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need


def command(
    settings: Annotated[DetectorSettings, arg(name="Training")],
    data: Annotated[
        tuple[str, ...],
        arg(
            metavar="KIND:DIR...",
            help="Labelled pictures: yolo:DIR, or drive:DIR with boxes.json; or a plain folder of pictures, which the "
            "teachers label, and of which --keep holds on to what the network knew.",
        ),
    ],
    output: Annotated[
        Path,
        arg(aliases=["-o"], metavar="DIR", help="Gets best.pt, blended.pt, last.pt, curves.csv and curves.png."),
    ],
    validation: Annotated[
        tuple[str, ...],
        arg(
            metavar="KIND:DIR...",
            help="Other pictures, other rooms! Each is a set of its own; the highest mean AP50 chooses best.pt.",
        ),
    ],
    bundle: Annotated[
        str,
        arg(
            aliases=["--start"],
            metavar="NAME|DIR|FILE",
            help="The bundle whose detector to train, or an earlier best.pt.",
        ),
    ] = "yolox-nano",
    weights: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="A best.pt to go on from, with a schedule of its own; --keep and --blend-loss still look to --bundle.",
        ),
    ] = None,
    resume: Resume = False,
    teacher: Annotated[
        tuple[str, ...],
        arg(
            metavar="BUNDLE...",
            help="Label pictures without labels: boxes of these bundles, averaged; at least 0.45 is a label, 0.2 "
            "to 0.45 is neither object nor background.",
        ),
    ] = (),
    keep: Annotated[
        str | None,
        arg(
            metavar="BUNDLE|none",
            help="Whose scores and boxes to stay with where labels say nothing: on pictures without labels, and of "
            "classes that no label of a --data names. By default --bundle's.",
        ),
    ] = None,
    blend_loss: Annotated[
        float,
        arg(
            metavar="AP50",
            help="At the end blended.pt: weights drawn back towards the start as far as that costs at most so much "
            "validation AP50; it knows best what training did not show.",
        ),
    ] = 0.03,
    validate_pictures: Annotated[
        int, arg(metavar="N", help="Validation pictures of each folder, evenly chosen.")
    ] = 300,
) -> None:
    """Train a bundle's detector on labelled pictures: mosaics, colour, scale, blur; moving average; cosine schedule.

    Interrupted runs go on with --resume: with a budget in epochs exactly as if nothing had happened. `edgemap export
    DIR/best.pt --head HEAD -o BUNDLE` makes a bundle.
    """
    need("export", "edgemap train detector", TORCH)
    at_least(1, validate_pictures=validate_pictures)
    check_training(settings, len(data))
    if settings.size is not None and (settings.size < 64 or settings.size % 32):
        raise UsageError(f"--input {settings.size}: must be a multiple of 32 from 64 on")

    from edgemap.export.detector.network import load_network
    from edgemap.export.detector.store import load_examples, teacher_of
    from edgemap.export.detector.train import Trainer
    from edgemap.export.detector.validate import choose_blend

    settings = replace(settings, keep=0.0) if keep == "none" else settings
    start = load_network(bundle)
    network = start if weights is None else load_network(str(weights))
    reference = start if keep in (None, "none") else load_network(str(keep))
    for other, path in ((network, weights), (reference, keep)):
        if other.names != start.names:
            raise UsageError(f"{path}: knows {len(other.names)} other classes than {bundle} with {len(start.names)}")
    print(f"reading {', '.join(data)} …", flush=True)
    teach = teacher_of([NetworkOptions(name, threads=settings.threads).load() for name in teacher]) if teacher else None
    examples = load_examples(data, network.names, network.side, teach=teach)
    held_back = {
        spec: load_examples([spec], network.names, network.side, validate_pictures, teach) for spec in validation
    }
    print(
        f"{len(examples)} pictures with {sum(len(e.boxes) for e in examples)} boxes to train on, "
        f"{sum(map(len, held_back.values()))} to validate on",
        flush=True,
    )
    if bare := [spec for spec, pictures in held_back.items() if not any(one.complete.any() for one in pictures)]:
        raise UsageError(f"--validation {bare[0]}: pictures without labels need a --teacher")
    trainer = Trainer(network, examples, held_back, output, settings, reference)
    if resume:
        trainer.resume()
    best = trainer.run()
    if not trainer.ranks.first:
        return
    chosen, rows = choose_blend(start, load_network(str(output / "best.pt")), held_back, blend_loss)
    chosen.save(output / "blended.pt", {"blend": rows})
    for row in rows:
        print(f"  {row['share']:.0%} of what was learnt: AP50 {row['ap50']:.3f}   AP {row['ap']:.3f}")
    print(
        f"{output / 'best.pt'}: AP50 {best['ap50']:.3f} on the validation pictures, after {best['minutes']:g} minutes"
    )
