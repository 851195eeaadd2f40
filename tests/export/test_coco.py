from edgemap.export.adopt import CLASSES, class_entries
from edgemap.runtime.frames.class_names import COCO_NAMES, LIVING, NEVER_ON_THE_FLOOR


def test_every_excluded_name_is_a_class():
    assert set(COCO_NAMES) > LIVING | NEVER_ON_THE_FLOOR


def test_furniture_is_mapped_and_people_pets_and_cups_are_not():
    mapped = {entry.name for entry in CLASSES if entry.mapped}
    assert {"chair", "couch", "potted plant", "bed", "dining table", "toilet", "refrigerator", "vase"} <= mapped
    assert not {"person", "cat", "dog", "cup", "book", "tv"} & mapped  # a tv stands on something, or hangs


def test_other_numbers_of_classes_are_numbered():
    assert [entry.name for entry in class_entries(2)] == ["class 0", "class 1"]
