"""A map as a table: one line per object, for spreadsheets and data frames."""

import csv
import io
from collections.abc import Sequence

from edgemap.geometry.map_object import MapObject, radius_m
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.queries import inside_polygon
from edgemap.runtime.step.map_file import object_record

COLUMNS: tuple[str, ...] = (
    "id", "label", "x_m", "y_m", "covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2", "width_m", "height_m",
    "radius_m", "count", "confidence", "first_seen_s", "last_seen_s", "first_seen", "last_seen", "since", "name",
    "confirmed", "corrected", "yaw_rad", "yaw_sigma_rad", "depth_m", "zones",
)  # fmt: skip


def csv_text(objects: Sequence[MapObject], zones: Sequence[Zone] = ()) -> str:
    """`zones`: names of the zones that contain the object's centre, separated by `; `. RFC 4180 with a header line;
    map frame, numbers as in map.json. A text that a spreadsheet would compute has an apostrophe in front, as
    spreadsheets mark texts."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\r\n")
    writer.writeheader()
    for item, record in zip(objects, map(object_record, objects), strict=True):
        del record["labels"], record["history"], record["footprint"], record["earlier"]
        record["corrected"] = " ".join(record.get("corrected", []))
        record["zones"] = "; ".join(zone.name for zone in zones if inside_polygon([item], zone.corners_m))
        (xx, xy), (_, yy) = record.pop("covariance_m2")
        covariance = {"covariance_xx_m2": xx, "covariance_xy_m2": xy, "covariance_yy_m2": yy}
        record |= {name: _text(value) for name, value in record.items() if isinstance(value, str)}
        writer.writerow(record | covariance | {"radius_m": round(radius_m(item), 4)})
    return text.getvalue()


def _text(value: str) -> str:
    """Source: OWASP, CSV injection."""
    return f"'{value}" if value.startswith(("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")) else value
