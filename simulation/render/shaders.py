"""The renderer's GLSL, of glsl/. One source for all kinds of surface: `source` cuts out what a kind does not need.

Mesa draws on the processor, where every fragment counts: matte, plain surfaces get their colour at the corners, only
glossy ones look for highlights, only those with holes may discard. Colours are kept as square roots (textures in,
pixels out) since gamma curves cost more than everything else; `DISPLAY` turns square roots into sRGB afterwards.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

LAMPS = 4
# Square root of display-linear light to sRGB's gamma, both 0..255.
DISPLAY = np.round(255.0 * (np.arange(256) / 255.0) ** (2.0 / 2.2)).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class SurfaceKind:
    """What a surface needs of the shader. light_map: lit by a texture, else at its corners."""

    light_map: bool
    image: bool
    holes: bool
    glossy: bool


def source(kind: SurfaceKind) -> tuple[str, str]:
    """Vertex and fragment shader of a kind of surface."""
    flags = {"LIGHT_MAP": kind.light_map, "IMAGE": kind.image, "HOLES": kind.holes, "GLOSSY": kind.glossy}
    return shader("surface", "".join(f"#define {name}\n" for name, on in flags.items() if on))


def shader(name: str, head: str = "") -> tuple[str, str]:
    """Vertex and fragment shader glsl/NAME. head: put before both."""
    folder = Path(__file__).with_name("glsl")
    vertex, fragment = ((folder / f"{name}.{kind}").read_text() for kind in ("vert", "frag"))
    return f"#version 330\n{head}{vertex}", f"#version 330\n{head}{fragment}"
