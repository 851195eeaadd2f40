"""`edgemap why RUN`: how far a run's map can be trusted, and what to do about it."""

from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json, last_run, print_json


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
    from edgemap.runtime.outputs.verdict.verdict import TITLES, explain, read_run, saved_line
    from edgemap.runtime.step.map_file import identity_record, load_annotated_map
    from edgemap.runtime.step.map_store import saved_map

    folder = run or last_run()
    if not (folder / "run.json").is_file():
        identity = load_annotated_map(saved_map(folder))[1].identity
        if json:
            print_json({"map": str(folder)} | identity_record(identity))
        else:
            print(f"{folder}: {saved_line(identity)}")
        return
    record, objects = read_run(folder)
    verdict, steps = explain(record, objects)
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
