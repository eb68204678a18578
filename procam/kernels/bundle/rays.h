/* Unit rays of a fisheye's pixels (Kannala & Brandt 2006): the angle off the axis from a table over
   the radius, then Newton's method, then cosine and sine by their series. */

#define RAYS 64        /* pixels at a time; the compiler vectorises loops over them */
#define NEWTON_STEPS 5 /* two or three suffice, more where the lens nearly folds */
#define HALF_PI 1.57079632679489661923
#define SERIES 22 /* highest power; the next is below rounding on [-pi/2, pi/2] */

/* Refines angles off the axis of points at `radius` on the plane at distance 1. */
INLINE void refine_angles(const double *lens, const double *radius, double *angle) {
    const double k1 = lens[4], k2 = lens[5], k3 = lens[6], k4 = lens[7];
    for (int step = 0; step < NEWTON_STEPS; step++)
        for (int i = 0; i < RAYS; i++) {
            const double t = angle[i], t2 = t * t;
            const double reach = t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
            const double slope =
                1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
            angle[i] = t - (reach - radius[i]) / slope;
        }
    for (int i = 0; i < RAYS; i++) { /* beyond the fold there is no solution */
        angle[i] = angle[i] < 0.0 ? 0.0 : angle[i];
        angle[i] = angle[i] > 2.0 * HALF_PI ? 2.0 * HALF_PI : angle[i];
    }
}

/* Cosines and sines of angles in [0, pi], by series in the angle less pi/2. */
INLINE void half_turns(const double *angle, double *cosine, double *sine) {
    double odd[RAYS], even[RAYS];
    for (int i = 0; i < RAYS; i++) odd[i] = even[i] = 1.0;
    for (int n = SERIES; n > 0; n -= 2) {
        const double of_odd = 1.0 / (n * (n + 1)), of_even = 1.0 / (n * (n - 1));
        for (int i = 0; i < RAYS; i++) {
            const double u = angle[i] - HALF_PI, y = u * u;
            odd[i] = 1.0 - odd[i] * y * of_odd;
            even[i] = 1.0 - even[i] * y * of_even;
        }
    }
    for (int i = 0; i < RAYS; i++) {
        cosine[i] = (HALF_PI - angle[i]) * odd[i];
        sine[i] = even[i];
    }
}

static void rays(const struct rays *job, size_t first, size_t count) {
    const struct rays d = *job;
    const double top = d.knots - 1 - 1e-9; /* so that there is a knot after the last one used */
    for (size_t at = first; at < first + count; at += RAYS) {
        const size_t some = first + count - at < RAYS ? first + count - at : RAYS;
        double x[RAYS] = {0}, y[RAYS] = {0}, radius[RAYS] = {0}, angle[RAYS] = {0};
        double cosine[RAYS], sine[RAYS];
        for (size_t i = 0; i < some; i++) {
            x[i] = (d.pixels[2 * (at + i)] - d.lens[2]) / d.lens[0];
            y[i] = (d.pixels[2 * (at + i) + 1] - d.lens[3]) / d.lens[1];
            radius[i] = sqrt(x[i] * x[i] + y[i] * y[i]);
            const double place = radius[i] * d.per_radius;
            const double known = place < top ? place : top; /* also for NaN */
            const int knot = (int)known;
            angle[i] = d.table[knot] + (known - knot) * (d.table[knot + 1] - d.table[knot]);
        }
        refine_angles(d.lens, radius, angle);
        half_turns(angle, cosine, sine);
        for (size_t i = 0; i < some; i++) {
            const double scale = radius[i] > 0.0 ? sine[i] / radius[i] : radius[i] + 1.0;
            double *to = d.rays + 3 * (at + i);
            to[0] = x[i] * scale, to[1] = y[i] * scale, to[2] = cosine[i];
        }
    }
}
