// What stands on the floor darkens it: an ellipse, soft at its edge.
in vec2 at; out vec4 pixel;
void main() {
    float inside = clamp(1.0 - dot(at, at), 0.0, 1.0);
    pixel = vec4(0.0, 0.0, 0.0, 0.75 * inside * inside);
}
