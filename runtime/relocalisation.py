"""Finding the robot in a saved map by its objects."""

from __future__ import annotations

from collections.abc import Sequence

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, AlignmentRule, align

RETRY_AFTER = 50  # frames after which the same number of objects is worth another try


class NoRelocalisation:
    """The map's frame is the run's own."""

    own: FloorMap | None = None
    saved: Sequence[MapObject] = ()
    alignment: Alignment | None = None
    reason = "no saved map"

    def align(self) -> Alignment | None:
        """Never finds another frame."""
        return None


class Relocaliser(NoRelocalisation):
    """Tries to align the run's own map with a saved one whenever it has grown.

    own: the map to build until then; its ids go on after the saved ones. alignment: None until then. reason: why not.
    """

    def __init__(self, saved: Sequence[MapObject], association: AssociationRule, registration: AlignmentRule) -> None:
        self.saved = list(saved)
        self.own: FloorMap = FloorMap.after(saved, association)
        self._registration = registration
        self.alignment: Alignment | None = None
        self.reason = "no object seen yet"
        self._count = self._frames = 0

    def align(self) -> Alignment | None:
        """The alignment, in the one call that finds it; None before and after."""
        if self.alignment is not None or not self._is_due(len(objects := self.own.objects())):
            return None
        try:
            self.alignment = align(self.saved, objects, self._registration)
        except AlignmentError as error:
            self.reason = str(error)
        return self.alignment

    def _is_due(self, count: int) -> bool:
        """When more objects are known than at the last try, or the same ones better."""
        self._frames += 1
        if count <= self._count and self._frames < RETRY_AFTER:
            return False
        self._count, self._frames = count, 0
        return count > 0
