/* Values of dome masters as they are stored, to and from linear light.

   8-bit codes are decoded by a table, and encoded, with dither, by pieces of polynomials (vcurve) in the root
   of the light, shifted so that the bend of sRGB lies between two pieces. */

enum { FRAME_BLOCK = 64, VECTORS = FRAME_BLOCK / LANES };
enum { TILE_WIDTH = 192, TILE_ROWS = 64 };

/* What is not finite is black. */
INLINE vf or_black(vf a) { return vsel(vabs(a) < INFINITY, a, vset(0.0f)); }

/* The linear light of a block; of floats and halves it may not be finite. */
INLINE void load_block(int kind, const struct procam_frame *setup, const void *from, float *light) {
    if (kind == U8) {
        vlook_up(setup->decode, setup->decode_bytes, from, light);
        return;
    }
    UNROLL for (size_t at = 0; at < FRAME_BLOCK; at += LANES) {
        const vf stored = vload_kind(kind, from, at);
        vstore(light + at, kind == U16 ? stored * (1 / 65535.0f) : stored);
    }
}

/* A vector of light as it is to be stored, before rounding. */
INLINE vf value_of(int kind, const struct procam_frame *setup, vf light) {
    if (kind == U8) return vcurve(setup->encode, vroot(vmax(light, vset(0.0f))) + setup->encode_shift);
    return kind == U16 ? vmin(vmax(light * 65535.0f, vset(0.0f)), vset(65535.0f)) : light;
}

/* Stores a block of light, mixed with the stored `original` if that is given. */
INLINE void store_block(int kind, const struct procam_frame *setup, const float *light, const void *stored,
                        const float *threshold, unsigned char *to) {
    vf values[VECTORS];
    UNROLL for (size_t k = 0; k < VECTORS; k++) {
        const size_t at = k * LANES;
        vf v = value_of(kind, setup, vload(light + at));
        if (stored) {
            vf original = vload_kind(kind, stored, at);
            if (kind == F16 || kind == F32) original = or_black(original);
            v = setup->strength * (v - original) + original;
        }
        values[k] = kind == U8 ? v + vload(threshold + at) : v;
    }
    if (kind == U8) vstore_codes(to, values);
    for (size_t k = 0; k < VECTORS && kind != U8; k++) {
        unsigned char *at = to + k * LANES * bytes_of(kind);
        if (kind == U16) vstore_halves((uint16_t *)at, __builtin_convertvector(vtruncate(values[k] + 0.5f), vhalves));
        else if (kind == F16) vstore_halves((uint16_t *)at, vto_f16(values[k]));
        else vstore((float *)at, values[k]);
    }
}
