"""A map as a table: one line per object, for spreadsheets and data frames."""

import csv
import io
from collections.abc import Sequence

from edgemap.geometry.objects.map_object import MapObject, radius_m
from edgemap.runtime.map_file import map_document

COLUMNS = (
    "id", "label", "x_m", "y_m", "covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2", "width_m", "height_m",
    "radius_m", "count", "confidence", "first_seen_s", "last_seen_s", "name", "confirmed",
)  # fmt: skip


def csv_text(objects: Sequence[MapObject]) -> str:
    """RFC 4180 with a header line; map frame, numbers as in map.json."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\r\n")
    writer.writeheader()
    for item, record in zip(objects, map_document(list(objects))["objects"], strict=True):
        del record["labels"]
        (xx, xy), (_, yy) = record.pop("covariance_m2")
        own = {"covariance_xx_m2": xx, "covariance_xy_m2": xy, "covariance_yy_m2": yy}
        writer.writerow(record | own | {"radius_m": round(radius_m(item), 4)})
    return text.getvalue()
