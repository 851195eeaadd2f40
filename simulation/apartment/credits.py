"""Credits of the furniture: the README that accompanies every rendering."""

from collections.abc import Iterable

from edgemap.simulation.apartment.furniture import LICENCES, Model

_LICENCE_LINKS = {
    "CC0 1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC BY 3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC BY 3.0 US": "https://creativecommons.org/licenses/by/3.0/us/",
}
DRIVE = """# A simulated drive

A rendered drive of a small robot through a furnished home, with exact truth: the pictures (or `video.mp4`),
`camera.yaml`, `poses.tum` (base poses from the first one), wheel odometry, and boxes and objects where the layout has
them."""
PICTURES = """# Rendered pictures with labels

Unrelated views of furnished homes: `images/`, YOLO text labels with COCO's class numbers in `labels/`, and
`boxes.json` with the visible share and the whole box of everything in view."""


def credits_text(models: Iterable[Model], command: str, about: str = DRIVE) -> str:
    """Markdown: description, origin, and each distinct model with creator, library and licence."""
    rows = {
        f"| {m.name} (`{m.key}`) | {m.creator} | {m.library} | [{licence}]({_LICENCE_LINKS[licence]}) |"
        for m in models
        if (licence := LICENCES.get(m.library))
    }
    return f"""{about}
Nothing in it was photographed or recorded. Made with

    {command}

Floors, walls, rugs, pictures, light, and all furniture that is not listed here are the project's own. The rest of the
furniture comes from Sweet Home 3D's libraries
(Debian package `sweethome3d-furniture`); the models were scaled, tinted, placed, lit and rendered into pictures:

| model | creator | library | licence |
| --- | --- | --- | --- |
{chr(10).join(sorted(rows))}

Under these licences the pictures may be shared and changed as long as the creators above are credited.
"""
