"""GLSL of the renderer. One source for all kinds of surface: `source` cuts out what a kind does not need.

Mesa draws on the processor, where every fragment counts: matte, plain surfaces get their colour at the corners, only
glossy ones look for highlights, only those with holes may discard. Colours are kept as square roots (textures in,
pixels out) since gamma curves cost more than everything else; `DISPLAY` turns square roots into sRGB afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LAMPS = 4


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
    head = "#version 330\n" + "".join(f"#define {name}\n" for name, on in flags.items() if on)
    return head + _VERTEX, head + _FRAGMENT


_VERTEX = """
in vec3 position; in vec2 uv; in vec3 tint;
uniform mat4 clip_home; uniform vec3 eye, glow;
#if defined(GLOSSY) || !defined(LIGHT_MAP)
in vec3 normal;
#endif
#ifdef LIGHT_MAP
in vec2 map_uv; out vec2 map_at;
#else
in vec3 day_front, day_back, lamp_front, lamp_back;
uniform float day, lamp;
#endif
out vec3 base; out vec2 texel;
#ifdef GLOSSY
out vec3 at, shading; out float grey;
#endif
void main() {
    base = tint * tint; texel = uv;
#ifdef LIGHT_MAP
    map_at = map_uv;
#else
    // Which side is seen, decided at the corner and with a margin, so that round shapes keep their rim lit.
    float side = smoothstep(-0.3, 0.0, dot(normal / 127.0, normalize(eye - position)));
    vec3 light = max(day * mix(day_back, day_front, side) + lamp * mix(lamp_back, lamp_front, side), 0.0);
    base = base * light + glow;
#endif
#ifdef GLOSSY
    at = position; shading = normal / 127.0;
#ifndef LIGHT_MAP
    grey = dot(light, vec3(0.333));
#endif
#endif
    gl_Position = clip_home * vec4(position, 1.0);
}"""

_FRAGMENT = """
in vec3 base; in vec2 texel;
uniform float exposure, slot;
uniform sampler2D image, light_map;
#ifdef LIGHT_MAP
in vec2 map_at;
#endif
#ifdef GLOSSY
in vec3 at, shading; in float grey;
uniform vec3 eye; uniform float gloss; uniform int lamps; uniform vec3 lamp_at[4], lamp_power[4];
#endif
out vec4 pixel;
void main() {
    vec3 colour = base;
#ifdef IMAGE
    vec4 t = texture(image, texel);
#ifdef HOLES
    if (t.a < 0.5) discard;
#endif
    colour *= t.rgb * t.rgb;
#endif
#ifdef LIGHT_MAP
    vec3 light = texture(light_map, map_at).rgb;
    colour *= light;
#endif
#ifdef GLOSSY
#ifdef LIGHT_MAP
    float bright = dot(light, vec3(0.333));
#else
    float bright = grey;
#endif
    vec3 towards = normalize(eye - at), n = normalize(shading);
    float facing = dot(n, towards);
    if (facing < 0.0) { n = -n; facing = -facing; }
    vec3 mirrored = 2.0 * facing * n - towards;
    vec3 shine = vec3(0.0);
    for (int i = 0; i < lamps; i++) {
        vec3 way = lamp_at[i] - at;
        float along = max(dot(mirrored, way), 0.0);
        // The 64th power of the cosine, without a root.
        along *= along / dot(way, way);
        along *= along; along *= along; along *= along; along *= along;
        shine += lamp_power[i] * along * along;
    }
    float edge = 1.0 - facing, edge2 = edge * edge;
    // Lights mirror the better the flatter one looks; so does the room.
    shine *= clamp(bright * 2.0, 0.0, 1.0) * (0.12 + 0.88 * edge2);
    colour += gloss * (shine + bright * (0.04 + 0.5 * edge2 * edge2 * edge));
#endif
    colour *= exposure;
    // ACES fit, Narkowicz 2015.
    colour = colour * (2.51 * colour + 0.03) / (colour * (2.43 * colour + 0.59) + 0.14);
    pixel = vec4(sqrt(clamp(colour, 0.0, 1.0)).bgr, slot);
}"""

SILHOUETTE = (
    """#version 330
in vec3 position; in vec2 uv; uniform mat4 clip_home; out vec2 texel;
void main() { texel = uv; gl_Position = clip_home * vec4(position, 1.0); }""",
    """#version 330
in vec2 texel; uniform sampler2D image; uniform bool holes; out float pixel;
void main() { if (holes && texture(image, texel).a < 0.5) discard; pixel = 1.0; }""",
)

# What stands on the floor darkens it: an ellipse, soft at its edge.
SHADOW = (
    """#version 330
in vec2 corner; uniform mat4 clip_home; uniform vec4 place; out vec2 at;
void main() { at = corner; gl_Position = clip_home * vec4(place.xy + corner * place.zw, 0.012, 1.0); }""",
    """#version 330
in vec2 at; out vec4 pixel;
void main() {
    float inside = clamp(1.0 - dot(at, at), 0.0, 1.0);
    pixel = vec4(0.0, 0.0, 0.0, 0.75 * inside * inside);
}""",
)

WALLS = (
    """#version 330
in vec3 position; uniform mat4 clip_home;
void main() { gl_Position = clip_home * vec4(position, 1.0); }""",
    """#version 330
void main() {}""",
)

# Square root of display-linear light to sRGB's gamma, both 0..255.
DISPLAY = np.round(255.0 * (np.arange(256) / 255.0) ** (2.0 / 2.2)).astype(np.uint8)
