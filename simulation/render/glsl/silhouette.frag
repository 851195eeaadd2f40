in vec2 texel; uniform sampler2D image; uniform bool holes; out float pixel;
void main() { if (holes && texture(image, texel).a < 0.5) discard; pixel = 1.0; }
