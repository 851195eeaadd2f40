in vec3 position; uniform mat4 clip_home;
void main() { gl_Position = clip_home * vec4(position, 1.0); }
