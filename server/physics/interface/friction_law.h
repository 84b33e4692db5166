/* A friction law of your own, compiled as a shared library and named in a scene: friction_law = "own:NAME". The
 * administrator of a server loads it, shearbus-server --friction-law NAME=/path/libname.so; a client cannot.
 *
 * The library defines one symbol, of C linkage:
 *
 *   const shearbus_friction_law shearbus_friction_law_of_library = { SHEARBUS_FRICTION_LAW_VERSION, ... };  (C++: extern "C")
 *
 * Its functions are called by several threads at once and must depend on their arguments alone. Where a law throws,
 * returns no finite number or one below 0, or does not rise and fall as it declares, the node keeps its state and has the
 * outcome "failed". A law that crashes or never returns takes the server with it. */
#ifndef SHEARBUS_FRICTION_LAW_H
#define SHEARBUS_FRICTION_LAW_H

#define SHEARBUS_FRICTION_LAW_VERSION 1u
#define SHEARBUS_FRICTION_LAW_STATES 4u /* most states of a law */

/* How the friction stress changes with the slip velocity or the temperature. */
enum { SHEARBUS_FALLS = -1, SHEARBUS_CONSTANT = 0, SHEARBUS_RISES = 1 };

typedef struct shearbus_contact_point {
  double friction_coefficient; /* interface.friction_coefficient of the scene */
  double pressure;             /* normal pressure [Pa]; 0 in advance() where the contact is open */
  double temperature;          /* of the interface at the end of the step [K]; states should not depend on it */
  double melting_temperature;  /* of the soft body at this pressure [K]; infinite in advance() */
  double slip;                 /* slip velocity in the step, not negative [m/s] */
  const double* state;         /* in limit(): after the step; in advance(): before it */
} shearbus_contact_point;

typedef struct shearbus_friction_law {
  unsigned version;           /* SHEARBUS_FRICTION_LAW_VERSION */
  unsigned num_states;        /* values per node, 0 at the start of a node; at most SHEARBUS_FRICTION_LAW_STATES */
  int with_slip;              /* how the limit changes with the slip at given states */
  int through_states;         /* how it changes with the slip through the states */
  int falls_with_temperature; /* 1: it falls, and is 0 from melting on; 0: it does not depend on the temperature */
  /* The largest stress that friction carries [Pa]. */
  double (*limit)(const shearbus_contact_point* point);
  /* Writes the states after a step of length dt [s] with one slip velocity. Null without states. */
  void (*advance)(const shearbus_contact_point* point, double dt, double* state);
} shearbus_friction_law;

#endif
