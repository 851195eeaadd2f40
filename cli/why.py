"""`edgemap why RUN`: how far a run's map can be trusted, and what to do about it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json, last_run, print_json
from edgemap.runtime.step.map_store import saved_map

if TYPE_CHECKING:
    from edgemap.geometry.objects.annotations import MapIdentity


def command(
    run: Annotated[
        tyro.conf.Positional[Path | None],
        arg(metavar="[RUN]", help="A run folder or a map; the newest run in runs/ or here by default."),
    ] = None,
    json: Json = False,
) -> None:
    """Explain a map: good, use with care or not reliable, the likely causes in order, and what to do about each.

    Reads run.json and map.json of a run folder. The gravest cause comes first. Of a saved map without its run it shows
    the verdict of the run that saved it.
    """
    from edgemap.runtime.outputs.verdict.verdict import TITLES, explain, read_record
    from edgemap.runtime.step.map_file import identity_record, load_annotated_map, load_map

    folder = run or last_run()
    if folder.name == "map.json" and (folder.parent / "run.json").is_file():
        folder = folder.parent
    if not (folder / "run.json").is_file():
        identity = load_annotated_map(saved_map(folder))[1].identity
        if json:
            print_json({"map": str(folder)} | identity_record(identity))
        else:
            _print_saved(folder, identity)
        return
    record = read_record(folder / "run.json")
    verdict, steps = explain(record, load_map(folder))
    ended = bool(record.get("finished", True))
    if json:
        document = {"run": str(folder), "ended": ended, "verdict": verdict.document()}
        causes = [
            {
                "cause": step.cause.title,
                "counted": step.counted,
                "evidence": list(step.evidence),
                "do": step.cause.remedy,
                "docs": step.cause.link,
            }
            for step in steps
        ]
        print_json(document | {"causes": causes})
        return
    print(f"{folder}: map: {TITLES[verdict.level]}")
    if not ended:
        print("The run has not ended: it goes on, or it was killed and the map is that of its last save.")
    if any(isinstance(fault, str) for fault in record.get("faults", [])):
        print("The faults of this run have no kinds (an older edgemap recorded them): they are not explained.")
    if verdict.level == "good":
        print("Nothing that was counted speaks against it.")
    for number, step in enumerate(steps, 1):
        if not step.counted and (number == 1 or steps[number - 2].counted):
            print("\nOther faults of the run:")
        print(f"\n{number}. {step.cause.title}")
        for evidence in step.evidence:
            print(f"   seen: {evidence}")
        print(f"   do:   {step.cause.remedy}\n   more: {step.cause.link}")


def _print_saved(place: Path, identity: "MapIdentity | None") -> None:
    """The verdict that a map without its run carries."""
    from edgemap.runtime.outputs.verdict.verdict import TITLES

    if identity is None or identity.level is None:
        print(f"{place}: map: no verdict (an older edgemap, or no run, has saved it)")
        return
    print(f"{place}: map: {TITLES[identity.level]}, by the run that saved it")
    for reason in identity.reasons:
        print(f"   seen: {reason}")
    if identity.reasons:
        print("   do:   see edgemap why RUN, with the folder of that run; merged and scaled maps keep its verdict")
