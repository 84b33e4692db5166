/* A friction law of your own: slip weakening. Friction falls from mu to half of it over a slip of 1 um, and heals when the
 * contact opens.
 *
 *   cc -shared -fPIC -O2 -o slip_weakening.so friction_law.c $(pkg-config --cflags shearbus)
 *   shearbus-server --friction-law slip_weakening=$PWD/slip_weakening.so ...
 *
 * A scene names it as friction_law = "own:slip_weakening", with a friction_coefficient. */
#include <shearbus/friction_law.h>

static const double weakening_slip = 1e-6; /* [m] */

static double limit(const shearbus_contact_point* point) {
  const double slip = point->state[0] < weakening_slip ? point->state[0] : weakening_slip;
  return point->friction_coefficient * point->pressure * (1.0 - 0.5 * slip / weakening_slip);
}

static void advance(const shearbus_contact_point* point, double dt, double* state) {
  state[0] = point->pressure > 0.0 ? point->state[0] + point->slip * dt : 0.0;
}

const shearbus_friction_law shearbus_friction_law_of_library = {
    SHEARBUS_FRICTION_LAW_VERSION,
    1,                  /* one state: the slip [m] */
    SHEARBUS_CONSTANT,  /* the limit at a given state does not depend on the slip velocity */
    SHEARBUS_FALLS,     /* through the state it falls with it */
    0,                  /* it does not depend on the temperature */
    limit, advance};
