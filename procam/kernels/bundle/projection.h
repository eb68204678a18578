/* Projection of points by a lens, with derivatives by the point and by the lens's parameters.

   Two models: Brown's pinhole with distortion, and the fisheye of Kannala and Brandt. */
#include "observations.h"

struct projection { /* a point on the plane at distance 1, and derivatives of its pixel */
    lane plane[2], by_point[6], by_bend[10];
};

/* Brown's lens. Parameters: focal x, y, centre x, y, k1 k2 p1 p2 k3. */
INLINE void project_brown(int slopes, const struct device *device, const lane *point,
                          struct projection *to) {
    const struct device d = *device;
    const double fx = d.lens[0], fy = d.lens[1];
    const double k1 = d.lens[4], k2 = d.lens[5], p1 = d.lens[6], p2 = d.lens[7], k3 = d.lens[8];
    EACH {
        const double depth = point[2][i] > 0.0 ? point[2][i] : NAN, one = 1.0 / depth;
        const double x = point[0][i] * one, y = point[1][i] * one, r2 = x * x + y * y;
        const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        const double both = 2.0 * x * y, wide = r2 + 2.0 * x * x, high = r2 + 2.0 * y * y;
        to->plane[0][i] = x * radial + p1 * both + p2 * wide;
        to->plane[1][i] = y * radial + p1 * high + p2 * both;
        if (!slopes) continue;
        const double bend = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
        const double xx = (radial + bend * x * x + 2.0 * p1 * y + 6.0 * p2 * x) * one;
        const double xy = (bend * x * y + 2.0 * p1 * x + 2.0 * p2 * y) * one;
        const double yy = (radial + bend * y * y + 6.0 * p1 * y + 2.0 * p2 * x) * one;
        to->by_point[0][i] = fx * xx, to->by_point[1][i] = fx * xy;
        to->by_point[2][i] = -fx * (x * xx + y * xy);
        to->by_point[3][i] = fy * xy, to->by_point[4][i] = fy * yy;
        to->by_point[5][i] = -fy * (x * xy + y * yy);
        to->by_bend[0][i] = fx * x * r2, to->by_bend[1][i] = fx * x * r2 * r2;
        to->by_bend[2][i] = fx * both, to->by_bend[3][i] = fx * wide;
        to->by_bend[4][i] = fx * x * r2 * r2 * r2;
        to->by_bend[5][i] = fy * y * r2, to->by_bend[6][i] = fy * y * r2 * r2;
        to->by_bend[7][i] = fy * high, to->by_bend[8][i] = fy * both;
        to->by_bend[9][i] = fy * y * r2 * r2 * r2;
    }
}

/* Kannala and Brandt's lens. Parameters: focal x, y, centre x, y, k1..k4. */
INLINE void project_fisheye(int slopes, const struct device *device, const lane *point,
                            struct projection *to) {
    const struct device d = *device;
    const double fx = d.lens[0], fy = d.lens[1];
    const double k1 = d.lens[4], k2 = d.lens[5], k3 = d.lens[6], k4 = d.lens[7];
    EACH {
        const double x = point[0][i], y = point[1][i], z = point[2][i];
        const double square = x * x + y * y, across = sqrt(square);
        const double theta = angle_off(across, z), t2 = theta * theta;
        const double radius = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        const double one = across > 0.0 ? 1.0 / across : across; /* 0 or NaN */
        const double scale = across == 0.0 ? 1.0 / z : radius * one;
        to->plane[0][i] = x * scale, to->plane[1][i] = y * scale;
        if (!slopes) continue;
        const double rise =
            1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        const double fall = rise / (square + z * z), bend = fall * z - scale;
        const double ux = x * one, uy = y * one;
        to->by_point[0][i] = fx * (scale + bend * ux * ux), to->by_point[1][i] = fx * bend * ux * uy;
        to->by_point[2][i] = -fx * x * fall;
        to->by_point[3][i] = fy * bend * ux * uy, to->by_point[4][i] = fy * (scale + bend * uy * uy);
        to->by_point[5][i] = -fy * y * fall;
        double power = theta;
        for (int k = 0; k < 4; k++) {
            power *= t2;
            to->by_bend[k][i] = fx * ux * power, to->by_bend[5 + k][i] = fy * uy * power;
        }
    }
}

INLINE void project(int slopes, int fisheye, const struct device *device, const lane *point,
                       struct projection *to) {
    fisheye ? project_fisheye(slopes, device, point, to)
            : project_brown(slopes, device, point, to);
}
