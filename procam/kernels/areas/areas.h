/* Solid angles of the cells of a grid of unit directions.

       a ---- b      Each cell is two great-circle triangles, (a, b, c) and (a, c, d). Each gives
       |  \   |      tan(angle / 2) from a triple product and a denominator (Van Oosterom & Strackee
       d ---- c      1983). For the small cells of a panel a series replaces the arctangent. */

#define SPAN 256    /* cells at a time: two rows of their corners fit the L1 cache */
#define SMALL 1e-2 /* largest tangent of half a solid angle for which the series is exact */

struct corners { /* one array per coordinate, so that a vector holds neighbours */
    double x[SPAN + 1], y[SPAN + 1], z[SPAN + 1];
};

INLINE void split_coordinates(size_t count, const double *restrict row, struct corners *restrict to) {
    for (size_t i = 0; i < count; i++) {
        to->x[i] = row[3 * i];
        to->y[i] = row[3 * i + 1];
        to->z[i] = row[3 * i + 2];
    }
}

struct halves { /* of a cell: triple products and denominators of its two triangles */
    double upper, lower, above, below;
};

/* Triangles (a, b, c) and (a, c, d) of Van Oosterom & Strackee 1983. The triple products come from
   edge differences, with n = (c - a) x a in common, which keeps full precision for small triangles. */
INLINE struct halves halves_of(const struct corners *restrict top,
                               const struct corners *restrict bottom, size_t i) {
    const double ax = top->x[i], ay = top->y[i], az = top->z[i];
    const double bx = top->x[i + 1], by = top->y[i + 1], bz = top->z[i + 1];
    const double cx = bottom->x[i + 1], cy = bottom->y[i + 1], cz = bottom->z[i + 1];
    const double dx = bottom->x[i], dy = bottom->y[i], dz = bottom->z[i];
    const double ex = cx - ax, ey = cy - ay, ez = cz - az;
    const double nx = ey * az - ez * ay, ny = ez * ax - ex * az, nz = ex * ay - ey * ax;
    const double gx = ax + cx, gy = ay + cy, gz = az + cz;
    const double common = 1.0 + ax * cx + ay * cy + az * cz; /* 1 + ab + bc + ca, and with d */
    const struct halves found = {
        (bx - ax) * nx + (by - ay) * ny + (bz - az) * nz,
        (ax - dx) * nx + (ay - dy) * ny + (az - dz) * nz,
        common + bx * gx + by * gy + bz * gz,
        common + dx * gx + dy * gy + dz * gz,
    };
    return found;
}

/* atan(t) for |t| <= SMALL, to a rounding. */
INLINE double small_angle(double t) {
    const double y = t * t;
    return t - t * y * (1.0 / 3 - y * (1.0 / 5 - y * (1.0 / 7)));
}

/* Areas of `count` cells by the series; 1 if any of them is too large for it. NaN is not. */
INLINE int small_cells(size_t count, const struct corners *restrict top,
                        const struct corners *restrict bottom, double *restrict areas) {
    int wide = 0;
    for (size_t i = 0; i < count; i++) {
        const struct halves h = halves_of(top, bottom, i);
        const double one = 1.0 / (h.above * h.below); /* one division instead of two */
        const double angle = small_angle(h.upper * h.below * one) +
                             small_angle(h.lower * h.above * one);
        areas[i] = fabs(2.0 * angle);
        wide |= (fabs(h.upper) >= SMALL * h.above) | (fabs(h.lower) >= SMALL * h.below);
    }
    return wide;
}

static void large_cells(size_t count, const struct corners *top, const struct corners *bottom,
                       double *areas) {
    for (size_t i = 0; i < count; i++) {
        const struct halves h = halves_of(top, bottom, i);
        areas[i] = fabs(2.0 * (atan2(h.upper, h.above) + atan2(h.lower, h.below)));
    }
}

static void areas(const struct areas *job, size_t first, size_t count) {
    struct corners rows[2];
    for (size_t left = 0; left < job->columns; left += SPAN) {
        const size_t cells = job->columns - left < SPAN ? job->columns - left : SPAN;
        split_coordinates(cells + 1, job->corners[first] + 3 * left, &rows[first % 2]);
        for (size_t r = first; r < first + count; r++) {
            const struct corners *top = &rows[r % 2], *bottom = &rows[(r + 1) % 2];
            double *to = job->areas + r * job->columns + left;
            split_coordinates(cells + 1, job->corners[r + 1] + 3 * left, &rows[(r + 1) % 2]);
            if (small_cells(cells, top, bottom, to)) large_cells(cells, top, bottom, to);
        }
    }
}
