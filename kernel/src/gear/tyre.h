/* One tyre or skid in the ground plane; wheel axes: x forward along the rolling direction, y
 * right. */
#ifndef AEROMATCH_TYRE_H
#define AEROMATCH_TYRE_H

#define TYRE_LAG 0.02 /* shortest time constant of tyre and steering friction [s] */

typedef struct {
    double stiffness; /* of the carcass along the ground [N m-1] */
    double cornering; /* side force per slip angle at this load [N rad-1]; 0: a skid */
    double load;      /* with which it stands on the ground [N] */
    double mu;        /* greatest friction over load */
    double brake;     /* force that turns the wheel against brake and rolling resistance [N] */
    double loss;      /* damping of the carcass over its stiffness [s] */
} tyre_t;

typedef struct {
    double F[2];    /* on the aircraft [N] */
    double rate[2]; /* of the deflection [m s-1] */
    double renewal; /* rate at which rolling replaces the rubber on the ground [s-1] */
} footprint_t;

void tyre_forces(const tyre_t *tyre, const double deflection[2], const double velocity[2],
                 footprint_t *patch);
double cornering_stiffness(double greatest, double load_of_greatest, double load);

#endif
