"""Which feet may stand under which table top."""

from __future__ import annotations

from edgemap.simulation.apartment.made.tables.frames import columns, crosses, hairpins, hoops, slabs, trestles
from edgemap.simulation.apartment.made.tables.legs import legs
from edgemap.simulation.apartment.made.tables.pedestals import pedestal, spider
from edgemap.simulation.apartment.made.tables.table import Feet

# What may stand under a long top, and under one as deep as wide.
FEET_LONG: tuple[Feet, ...] = (
    legs, legs, legs, legs, trestles, columns, slabs, crosses, hoops, hairpins, pedestal, spider,
)  # fmt: skip
FEET_SQUARE: tuple[Feet, ...] = (legs, legs, legs, pedestal, pedestal, pedestal, hairpins, spider, crosses)
