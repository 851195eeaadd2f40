"""Models of our own, drawn anew for every number: `edgemap/vase-1` and so on. No catalogue, no licence needed.

Test and validation homes show the few of them that `models.toml` lists for what the libraries have too few of; training
homes show as many more as its `made` says, so that a detector learns what a chair is and not which chairs there are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.bags.backpacks import backpack
from edgemap.simulation.apartment.made.bags.cases import other_luggage
from edgemap.simulation.apartment.made.bags.trolleys import suitcase
from edgemap.simulation.apartment.made.bathroom.basins import basin
from edgemap.simulation.apartment.made.bathroom.toilets import toilet
from edgemap.simulation.apartment.made.beds.beds import bed
from edgemap.simulation.apartment.made.kitchen.microwaves import microwave
from edgemap.simulation.apartment.made.kitchen.ovens import oven
from edgemap.simulation.apartment.made.kitchen.refrigerators import refrigerator
from edgemap.simulation.apartment.made.plants.plants import potted_plant, small_plant
from edgemap.simulation.apartment.made.screens import tv
from edgemap.simulation.apartment.made.seats.chairs import chair
from edgemap.simulation.apartment.made.seats.couches import armchair, corner_couch, couch
from edgemap.simulation.apartment.made.seats.office_chairs import office_chair
from edgemap.simulation.apartment.made.seats.stools import stool
from edgemap.simulation.apartment.made.shapes.placing import centred
from edgemap.simulation.apartment.made.tables.dining_tables import dining_table
from edgemap.simulation.apartment.made.vases import vase
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Mesh

LIBRARY = "edgemap"
# By kind of models.toml.
MAKERS: dict[str, Callable[[np.random.Generator], Mesh]] = {
    "armchair": armchair,
    "backpack": backpack,
    "basin": basin,
    "bed": bed,
    "chair": chair,
    "corner couch": corner_couch,
    "couch": couch,
    "dining table": dining_table,
    "microwave": microwave,
    "office chair": office_chair,
    "oven": oven,
    "potted plant": potted_plant,
    "refrigerator": refrigerator,
    "small plant": small_plant,
    "stool": stool,
    "suitcase": suitcase,
    "toilet": toilet,
    "tv": tv,
    "vase": vase,
}

# Suitcases above this number are other luggage than trolleys, of which validation and test homes show the first ten.
_TROLLEYS = 18

# Kinds whose top other things stand on.
FLAT_TOPS = {"dining table"}


def made(name: str) -> Mesh:
    """`KIND-NUMBER` in metres, x out of its front, y left, z up, origin on the floor at its box's centre.

    The number draws proportions, build and colours. Raises SimulationError for a name of no such kind or number.
    """
    kind, _, digits = name.rpartition("-")
    if kind not in MAKERS or not digits.isdecimal():
        raise SimulationError(f"no furniture model {LIBRARY}/{name}: expected KIND-NUMBER, of {', '.join(MAKERS)}")
    number = int(digits)
    maker = other_luggage if kind == "suitcase" and number > _TROLLEYS else MAKERS[kind]
    return centred(maker(np.random.default_rng([sum(map(ord, kind)), number])))
