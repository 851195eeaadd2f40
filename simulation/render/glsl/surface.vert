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
}
