// One frame: draw a quad over a target of the dome master's size.

uniform sampler2D dither; // 64 x 64 thresholds 0..1 of blue noise (red channel); nearest, repeat
uniform float strength;   // 0 leaves the content as it is, 1 compensates in full
uniform float levels;     // 255.0 for an 8-bit target: dithered; 0.0 for one of more bits or float

in vec2 place;            // on the dome master, 0..1; (0, 0) is the outer corner of its first pixel
out vec4 shown;

void main() {
    int size = textureSize(content, 0).x;
    ivec2 pixel = ivec2(floor(place * float(size)));
    vec4 asked = texelFetch(content, pixel, 0);
    shown = asked;
    vec2 uv = (vec2(pixel) + 0.5) / float(size);
    if (is_protected(uv)) return;
    vec3 full = vec3(0.0);
    if (is_lit(pixel, size)) {
        float terms[TERMS];
        terms_at(direction_at(from_middle(pixel, size)), terms);
        full = encode(direct_light(decode(asked.rgb), uv, terms));
    }
    vec3 mixed = mix(asked.rgb, full, strength);
    if (levels > 0.0) {
        float threshold = texelFetch(dither, pixel % textureSize(dither, 0), 0).r;
        mixed = min(floor(mixed * levels + threshold) / levels, 1.0);
    }
    shown.rgb = mixed;
}
