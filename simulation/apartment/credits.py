"""Who made the furniture that a room shows: the README that goes with every shipped rendering."""

from __future__ import annotations

from edgemap.simulation.apartment.apartment import Apartment

_LICENCE_LINKS = {
    "CC0 1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC BY 3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC BY 3.0 US": "https://creativecommons.org/licenses/by/3.0/us/",
}


def credits_text(apartment: Apartment, command: str) -> str:
    """Markdown: how the drive was made, and each distinct model with creator, library and licence."""
    rows = sorted(
        {
            f"| {m.name} (`{m.key}`) | {m.creator} | {m.library} | [{m.licence}]({_LICENCE_LINKS[m.licence]}) |"
            for m in (item.model for item in apartment.furniture)
        }
    )
    return f"""# A simulated drive

A rendered drive of a small robot through one furnished room, with exact truth: `video.mp4` (or `images/`),
`camera.yaml`, `poses.tum` (base poses from the first one), `boxes.json`, `objects.json` and `wheel.csv`.
Nothing in it was photographed or recorded. Made with

    {command}

Floors, walls, rug, painting and light are the project's own. The furniture comes from Sweet Home 3D's libraries
(Debian package `sweethome3d-furniture`); the models were scaled, placed, lit and rendered into pictures:

| model | creator | library | licence |
| --- | --- | --- | --- |
{chr(10).join(rows)}

Under these licences the pictures may be shared and changed as long as the creators above are credited.
"""
