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
}
