/* Rotations: quaternion and Euler angles (3-2-1). */
#include "axes.h"

#include "elementary.h"

#include <math.h>

/* Inverse of quaternion_matrix, by the largest component, so that no small number is divided by. */
void matrix_quaternion(const double C[3][3], double q[4]) {
    const double trace = C[0][0] + C[1][1] + C[2][2];
    int largest = 3;
    double most = trace;
    for (int i = 0; i < 3; i++) {
        if (C[i][i] > most) {
            most = C[i][i];
            largest = i;
        }
    }
    if (largest == 3) {
        q[0] = 0.5 * sqrt(1.0 + trace);
        q[1] = (C[1][2] - C[2][1]) / (4.0 * q[0]);
        q[2] = (C[2][0] - C[0][2]) / (4.0 * q[0]);
        q[3] = (C[0][1] - C[1][0]) / (4.0 * q[0]);
        return;
    }
    const int i = largest;
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double n = 0.5 * sqrt(1.0 + C[i][i] - C[j][j] - C[k][k]);
    q[1 + i] = n;
    q[0] = (C[j][k] - C[k][j]) / (4.0 * n);
    q[1 + j] = (C[i][j] + C[j][i]) / (4.0 * n);
    q[1 + k] = (C[i][k] + C[k][i]) / (4.0 * n);
}

/* Turns north-east-down to body axes. */
void euler_matrix(double phi, double theta, double psi, double C[3][3]) {
    double cf, sf, ct, st, cp, sp;
    am_sincos(phi, &sf, &cf);
    am_sincos(theta, &st, &ct);
    am_sincos(psi, &sp, &cp);
    C[0][0] = ct * cp;
    C[0][1] = ct * sp;
    C[0][2] = -st;
    C[1][0] = sf * st * cp - cf * sp;
    C[1][1] = sf * st * sp + cf * cp;
    C[1][2] = sf * ct;
    C[2][0] = cf * st * cp + sf * sp;
    C[2][1] = cf * st * sp - sf * cp;
    C[2][2] = cf * ct;
}
