/* Controllers of flexible rods for programs in C and what can call it.
 *
 * A controller is designed on a desk (in Python: controller.save("swing.rodlaw")) and read by rodgym_load, or designed by
 * rodgym_design. Both take memory and time: do it once, before the motor turns. A controller never changes afterwards, and
 * any number of threads may use it.
 *
 * What it remembers of an episode is an array of yours, the state. rodgym_start and rodgym_step read an observation, write
 * state and action, take no memory, wait for nothing, and give the same bits as the Python package.
 *
 * Every function that can refuse says so by its code; rodgym_error() then has a sentence. What is refused changes no array.
 * Pointers that are neither null nor unaligned are trusted, and arrays must not overlap. No function may be called from a
 * signal handler.
 */
#ifndef RODGYM_CONTROLLERS_H
#define RODGYM_CONTROLLERS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Rises when something here changes; compare it with rodgym_abi(). */
#define RODGYM_CONTROLLERS_ABI 1

/* What became of a call. */
typedef enum rodgym_status {
    RODGYM_OK = 0,
    RODGYM_POINTER = 1,     /* a pointer is null or not aligned to its numbers */
    RODGYM_SIZE = 2,        /* an array has another length than the controller needs */
    RODGYM_PARAMETER = 3,   /* a name or a value that is not allowed */
    RODGYM_FILE = 4,        /* no saved controller of this version, or a file that cannot be read */
    RODGYM_DESIGN = 5,      /* the design has no solution */
    RODGYM_OBSERVATION = 6, /* infinity, or a NaN that is no lost sample to this controller */
    RODGYM_FAULT = 7        /* a fault of the library: the state may be half written, please report it */
} rodgym_status;

/* A control law, designed for one machine. */
typedef struct rodgym_controller rodgym_controller;

/* An estimate, and the interval that holds the truth in nine of ten cases. */
typedef struct rodgym_quantity {
    double value;
    double low;
    double high;
} rodgym_quantity;

/* Why this thread's last refused call was refused. The text is this thread's, until its next refusal. */
const char *rodgym_error(void);

/* The library's RODGYM_CONTROLLERS_ABI, and its version. */
uint32_t rodgym_abi(void);
const char *rodgym_version(void);

/* Before the motor turns ----------------------------------------------------------------------------------------------- */

/* Reads a controller that controller.save or rodgym_save wrote, from memory or from a file. *controller is null where that
 * fails. */
rodgym_status rodgym_load(const uint8_t *bytes, size_t size, rodgym_controller **controller);
rodgym_status rodgym_load_file(const char *path, rodgym_controller **controller);

/* Designs a controller: its name ("lqg-adaptive"), the environment's id ("rodgym/PendulumSwingUpBase-v0"), and the
 * environment's keywords as a JSON object ("{\"width\": 0.008}"; null: the defaults). *controller is null where that fails.
 * Designs on two processors may differ in their last bits; a file does not. */
rodgym_status rodgym_design(const char *name, const char *id, const char *keywords, rodgym_controller **controller);

/* Writes a controller for rodgym_load. *size is how many bytes it has; with a capacity of 0 nothing else is written. */
rodgym_status rodgym_save(const rodgym_controller *controller, uint8_t *bytes, size_t capacity, size_t *size);

/* Gives a controller back; null is allowed. */
void rodgym_free(rodgym_controller *controller);

/* Its name, and how many numbers an observation, an action and the state have. (Of null: null and 0.) */
const char *rodgym_name(const rodgym_controller *controller);
size_t rodgym_observation_size(const rodgym_controller *controller);
size_t rodgym_action_size(const rodgym_controller *controller);
size_t rodgym_state_size(const rodgym_controller *controller);

/* What a number of the observation or action is, with its unit: "rate of theta_1 / (10 rad/s)". Null beyond them. */
const char *rodgym_observation_name(const rodgym_controller *controller, size_t index);
const char *rodgym_action_name(const rodgym_controller *controller, size_t index);

/* The number that a keyword has in the design: "control_dt" is the period [s], "torque_limit" what action 1 means [N m]. */
rodgym_status rodgym_keyword(const rodgym_controller *controller, const char *keyword, double *value);

/* In every control period ---------------------------------------------------------------------------------------------- */

/* The observation of a pendulum's controller from angles [rad] (0 hanging, pi upright, counter-clockwise) and rates [rad/s]
 * of its edges, base first; a controller that sees the base alone has one edge. NaN is a lost sample where the controller
 * takes such. */
rodgym_status rodgym_observe(const double *angles, const double *rates, size_t edges, float *observation,
                             size_t observation_size);

/* Begins an episode with its first observation. rodgym_step follows with the same observation. */
rodgym_status rodgym_start(const rodgym_controller *controller, const float *observation, size_t observation_size,
                           double *state, size_t state_size);

/* The action for an observation, each number in [-1, 1]. The state advances by a period. */
rodgym_status rodgym_step(const rodgym_controller *controller, const float *observation, size_t observation_size,
                          double *state, size_t state_size, float *action, size_t action_size);

/* What the state says of the machine, of a controller that learns it: the quantity at an index, from 0 until RODGYM_PARAMETER
 * says that there are no more. Its name ("youngs_modulus") and unit go to name and unit, which have text_size bytes each, or
 * are null. */
rodgym_status rodgym_estimate(const rodgym_controller *controller, const double *state, size_t state_size, size_t index,
                              rodgym_quantity *quantity, char *name, char *unit, size_t text_size);

#ifdef __cplusplus
}
#endif

#endif
