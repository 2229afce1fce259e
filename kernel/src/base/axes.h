/* Rotations: quaternion (scalar first) and Euler angles (3-2-1) as matrices. */
#ifndef AEROMATCH_AXES_H
#define AEROMATCH_AXES_H

#include "real.h"

/* C turns reference to body axes; exact for any length of q but zero. */
static inline void quaternion_matrix(const real q[4], real C[3][3]) {
    const real s = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const real xx = s * q[1] * q[1];
    const real yy = s * q[2] * q[2];
    const real zz = s * q[3] * q[3];
    const real xy = s * q[1] * q[2];
    const real xz = s * q[1] * q[3];
    const real yz = s * q[2] * q[3];
    const real wx = s * q[0] * q[1];
    const real wy = s * q[0] * q[2];
    const real wz = s * q[0] * q[3];
    C[0][0] = 1.0 - yy - zz;
    C[0][1] = xy + wz;
    C[0][2] = xz - wy;
    C[1][0] = xy - wz;
    C[1][1] = 1.0 - xx - zz;
    C[1][2] = yz + wx;
    C[2][0] = xz + wy;
    C[2][1] = yz - wx;
    C[2][2] = 1.0 - xx - yy;
}

/* Inverse of quaternion_matrix: the unit quaternion of a rotation. */
void matrix_quaternion(const double C[3][3], double q[4]);

/* C turns north-east-down to body axes; bank, pitch and heading. [rad] */
void euler_matrix(double phi, double theta, double psi, double C[3][3]);

#endif
