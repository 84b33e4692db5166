/* What the C programs that test the library share: checks that print each fault and count it, options, a step of 1 ns
 * and the columns of a step in an array of structs. */
#ifndef SHEARBUS_TESTS_HOST_CHECKS_H
#define SHEARBUS_TESTS_HOST_CHECKS_H
#include <shearbus/shearbus.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

static int faults = 0;
static shearbus_status status = SHEARBUS_STATUS_INIT; /* of the last call */

#define CHECK(what)                                                                                               \
  do {                                                                                                            \
    if (!(what)) {                                                                                                \
      fprintf(stderr, "%s:%d: not so: %s [%s: %s]\n", __FILE__, __LINE__, #what, shearbus_code_name(status.code), \
              status.text);                                                                                       \
      ++faults;                                                                                                   \
    }                                                                                                             \
  } while (0)
#define CODE(call, expected)                                                                                        \
  do {                                                                                                              \
    const int found = (call);                                                                                       \
    if (found != (expected)) {                                                                                      \
      fprintf(stderr, "%s:%d: %s gave %s: %s, expected %s\n", __FILE__, __LINE__, #call, shearbus_code_name(found), \
              status.text, shearbus_code_name(expected));                                                           \
      ++faults;                                                                                                     \
    }                                                                                                               \
  } while (0)
#define OK(call) CODE(call, SHEARBUS_OK)
/* The code of a call, which its status has, too, and a word of its text. */
#define REFUSED(call, expected, word)         \
  do {                                        \
    CODE(call, expected);                     \
    CHECK(status.code == (expected));         \
    CHECK(strstr(status.text, word) != NULL); \
  } while (0)

static inline shearbus_options host_options(const char* endpoint, const char* scene, double connect_deadline_s) {
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.endpoint = endpoint;
  options.scene_file = scene;
  options.connect_deadline_s = connect_deadline_s;
  options.check_closure = SHEARBUS_CHECK_OFF; /* the steps of these programs apply no answer */
  return options;
}
static inline shearbus_request host_request(size_t n, const shearbus_input inputs[6], const shearbus_output* outputs,
                                            size_t n_outputs) {
  shearbus_request request = SHEARBUS_REQUEST_INIT;
  request.dt_s = 1e-9;
  request.n = n;
  request.inputs = inputs;
  request.n_inputs = 6;
  request.outputs = outputs;
  request.n_outputs = n_outputs;
  return request;
}

typedef struct node {
  double jump, pressure, stress_soft, stress_hard, mass_soft, mass_hard;
  double stress, temperature;
  uint8_t regime, outcome;
} node;

/* The columns of nodes that lie behind each other. */
static inline void columns_of(node* first, shearbus_input inputs[6], shearbus_output outputs[4]) {
  double* values[6] = {&first->jump,        &first->pressure,  &first->stress_soft,
                       &first->stress_hard, &first->mass_soft, &first->mass_hard};
  for (int c = 0; c < 6; ++c) {
    const shearbus_input input = {SHEARBUS_VELOCITY_JUMP + (uint32_t)c, 0, values[c], sizeof(node)};
    inputs[c] = input;
  }
  const shearbus_output wanted[4] = {{SHEARBUS_SHEAR_STRESS, 0, &first->stress, sizeof(node)},
                                     {SHEARBUS_INTERFACE_TEMPERATURE, 0, &first->temperature, sizeof(node)},
                                     {SHEARBUS_REGIME, 0, &first->regime, sizeof(node)},
                                     {SHEARBUS_OUTCOME, 0, &first->outcome, sizeof(node)}};
  memcpy(outputs, wanted, sizeof wanted);
}
#endif
