"""COCO's 80 classes as a bundle lists them: which of them a map of a home's floor holds by default."""

import msgspec

from edgemap.runtime.inputs.drives.yolo import COCO_NAMES
from edgemap.runtime.network.manifest import ClassEntry, DetectorSpec

# They walk away.
LIVING = frozenset({"person", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"})

# They lie on tables, hang, fly, or are carried: a box's lower edge says nothing of the floor.
NEVER_ON_THE_FLOOR = frozenset(
    """airplane|boat|traffic light|umbrella|handbag|tie|frisbee|skis|snowboard|sports ball|kite|baseball bat
baseball glove|skateboard|surfboard|tennis racket|bottle|wine glass|cup|fork|knife|spoon|bowl|banana|apple|sandwich
orange|broccoli|carrot|hot dog|pizza|donut|cake|laptop|tv|mouse|remote|keyboard|cell phone|microwave|toaster|book|clock
scissors|teddy bear|hair drier|toothbrush""".replace("\n", "|").split("|")
)

# They stand in streets. A map of a home has none; `--classes` may name them all the same.
OUTDOORS = frozenset({"car", "motorcycle", "bus", "train", "truck", "fire hydrant", "stop sign", "parking meter"})

CLASSES = tuple(ClassEntry(name=name, mapped=name not in LIVING | NEVER_ON_THE_FLOOR | OUTDOORS) for name in COCO_NAMES)


def class_entries(count: int) -> tuple[ClassEntry, ...]:
    """The classes of a detector with this many: COCO's for 80, else numbered names, all mapped."""
    return CLASSES if count == len(CLASSES) else tuple(ClassEntry(name=f"class {number}") for number in range(count))


def of_home(detector: DetectorSpec) -> DetectorSpec:
    """Maps by default the classes of a COCO detector that occur in homes; returns any other detector unchanged."""
    if tuple(entry.name for entry in detector.classes) != COCO_NAMES:
        return detector
    return msgspec.structs.replace(detector, classes=CLASSES)
