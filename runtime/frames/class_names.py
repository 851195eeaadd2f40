"""Names of a detector's classes: COCO's by number, those of a file, and which of them a map of a home shows."""

from pathlib import Path

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.observations.detections import MOVER_LABELS
from edgemap.geometry.observations.occlusion import WORKTOP_LABELS
from edgemap.runtime.frames.reading import one_line, read_text
from edgemap.runtime.frames.yaml_file import read_yaml

# The 80 class names of COCO, in the order every YOLO numbers them.
COCO_NAMES = tuple(
    """person|bicycle|car|motorcycle|airplane|bus|train|truck|boat|traffic light|fire hydrant|stop sign|parking meter
bench|bird|cat|dog|horse|sheep|cow|elephant|bear|zebra|giraffe|backpack|umbrella|handbag|tie|suitcase|frisbee|skis
snowboard|sports ball|kite|baseball bat|baseball glove|skateboard|surfboard|tennis racket|bottle|wine glass|cup|fork
knife|spoon|bowl|banana|apple|sandwich|orange|broccoli|carrot|hot dog|pizza|donut|cake|chair|couch|potted plant|bed
dining table|toilet|tv|laptop|mouse|remote|keyboard|cell phone|microwave|oven|toaster|sink|refrigerator|book|clock
vase|scissors|teddy bear|hair drier|toothbrush""".replace("\n", "|").split("|")
)


def _categories() -> tuple[str, ...]:
    """Names by COCO's numbers of categories, as detectors with 91 outputs count: 0, the background, and ten more have
    none."""
    names, unused = iter(COCO_NAMES), {0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83}
    return tuple(f"unused {number}" if number in unused else next(names) for number in range(91))


COCO_91 = _categories()

# They lie on tables, hang, fly, or are carried: the box's lower edge is not on the floor.
NEVER_ON_THE_FLOOR = WORKTOP_LABELS.union(
    """airplane|boat|traffic light|umbrella|handbag|tie|frisbee|skis|snowboard|sports ball|kite|baseball bat
baseball glove|skateboard|surfboard|tennis racket|bottle|tv|clock|teddy bear|hair drier""".replace("\n", "|").split("|")
)

# They stand in streets. A map of a home has none; `--classes` may name them all the same.
OUTDOORS = frozenset({"car", "motorcycle", "bus", "train", "truck", "fire hydrant", "stop sign", "parking meter"})


def is_mapped(name: str) -> bool:
    """Whether a class goes on the map by default: none of COCO's that live, lie on tables or stand in streets."""
    return name not in MOVER_LABELS | NEVER_ON_THE_FLOOR | OUTDOORS and not name.startswith("unused ")


def read_class_names(path: Path, error: type[EdgemapError]) -> tuple[str, ...]:
    """Names by class number: `names` of a data.yaml (a list, or numbers to names), or a text file with one a line.

    Raises `error` where there are none.
    """
    if path.suffix in (".yaml", ".yml"):
        document = read_yaml(path, error)
        names = document.get("names") if isinstance(document, dict) else None
        if isinstance(names, dict):
            names = list(names.values()) if list(names) == [str(i) for i in range(len(names))] else None
    else:
        names = [line.strip() for line in read_text(path, error).splitlines() if line.strip()]
    shown = [one_line(name, 100) if isinstance(name, str) else "" for name in names] if isinstance(names, list) else []
    if not shown or not all(shown):
        raise error(f"{path}: no class names: a data.yaml has `names: [chair, …]`, a text file one name a line")
    return tuple(shown)
