"""GLSL of the renderer: colour with baked light, and object id with optical depth."""

VERTEX = """#version 330
in vec3 position; in vec3 normal; in vec2 uv; in vec3 front; in vec3 back; in float id;
uniform mat4 clip_home; uniform vec2 map_scale;
out vec3 at; out vec3 shading; out vec2 texel; out vec2 map_at; out vec3 light_front; out vec3 light_back;
flat out float object;
void main() {
    at = position; shading = normal; texel = uv; map_at = uv * map_scale;
    light_front = front; light_back = back; object = id;
    gl_Position = clip_home * vec4(position, 1.0);
}"""

COLOUR = """#version 330
in vec3 at; in vec3 shading; in vec2 texel; in vec2 map_at; in vec3 light_front; in vec3 light_back;
uniform sampler2D image; uniform sampler2D light_map;
uniform bool has_image, has_map; uniform vec3 tint, emission; uniform float opacity, gloss, exposure;
uniform vec3 eye; uniform vec3 lamp_at[4]; uniform vec3 lamp_power[4];
out vec4 pixel;
void main() {
    vec3 base = tint, glow = emission;
    if (has_image) {
        vec4 t = texture(image, texel);
        if (t.a < 0.5) discard;
        base *= pow(t.rgb, vec3(2.2));
        glow *= pow(t.rgb, vec3(2.2));
    }
    vec3 towards = normalize(eye - at), n = normalize(shading);
    bool facing = dot(n, towards) >= 0.0;
    vec3 light = has_map ? texture(light_map, map_at).rgb : max(facing ? light_front : light_back, 0.0);
    vec3 colour = base * light + glow;
    if (gloss > 0.01) {
        if (!facing) n = -n;
        vec3 mirrored = reflect(-towards, n);
        float grey = dot(light, vec3(0.333));
        for (int i = 0; i < 4; i++) {
            float along = max(dot(mirrored, normalize(lamp_at[i] - at)), 0.0);
            colour += lamp_power[i] * gloss * pow(along, 60.0) * smoothstep(0.05, 0.6, grey);
        }
        colour += gloss * grey * (0.04 + 0.5 * pow(1.0 - max(dot(n, towards), 0.0), 5.0));
    }
    colour *= exposure;
    colour = colour * (2.51 * colour + 0.03) / (colour * (2.43 * colour + 0.59) + 0.14);  // ACES fit, Narkowicz 2015
    pixel = vec4(pow(clamp(colour, 0.0, 1.0), vec3(1.0 / 2.2)), opacity);
}"""

IDENTITY = """#version 330
in vec3 at; in vec2 texel; flat in float object;
uniform sampler2D image; uniform bool has_image; uniform vec3 eye, forward;
out vec2 pixel;
void main() {
    if (has_image && texture(image, texel).a < 0.5) discard;
    pixel = vec2(object, dot(at - eye, forward));
}"""
