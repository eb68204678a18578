// Live, between the passes: one Newton step of the numbers, from the sums of reduce.frag.
//
// Draw it over a 9 x 1 RGBA32F target that is not `numbers` itself, and use that target afterwards.

uniform sampler2D part_0; // the seven targets of reduce.frag with their mip chains
uniform sampler2D part_1;
uniform sampler2D part_2;
uniform sampler2D part_3;
uniform sampler2D part_4;
uniform sampler2D part_5;
uniform sampler2D part_6;
uniform sampler2D numbers; // 9 x 1: those that reduce.frag used; nearest
uniform sampler2D moves;   // 9 x 18, from moves.exr: per colour, weights of the sums and of the numbers; nearest
uniform int tiles;         // G

in vec2 place;
out vec4 better;

const int TERMS = 9;

void main() {
    int last = int(round(log2(float(tiles)))), row = int(place.x * float(TERMS));
    vec4 part[7];
    part[0] = texelFetch(part_0, ivec2(0), last);
    part[1] = texelFetch(part_1, ivec2(0), last);
    part[2] = texelFetch(part_2, ivec2(0), last);
    part[3] = texelFetch(part_3, ivec2(0), last);
    part[4] = texelFetch(part_4, ivec2(0), last);
    part[5] = texelFetch(part_5, ivec2(0), last);
    part[6] = texelFetch(part_6, ivec2(0), last);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < TERMS; k++) {
        vec3 from_sums = texelFetch(moves, ivec2(k, row), 0).rgb;
        vec3 from_numbers = texelFetch(moves, ivec2(k, TERMS + row), 0).rgb;
        for (int c = 0; c < 3; c++) {
            int i = 3 * k + c;
            float moment = part[i / 4][i % 4] * float(tiles * tiles);
            sum[c] += from_sums[c] * moment;
        }
        sum += from_numbers * texelFetch(numbers, ivec2(k, 0), 0).rgb;
    }
    better = vec4(sum, 1.0);
}
