"""Hostile names: any bytes and letters as file names, labels, ids and zones, through every text that is written."""

import csv
import json
import os
import xml.etree.ElementTree as ElementTree
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml

from edgemap.bridges.fleet.network import NAME, checked_name
from edgemap.bridges.mqtt.sink import topic_level
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.reading import library_path, one_line, printable
from edgemap.runtime.inputs.cameras.pictures import open_folder
from edgemap.runtime.outputs.mapfiles.drawing import DrawnMap, map_svg
from edgemap.runtime.outputs.mapfiles.geojson import geojson_text
from edgemap.runtime.outputs.mapfiles.nav2 import vector_text
from edgemap.runtime.outputs.mapfiles.table import csv_text
from edgemap.runtime.step.map_file import map_document, read_map
from edgemap.view.report.document import ReportContent, report_document
from edgemap.view.report.history import History
from edgemap.view.report.page import report_page
from reliability.parts import PartReport
from reliability.workers import INPUTS, ReaderCase, examine

PIECES = (
    "chair", "zone", "-1", "=1+1", "@SUM", "<script>", "</svg>", "&amp;", "\"'", "`", "$(id)", "%s", "{0}", "..", "/",
    "#+", "\\", ";", ",", "\t", "\n", "\r\n", "\0", "\x1b[31m", "\u202e", "\u200b", "\ufeff", "é", "ß", "ﷺ", "🪑",
    "\U0010ffff",
    "\ud800", "\udcff", "a" * 300, "9" * 200, "null", "true", "~", "-", ": ", "- ", "!!python", "*", "?", "|", "%00",
)  # fmt: skip


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 names for every writer. out: failing inputs are kept here."""
    return examine(cases, seed, max(1, round(INPUTS * share)), out)


def cases(scratch: Path) -> list[ReaderCase]:
    """Paths on their way to libraries; names in every format that we write, read back."""
    return [ReaderCase("paths", _path, _use_path), ReaderCase("names in files", _map, _use_map)]


def text(random: Random) -> str:
    """Pieces that some format means something by."""
    return "".join(random.choice(PIECES) for _ in range(random.randint(1, 4)))


def _path(random: Random) -> bytes:
    if random.random() < 0.5:
        return bytes(
            random.choice(b"\x01\x1b az./\xff\xc3\xa9\xed\xa0\x80\xf0\x9f") for _ in range(random.randint(1, 40))
        )
    return text(random).encode("utf-8", "surrogatepass")[:200]


def _use_path(folder: Path, data: bytes) -> None:
    name = os.fsdecode(data)
    for shown in (printable(name), one_line(name)):
        assert shown.isprintable(), "a name that a terminal would act on"
    assert not any(letter in topic_level(name) for letter in "+#/\0")
    with suppress(PublishError):
        assert NAME.fullmatch(checked_name(name, "robot"))
    assert os.fsencode(library_path(name)) == data
    open_folder(folder / name.replace("\0", "0"), name, None, None)


def _map(random: Random) -> bytes:
    """A map with such names, as JSON that may hold what no map may."""
    objects = [
        MapObject(
            text(random), text(random), np.array([random.uniform(-5, 5), random.uniform(-5, 5)]), np.eye(2) * 0.01,
            0.5, 0.9, 5, 0.9, 0.0, 1.0, (), {text(random): 0.5}, text(random),
        )
        for _ in range(random.randint(0, 4))
    ]  # fmt: skip
    clean = random.random() < 0.8
    if clean:
        objects = [replace(item, **{field: _clean(getattr(item, field)) for field in ("id", "label", "name")},
                           labels={_clean(label): 0.5 for label in item.labels}) for item in objects]  # fmt: skip
    zones = tuple(Zone(_clean(text(random)), _clean(text(random))[:80], ((0, 0), (1, 0), (1, 1))) for _ in range(2))
    return json.dumps(map_document(objects, Annotations(zones))).encode()


def _clean(name: str) -> str:
    """Without what no map may hold, most of the time past the reader."""
    kept = "".join(letter for letter in name if letter.isprintable())[:80]
    return kept or "x"


def _use_map(folder: Path, data: bytes) -> None:
    objects, annotations = read_map(data, "a map")
    zones = annotations.zones
    rows = list(csv.DictReader(csv_text(objects).splitlines()))
    assert len(rows) == len(objects)
    assert not any(row[name].startswith(("=", "+", "-", "@")) for row in rows for name in ("id", "label", "name"))
    features = json.loads(geojson_text(objects, zones=zones))["features"]
    assert len({feature["id"] for feature in features if isinstance(feature["id"], str)}) == len(features)
    shapes: Any = yaml.safe_load(vector_text(objects))["vector_object_server"]["ros__parameters"].get("shapes", [])
    assert len(set(shapes)) == len(objects)
    drawing = ElementTree.fromstring(map_svg(DrawnMap(objects, zones=zones)))
    assert not [part.tag for part in drawing.iter() if part.tag == "script"]
    about = {"camera": text(Random(len(data))), "marks": {}}
    page = report_page(report_document(ReportContent(about, {}, objects, History(), annotations=annotations)))
    assert page.count("<script") == 2
