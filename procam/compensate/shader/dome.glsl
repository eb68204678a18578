// Shared by all programs: direction of a pixel on the dome, its light, and the limits of its light.
//
// All textures are stored row 0 first, as files are, and `pixel` counts from the first row of the dome master.
// Front is at its last row, the audience's left at its first column.

uniform sampler2D content;    // N x N, encoded, 1.0 the reference white; nearest
uniform sampler2D spread;     // M x M, float; linear, clamp to edge, as all fields
uniform sampler2D lo;         // least direct light: black of the projectors
uniform sampler2D hi;         // most direct light
uniform sampler2D ambient;    // light of the room's own lamps
uniform sampler2D gain;       // content is multiplied by it (red channel)
uniform sampler2D coverage;   // by the projectors (red channel)
uniform sampler2D protection; // red above 0.5 where the content stays as it is; nearest
uniform int transfer;         // of the content: 0 linear, 1 sRGB, 2 a power
uniform float exponent;       // of that power, such as 2.4
uniform float top;            // largest value of the target: 1.0 for integers

#ifdef LIVE
uniform sampler2D numbers;    // 9 x 1, float; nearest
vec3 number(int term) { return texelFetch(numbers, ivec2(term, 0), 0).rgb; }
#else
uniform vec3 numbers[9];      // a row of track.csv: (R, G, B) of each term
vec3 number(int term) { return numbers[term]; }
#endif

const float HALF_PI = 1.5707963267948966;
const int TERMS = 9;

vec3 decode(vec3 encoded) {
    if (transfer == 0) return encoded;
    if (transfer == 2) return pow(max(encoded, 0.0), vec3(exponent));
    vec3 curve = pow((max(encoded, 0.0) + 0.055) / 1.055, vec3(2.4));
    return mix(curve, encoded / 12.92, vec3(lessThanEqual(encoded, vec3(0.04045))));
}

vec3 encode(vec3 linear) {
    if (transfer == 0) return linear;
    vec3 positive = max(linear, 0.0);
    if (transfer == 2) return pow(positive, vec3(1.0 / exponent));
    vec3 curve = 1.055 * pow(positive, vec3(1.0 / 2.4)) - 0.055;
    return mix(curve, positive * 12.92, vec3(lessThanEqual(positive, vec3(0.0031308))));
}

// Place on the dome master from its middle, 1 at the rim: (right, down).
vec2 from_middle(ivec2 pixel, int size) { return vec2(2 * pixel + 1 - size) / float(size); }

// Unit direction: x to the front, y to the audience's left, z to the pole. Equidistant, 180 degrees.
vec3 direction_at(vec2 place) {
    float radius = length(place), theta = radius * HALF_PI;
    float scale = radius > 0.0 ? sin(theta) / radius : HALF_PI;
    return vec3(place.y * scale, -place.x * scale, cos(theta));
}

void terms_at(vec3 d, out float terms[TERMS]) {
    terms[0] = 1.0;
    terms[1] = d.x;
    terms[2] = d.y;
    terms[3] = d.z;
    terms[4] = d.x * d.y;
    terms[5] = d.y * d.z;
    terms[6] = d.x * d.z;
    terms[7] = d.x * d.x - d.y * d.y;
    terms[8] = d.z * d.z;
}

// Whether a bilinear sample of the coverage is above 0, in integers: a texture filter rounds its
// weights, which would darken or light pixels at the border.
bool is_lit(ivec2 pixel, int size) {
    int nodes = textureSize(coverage, 0).x;
    ivec2 at = (2 * pixel + 1) * nodes + size; // in 1/(2 size) of a node, one node on: never below 0
    ivec2 low = at / (2 * size) - 1;
    ivec2 between = ivec2(greaterThan(at - (low + 1) * 2 * size, ivec2(0)));
    ivec2 first = clamp(low, 0, nodes - 1), second = clamp(low + between, 0, nodes - 1);
    float most = max(texelFetch(coverage, first, 0).r, texelFetch(coverage, second, 0).r);
    most = max(most, texelFetch(coverage, ivec2(first.x, second.y), 0).r);
    return max(most, texelFetch(coverage, ivec2(second.x, first.y), 0).r) > 0.0;
}

bool is_protected(vec2 uv) { return texture(protection, uv).r > 0.5; }

// Light within what the projectors can send.
vec3 within_limits(vec3 light, vec2 uv) {
    return min(max(light, texture(lo, uv).rgb), min(texture(hi, uv).rgb, top));
}

// Direct light of the projectors, for content of `light`:
//   clip(gain light - ambient - spread (numbers . terms), lo, min(hi, top)).
vec3 direct_light(vec3 light, vec2 uv, float terms[TERMS]) {
    vec3 level = vec3(0.0);
    for (int k = 0; k < TERMS; k++) level += number(k) * terms[k];
    vec3 scattered = texture(ambient, uv).rgb + texture(spread, uv).rgb * level;
    return within_limits(light * texture(gain, uv).r - scattered, uv);
}
