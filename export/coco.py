"""COCO's 80 classes as a bundle lists them: which of them can stand on a map of the floor."""

from edgemap.runtime.drives.yolo import COCO_NAMES
from edgemap.runtime.manifest import ClassEntry

# They walk away.
LIVING = frozenset({"person", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"})

# They lie on tables, hang, fly, or are carried: a box's lower edge says nothing of the floor.
NEVER_ON_THE_FLOOR = frozenset(
    """airplane|boat|traffic light|umbrella|handbag|tie|frisbee|skis|snowboard|sports ball|kite|baseball bat
baseball glove|skateboard|surfboard|tennis racket|bottle|wine glass|cup|fork|knife|spoon|bowl|banana|apple|sandwich
orange|broccoli|carrot|hot dog|pizza|donut|cake|laptop|tv|mouse|remote|keyboard|cell phone|microwave|toaster|book|clock
scissors|teddy bear|hair drier|toothbrush""".replace("\n", "|").split("|")
)

CLASSES = tuple(ClassEntry(name=name, mapped=name not in LIVING | NEVER_ON_THE_FLOOR) for name in COCO_NAMES)


def class_entries(count: int) -> tuple[ClassEntry, ...]:
    """The classes of a detector with this many: COCO's for 80, else numbered names, all mapped."""
    return CLASSES if count == len(CLASSES) else tuple(ClassEntry(name=f"class {number}") for number in range(count))
