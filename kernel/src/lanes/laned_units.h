/* All units over flight_t for LANES simulations. */
#include "laned_flight.h"

#include "aero.c"
#include "air_data.c"
#include "earth.c"
#include "engine.c"
#include "fuel.c"
#include "gear.c"
#include "outputs.c"
#include "sixdof.c"
#include "spool.c"
#include "steering.c"
#include "terms.c"
