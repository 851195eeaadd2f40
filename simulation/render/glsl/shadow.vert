in vec2 corner; uniform mat4 clip_home; uniform vec4 place; out vec2 at;
void main() { at = corner; gl_Position = clip_home * vec4(place.xy + corner * place.zw, 0.012, 1.0); }
