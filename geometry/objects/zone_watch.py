"""Events of zones: which objects entered one, and which left it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.queries import inside_polygon

# Of stream, for which an object must be in or out before it counts, as a centre on the border wavers; in that time two
# looks are taken.
SETTLED_S = 1.0

Places = dict[tuple[str, str], MapObject]  # by ids of zone and object


@dataclass(frozen=True, slots=True, eq=False)
class ZoneEvent:
    """kind: entered, or left (moved out, or gone from the map). stamp_s: stream time when it was certain."""

    kind: Literal["entered", "left"]
    stamp_s: float
    zone: Zone
    item: MapObject

    def record(self) -> dict[str, object]:
        """The event as HTTP and MQTT send it."""
        x_m, y_m = (round(float(value), 3) for value in self.item.position_m)
        fields: dict[str, object] = {"event_type": self.kind, "zone": self.zone.id, "zone_name": self.zone.name}
        return fields | {"id": self.item.id, "label": self.item.label, "x_m": x_m, "y_m": y_m}


class ZoneWatch:
    """Compares the map with its previous state; objects already in a zone when it is drawn, changed or loaded cause no
    event.
    """

    def __init__(self) -> None:
        self._zones: dict[str, Zone] = {}
        self._inside: Places = {}
        self._pending: dict[tuple[str, str], float] = {}  # since when it is otherwise
        self._looked_s = -math.inf

    def update(self, objects: Sequence[MapObject], zones: Sequence[Zone], stamp_s: float) -> list[ZoneEvent]:
        """The events since the last call."""
        if 0.0 <= stamp_s - self._looked_s < SETTLED_S / 2.0:
            return []
        self._looked_s = stamp_s
        now = {(zone.id, item.id): item for zone in zones for item in inside_polygon(objects, zone.corners_m)}
        by_id = {zone.id: zone for zone in zones}
        stays = {identity for identity, zone in by_id.items() if self._zones.get(identity) == zone}
        self._zones = by_id
        self._inside = {place: item for place, item in self._inside.items() if place[0] in stays}
        self._inside |= {place: item for place, item in now.items() if place[0] not in stays}
        differs = now.keys() ^ self._inside.keys()
        self._pending = {place: self._pending.get(place, stamp_s) for place in differs}
        events = []
        for place in sorted(place for place, since_s in self._pending.items() if stamp_s - since_s >= SETTLED_S):
            del self._pending[place]
            if place in now:
                self._inside[place] = now[place]
                events.append(ZoneEvent("entered", stamp_s, by_id[place[0]], now[place]))
            else:
                events.append(ZoneEvent("left", stamp_s, by_id[place[0]], self._inside.pop(place)))
        self._inside |= {place: now[place] for place in self._inside.keys() & now.keys()}
        return events
