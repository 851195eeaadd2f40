in vec3 position; in vec2 uv; uniform mat4 clip_home; out vec2 texel;
void main() { texel = uv; gl_Position = clip_home * vec4(position, 1.0); }
