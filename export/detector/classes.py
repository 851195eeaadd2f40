"""What `edgemap-nano` knows: the household classes of COCO that the simulated world can show."""

from edgemap.export.coco import CLASSES as COCO_CLASSES
from edgemap.runtime.manifest import ClassEntry

NAMES = (
    "person", "cat", "dog", "backpack", "suitcase", "chair", "couch", "potted plant", "bed", "dining table", "toilet",
    "tv", "laptop", "microwave", "oven", "sink", "refrigerator", "vase",
)  # fmt: skip

_KNOWN = {entry.name: entry for entry in COCO_CLASSES}


def nano_classes(names: tuple[str, ...] = NAMES) -> tuple[ClassEntry, ...]:
    """Entries of these COCO names; people, pets and what stands on tables are detected, never mapped."""
    return tuple(_KNOWN[name] for name in names)
