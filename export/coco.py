"""COCO's 80 detection classes, official spelling, in the order in which YOLO networks number them."""

from edgemap.runtime.bundle import ClassEntry

_TEXT = """
    person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
    parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella,
    handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard,
    surfboard, tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange,
    broccoli, carrot, hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv,
    laptop, mouse, remote, keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase,
    scissors, teddy bear, hair drier, toothbrush
"""
NAMES = tuple(" ".join(name.split()) for name in _TEXT.split(","))

# People and animals walk away: detected, never mapped.
NEVER_MAPPED = frozenset(
    {"person", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"}
)

CLASSES = tuple(ClassEntry(name=name, mapped=name not in NEVER_MAPPED) for name in NAMES)


def class_entries(count: int) -> tuple[ClassEntry, ...]:
    """The classes of a detector with this many: COCO's for 80, else numbered names, all mapped."""
    return CLASSES if count == len(CLASSES) else tuple(ClassEntry(name=f"class {number}") for number in range(count))
