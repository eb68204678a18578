// Live, pass 1: sums of the direct light over the dome, with the present numbers.
//
// Draw it over seven targets at once, G x G RGBA32F, G a power of two (64 serves 4096 px), and then make
// their mip chains: the last level, times G x G, holds the 27 sums. Each fragment sums a block of pixels.

in vec2 place;
layout(location = 0) out vec4 part[7]; // sum of term k and colour c at place 3 k + c of the 28

uniform int tiles; // G

void main() {
    int size = textureSize(content, 0).x;
    int edge = (size + tiles - 1) / tiles;
    ivec2 start = ivec2(floor(place * float(tiles))) * edge;
    ivec2 end = min(start + edge, ivec2(size));
    float sums[28];
    for (int i = 0; i < 28; i++) sums[i] = 0.0;
    for (int row = start.y; row < end.y; row++) {
        for (int column = start.x; column < end.x; column++) {
            ivec2 pixel = ivec2(column, row);
            vec2 where = from_middle(pixel, size), uv = (vec2(pixel) + 0.5) / float(size);
            float covered = texture(coverage, uv).r, radius = length(where);
            if (radius > 1.0 || covered <= 0.0) continue;
            float terms[TERMS];
            terms_at(direction_at(where), terms);
            vec3 light = decode(texelFetch(content, pixel, 0).rgb);
            vec3 direct = is_protected(uv) ? within_limits(light, uv) : direct_light(light, uv, terms);
            float theta = radius * HALF_PI;
            direct *= covered * (theta > 0.0 ? sin(theta) / theta : 1.0);
            for (int k = 0; k < TERMS; k++) {
                for (int c = 0; c < 3; c++) sums[3 * k + c] += direct[c] * terms[k];
            }
        }
    }
    float pixel_sr = pow(2.0 * HALF_PI / float(size), 2.0);
    for (int i = 0; i < 7; i++) {
        part[i] = pixel_sr * vec4(sums[4 * i], sums[4 * i + 1], sums[4 * i + 2], sums[4 * i + 3]);
    }
}
