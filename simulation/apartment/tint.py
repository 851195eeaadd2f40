"""One model in many colours: how a single piece differs from its model's own materials."""

import colorsys
from dataclasses import dataclass, replace

import numpy as np

from edgemap.simulation.render.mesh import Material


@dataclass(frozen=True, slots=True)
class Tint:
    """hue: turn of plain colours, in circles. cast: linear factors (3,) on everything, textures too."""

    hue: float = 0.0
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def on(self, material: Material) -> Material:
        """The material in this tint; what glows or lets light through keeps its colour."""
        if max(material.emission) > 0.0 or material.opacity < 0.99:
            return material
        red, green, blue = material.colour
        if material.texture is None and self.hue:
            hue, lightness, saturation = colorsys.rgb_to_hls(*np.clip(material.colour, 0.0, 1.0))
            red, green, blue = colorsys.hls_to_rgb((hue + self.hue) % 1.0, lightness, saturation)
        r, g, b = (min(channel * cast, 1.2) for channel, cast in zip((red, green, blue), self.cast, strict=True))
        return replace(material, colour=(r, g, b))


def draw_tint(rng: np.random.Generator, strength: float) -> Tint | None:
    """A tint; None for about half of the pieces. strength: 1 for painted and woven pieces, near 0 for plants."""
    if rng.random() < 0.5:
        return None
    brightness = float(np.exp(rng.normal(0.0, 0.28 * strength)))
    cast = brightness * np.exp(rng.normal(0.0, 0.14 * strength, 3))
    r, g, b = (float(channel) for channel in np.clip(cast, 0.45, 1.5))
    return Tint(float(rng.uniform(-0.5, 0.5)) * strength, (r, g, b))
