"""Finding the robot in a saved map by its objects."""

from collections.abc import Generator, Sequence

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, AlignmentRule, aligning, realigned

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
    """Tries to align the run's own map with a saved one whenever it has grown, a bounded unit of work in each frame.

    own: the map to build until then; its ids go on after the saved ones. alignment: None until then. reason: why not.
    """

    def __init__(self, saved: Sequence[MapObject], association: AssociationRule, registration: AlignmentRule) -> None:
        self.saved = list(saved)
        self.own: FloorMap = FloorMap.after(saved, association)
        self._registration = registration
        self.alignment: Alignment | None = None
        self.reason = "no object seen yet"
        self._count = self._frames = 0
        self._work: Generator[None, None, Alignment] | None = None

    def align(self) -> Alignment | None:
        """The alignment, in the one call that finds it; None before and after."""
        if self.alignment is not None or not self._is_due():
            return None
        if self._work is None:
            self._work = aligning(self.saved, self.own.objects(), self._registration)
        try:
            next(self._work)
        except StopIteration as end:
            self._work = None
            self.alignment = self._as_it_is_now(end.value)
        except AlignmentError as error:
            self._work, self.reason = None, str(error)
        return self.alignment

    def _as_it_is_now(self, found: Alignment) -> Alignment | None:
        """The own map has grown and moved since the work began."""
        try:
            return realigned(found, self.saved, self.own.objects(), self._registration)
        except AlignmentError as error:
            self.reason = str(error)
            return None

    def _is_due(self) -> bool:
        """While there is work, and when more objects are known than at the last try, or the same ones better."""
        self._frames += 1
        count = len(self.own.objects())
        if self._work is not None:
            return True
        if count <= self._count and self._frames < RETRY_AFTER:
            return False
        self._count, self._frames = count, 0
        return count > 0
