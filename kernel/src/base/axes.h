/* Rotations: quaternion (scalar first) and Euler angles (3-2-1) as matrices. */
#ifndef AEROMATCH_AXES_H
#define AEROMATCH_AXES_H

/* C turns reference to body axes; exact for any length of q but zero. */
void quaternion_matrix(const double q[4], double C[3][3]);

/* Inverse of quaternion_matrix: the unit quaternion of a rotation. */
void matrix_quaternion(const double C[3][3], double q[4]);

/* C turns north-east-down to body axes; bank, pitch and heading. [rad] */
void euler_matrix(double phi, double theta, double psi, double C[3][3]);

#endif
