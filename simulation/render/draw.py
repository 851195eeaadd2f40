"""Draw list of a picture: placed batches, and the bytes that identify their objects."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.batches import Batch
from edgemap.simulation.render.canvas import Meshes
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import ROOM_ID

# One byte per pixel tells the objects of one picture apart.
_MOST_OBJECTS = 254


@dataclass(frozen=True, slots=True)
class Draw:
    """One batch to draw: from which meshes, with which slot in the id byte, and where it stands.

    clip: (4, 4) from the batch's frame to the picture; eye: (3,) of the camera in that frame, metres. home: (4, 4) from
    that frame to the home, for what moves.
    """

    meshes: Meshes
    batch: Batch
    slot: int
    clip: Array
    eye: Array
    home: Array | None = None


class Slots:
    """The ids of one picture and the bytes that stand for them; 0 is the room."""

    def __init__(self) -> None:
        self._names, self._slots = [ROOM_ID], {ROOM_ID: 0}

    def of(self, id_: int) -> int:
        """The byte that represents an id in the picture; ids beyond the limit get the room's."""
        if id_ not in self._slots:
            if len(self._names) > _MOST_OBJECTS:
                return 0
            self._slots[id_] = len(self._names)
            self._names.append(id_)
        return self._slots[id_]

    def ids(self, slots: NDArray[np.uint8]) -> NDArray[np.int32]:
        """The ids that bytes stand for."""
        return np.array(self._names, dtype=np.int32)[slots]
