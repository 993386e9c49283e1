/* What is refused, and how: every line that does not hold is printed. */
#include "rodgym_controllers.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int wrong;

#define HOLDS(what) \
    do { \
        if (!(what)) { \
            wrong++; \
            fprintf(stderr, "line %d: %s; the last sentence: %s\n", __LINE__, #what, rodgym_error()); \
        } \
    } while (0)

/* A call is refused with this code, in words that hold these. */
#define REFUSED(call, code, words) HOLDS((call) == (code) && strstr(rodgym_error(), (words)))

static const char BASE[] = "rodgym/PendulumSwingUpBase-v0";

int main(void)
{
    rodgym_controller *law = (rodgym_controller *)&wrong;
    double state[1024], before[1024], value;
    float observation[3], action[1] = {7.0f};
    const double angle = 0.1, rate = 250.0;
    rodgym_quantity found;
    char name[32], unit[32];
    size_t size;

    HOLDS(rodgym_abi() == RODGYM_CONTROLLERS_ABI);
    HOLDS(strlen(rodgym_version()) > 0 && strlen(rodgym_error()) == 0);
    HOLDS(sizeof(rodgym_quantity) == 24 && sizeof(rodgym_status) == sizeof(int));

    REFUSED(rodgym_design("lqx", BASE, NULL, &law), RODGYM_PARAMETER, "lqg-adaptive");
    HOLDS(law == NULL);
    REFUSED(rodgym_design(NULL, BASE, NULL, &law), RODGYM_POINTER, "name is a null pointer");
    REFUSED(rodgym_design("lqg", BASE, NULL, NULL), RODGYM_POINTER, "controller");
    REFUSED(rodgym_design("lqg", "rodgym/Nothing-v0", NULL, &law), RODGYM_PARAMETER, "Nothing");
    REFUSED(rodgym_design("lqg", BASE, "{\"width\": -1}", &law), RODGYM_PARAMETER, "width = -1");
    REFUSED(rodgym_design("lqg", BASE, "width=1", &law), RODGYM_PARAMETER, "JSON");
    REFUSED(rodgym_design("lqr", BASE, NULL, &law), RODGYM_PARAMETER, "every edge");
    REFUSED(rodgym_design("lq\xff", BASE, NULL, &law), RODGYM_PARAMETER, "UTF-8");
    REFUSED(rodgym_load((const uint8_t *)"RODGYM nothing of ours", 22, &law), RODGYM_FILE, "RODLAW");
    REFUSED(rodgym_load(NULL, 22, &law), RODGYM_POINTER, "bytes");
    REFUSED(rodgym_load(NULL, 0, &law), RODGYM_FILE, "0 bytes");
    REFUSED(rodgym_load_file("/nowhere/at/all", &law), RODGYM_FILE, "/nowhere/at/all");

    HOLDS(rodgym_design("lqg-adaptive", BASE, "{\"width\": 0.008, \"actuator_delay\": 0.015}", &law) == RODGYM_OK);
    const size_t n = rodgym_state_size(law);
    HOLDS(n <= 1024 && rodgym_observation_size(law) == 3 && rodgym_action_size(law) == 1);
    HOLDS(strcmp(rodgym_name(law), "lqg-adaptive") == 0);
    HOLDS(strcmp(rodgym_observation_name(law, 2), "rate of theta_1 / (10 rad/s)") == 0);
    HOLDS(strcmp(rodgym_action_name(law, 0), "base torque / torque_limit") == 0);
    HOLDS(rodgym_observation_name(law, 3) == NULL && rodgym_action_name(law, 1) == NULL);
    HOLDS(rodgym_keyword(law, "width", &value) == RODGYM_OK && value == 0.008);
    HOLDS(rodgym_keyword(law, "control_dt", &value) == RODGYM_OK && value == 0.01);
    REFUSED(rodgym_keyword(law, "depth", &value), RODGYM_PARAMETER, "torque_limit");

    HOLDS(rodgym_observe(&angle, &rate, 1, observation, 3) == RODGYM_OK);
    HOLDS(observation[0] == (float)cos(angle) && observation[1] == (float)sin(angle) && observation[2] == 20.0f);
    REFUSED(rodgym_observe(&angle, &rate, 2, observation, 3), RODGYM_SIZE, "6 are needed");
    observation[2] = 0.0f;
    HOLDS(rodgym_start(law, observation, 3, state, n) == RODGYM_OK);
    memcpy(before, state, sizeof state);
    REFUSED(rodgym_step(law, observation, 3, state, n - 1, action, 1), RODGYM_SIZE, "state has");
    REFUSED(rodgym_step(law, observation, 2, state, n, action, 1), RODGYM_SIZE, "3 are needed");
    REFUSED(rodgym_step(law, observation, 3, state, n, action, 2), RODGYM_SIZE, "action");
    REFUSED(rodgym_step(law, observation, 3, NULL, n, action, 1), RODGYM_POINTER, "state");
    REFUSED(rodgym_step(NULL, observation, 3, state, n, action, 1), RODGYM_POINTER, "controller");
    REFUSED(rodgym_step(law, observation, 3, (double *)((char *)state + 4), n, action, 1), RODGYM_POINTER, "multiple");
    observation[1] = INFINITY;
    REFUSED(rodgym_step(law, observation, 3, state, n, action, 1), RODGYM_OBSERVATION, "observation[1] = inf");
    REFUSED(rodgym_start(law, observation, 3, state, n), RODGYM_OBSERVATION, "finite");
    HOLDS(memcmp(before, state, n * sizeof *state) == 0 && action[0] == 7.0f);
    observation[1] = NAN; /* a lost sample */
    HOLDS(rodgym_step(law, observation, 3, state, n, action, 1) == RODGYM_OK && fabsf(action[0]) <= 1.0f);

    HOLDS(rodgym_estimate(law, state, n, 0, &found, name, unit, 32) == RODGYM_OK);
    HOLDS(strcmp(name, "bending_stiffness") == 0 && strcmp(unit, "N m^2") == 0);
    HOLDS(found.low < found.value && found.value < found.high);
    HOLDS(rodgym_estimate(law, state, n, 1, &found, NULL, NULL, 0) == RODGYM_OK);
    REFUSED(rodgym_estimate(law, state, n, 0, &found, name, unit, 5), RODGYM_SIZE, "5 bytes");
    REFUSED(rodgym_estimate(law, state, n, 9, &found, name, unit, 32), RODGYM_PARAMETER, "index = 9");

    /* Written and read again, it is the same; damaged, it is refused. */
    HOLDS(rodgym_save(law, NULL, 0, &size) == RODGYM_OK && size > 1000);
    uint8_t *bytes = malloc(size);
    REFUSED(rodgym_save(law, bytes, size - 1, &size), RODGYM_SIZE, "room");
    HOLDS(rodgym_save(law, bytes, size, &size) == RODGYM_OK);
    rodgym_free(law);
    HOLDS(rodgym_load(bytes, size, &law) == RODGYM_OK && rodgym_state_size(law) == n);
    rodgym_free(law);
    REFUSED(rodgym_load(bytes, size - 1, &law), RODGYM_FILE, "header");
    for (size_t i = 0; i < size; i += 97) {
        bytes[i] ^= 0x10;
        HOLDS(rodgym_load(bytes, size, &law) == RODGYM_FILE && law == NULL);
        bytes[i] ^= 0x10;
    }
    free(bytes);
    rodgym_free(NULL);
    HOLDS(rodgym_state_size(NULL) == 0 && rodgym_name(NULL) == NULL);
    return wrong;
}
