"""`edgemap train detector`: pictures with boxes to a small detector."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg


def command(
    data: Annotated[
        tuple[str, ...],
        arg(
            metavar="KIND:DIR...",
            help="Labelled pictures: yolo:DIR, or drive:DIR with boxes.json; or a plain folder of pictures, which the "
            "teachers label.",
        ),
    ],
    output: Annotated[
        Path,
        arg(aliases=["-o"], metavar="DIR", help="Gets best.pt, last.pt, curves.csv and curves.png."),
    ],
    validation: Annotated[
        tuple[str, ...],
        arg(
            metavar="KIND:DIR...",
            help="Other pictures, other rooms! Each is a set of its own; the highest mean AP50 chooses best.pt.",
        ),
    ],
    start: Annotated[
        str,
        arg(
            metavar="NAME|FILE",
            help="yolox-nano (its COCO weights, fetched where needed), its .onnx file, an earlier best.pt, or none.",
        ),
    ] = "yolox-nano",
    weights: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="A best.pt to go on from, with a schedule of its own; --keep and --blend-loss still look to --start.",
        ),
    ] = None,
    minutes: Annotated[float | None, arg(metavar="M", help="Budget of training time; goes before --epochs.")] = None,
    epochs: Annotated[int, arg(metavar="N", help="Budget in passes over the pictures.")] = 10,
    resume: Annotated[bool, arg(help="Go on from DIR/last.pt, with the same options as before.")] = False,
    input: Annotated[int, arg(metavar="PX", help="Side of the square input, a multiple of 32.")] = 416,
    batch: Annotated[int, arg(metavar="N", help="Pictures per step.")] = 16,
    rate: Annotated[
        float | None,
        arg(metavar="RATE", help="Highest learning rate; by default 0.0003, from scratch 0.004."),
    ] = None,
    mix: Annotated[
        tuple[float, ...],
        arg(metavar="SHARE...", help="Share of pictures of each --data in turn; by default by how many each holds."),
    ] = (),
    teacher: Annotated[
        tuple[str, ...],
        arg(
            metavar="BUNDLE...",
            help="Label pictures without labels: boxes of these bundles, averaged; at least 0.45 is a label, 0.2 to "
            "0.45 is neither object nor background.",
        ),
    ] = (),
    keep: Annotated[
        str | None,
        arg(
            metavar="BUNDLE",
            help="Whose features to stay near on every picture: a bundle with detector.pt, or anything that --start "
            "takes; by default --start; 'none' for nobody's.",
        ),
    ] = None,
    keep_weight: Annotated[float, arg(metavar="W", help="How hard to hold on to them.")] = 1.0,
    blend_loss: Annotated[
        float,
        arg(
            metavar="AP50",
            help="At the end blended.pt: weights drawn back towards the start as far as that costs at most so much "
            "validation AP50; it knows photographs better than best.pt does.",
        ),
    ] = 0.03,
    bfloat16: Annotated[
        bool, arg(help="Convolutions in bfloat16: 1.7 times as fast where the processor has AVX512-BF16.")
    ] = False,
    threads: Annotated[
        int,
        arg(metavar="N", help="Of the network; one is better than two where other work shares the cores."),
    ] = 2,
    seed: Annotated[int, arg(metavar="N", help="Of order, changes to pictures, and random weights.")] = 0,
    validate_minutes: Annotated[
        float | None,
        arg(metavar="M", help="Training time between validations; by default one after every epoch."),
    ] = None,
    validate_pictures: Annotated[
        int, arg(metavar="N", help="Validation pictures of each folder, evenly chosen.")
    ] = 300,
) -> None:
    """Train edgemap-nano on labelled pictures: mosaics, colour, scale, blur; moving average; cosine schedule.

    The classes are COCO's household ones. Interrupted runs go on with --resume: with a budget in epochs exactly as if
    nothing had happened.
    """
    from edgemap.cli.errors import OptionError
    from edgemap.cli.extras import need_export
    from edgemap.cli.options import at_least, find_bundle

    need_export("edgemap train detector")
    at_least(1, epochs=epochs, batch=batch, threads=threads, validate_pictures=validate_pictures)
    at_least(64, input=input)
    if input % 32:
        raise OptionError(f"--input {input}: must be a multiple of 32")
    for name, value in (("minutes", minutes), ("rate", rate), ("validate-minutes", validate_minutes)):
        if value is not None and not 0.0 < value < 1e6:
            raise OptionError(f"--{name} {value}: must be above 0")
    from edgemap.export.detector.begin import SCRATCH, begin, earlier, kept_checkpoint
    from edgemap.export.detector.blend import choose_blend
    from edgemap.export.detector.checkpoint import load_detector, save_detector
    from edgemap.export.detector.classes import NAMES
    from edgemap.export.detector.store import load_examples
    from edgemap.export.detector.teach import teacher_of
    from edgemap.export.detector.train import Settings, Trainer

    scratch = start == SCRATCH
    settings = Settings(
        size=input,
        batch=batch,
        seed=seed,
        minutes=minutes,
        epochs=epochs,
        rate=rate or (0.004 if scratch else 0.0003),
        trunk_rate=1.0 if scratch else 0.5,
        keep=0.0 if keep == SCRATCH or (scratch and keep is None) else keep_weight,
        mix=mix,
        frozen=() if scratch else ("stem", "down4"),
        validate_minutes=validate_minutes,
        bfloat16=bfloat16,
        threads=threads,
    )
    if mix and (len(mix) != len(data) or min(mix) < 0.0 or sum(mix) <= 0.0):
        raise OptionError(f"--mix {' '.join(map(str, mix))}: expected {len(data)} shares, one for each --data")
    network = begin(start if keep in (None, SCRATCH) else kept_checkpoint(keep), NAMES, input, seed)
    begun = None if keep in (None, SCRATCH) else begin(start, NAMES, input, seed).network
    begun = begun if weights is None else earlier(weights, NAMES).network
    print(f"reading {', '.join(data)} …", flush=True)
    teach = teacher_of([find_bundle(name, threads) for name in teacher]) if teacher else None
    examples = load_examples(data, NAMES, input, teach=teach)
    held_back = {spec: load_examples([spec], NAMES, input, validate_pictures, teach) for spec in validation}
    print(
        f"{len(examples)} pictures with {sum(len(e.boxes) for e in examples)} boxes to train on, "
        f"{sum(map(len, held_back.values()))} to validate on",
        flush=True,
    )
    trainer = Trainer(network, examples, held_back, output, settings, begun)
    if resume:
        trainer.resume()
    best = trainer.run()
    if not trainer.ranks.first:
        return
    if not scratch:
        chosen, rows = choose_blend(network.network, load_detector(output / "best.pt"), held_back, blend_loss)
        save_detector(chosen, output / "blended.pt")
        for row in rows:
            print(f"  {row['share']:.0%} of what was learnt: AP50 {row['ap50']:.3f}   AP {row['ap']:.3f}")
    print(
        f"{output / 'best.pt'}: AP50 {best['ap50']:.3f} on the validation pictures, after {best['minutes']:g} minutes"
    )
