/* Values of dome masters as they are stored, to and from linear light.

   8-bit codes are decoded by a table, and encoded, with dither, by pieces of polynomials (vcurve) in the root
   of the light, shifted so that the bend of sRGB lies between two pieces. */

enum { FRAME_BLOCK = 64, VECTORS = FRAME_BLOCK / LANES };
enum { TILE_WIDTH = 192, TILE_ROWS = 64 };

/* A vector of values that are not of 8 bits; what is not finite is black. */
INLINE vf load_value(int kind, const unsigned char *stored, size_t at) {
    const vf v = vload_kind(kind, stored, at);
    return kind == U16 ? v : vfinite(v);
}

/* Stores a vector of light, not with 8 bits, mixed with the value that was stored if `mixes`. */
INLINE void store_light(int kind, const struct procam_frame *setup, vf light, int mixes, vf stored, unsigned char *to) {
    vf v = kind == U16 ? vmin(vmax(light * 65535.0f, vset(0.0f)), vset(65535.0f)) : light;
    if (mixes) v = setup->strength * (v - stored) + stored;
    if (kind == U16) vstore_halves((uint16_t *)to, __builtin_convertvector(vtruncate(v + 0.5f), vhalves));
    else if (kind == F16) vstore_halves((uint16_t *)to, vto_f16(v));
    else vstore((float *)to, v);
}

/* Encodes a block of light with 8 bits, mixed with the codes `stored` if those are given. */
INLINE void encode_block(const struct procam_frame *setup, const float *light, const unsigned char *stored,
                         const float *threshold, unsigned char *to) {
    vf values[VECTORS];
    UNROLL for (size_t k = 0; k < VECTORS; k++) {
        const size_t at = k * LANES;
        vf v = vcurve(setup->encode, vroot(vload(light + at)) + setup->encode_shift);
        if (stored) {
            const vf original = vload_kind(U8, stored, at);
            v = setup->strength * (v - original) + original;
        }
        values[k] = v + vload(threshold + at);
    }
    vstore_codes(to, values);
}
