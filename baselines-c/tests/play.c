/* Plays observations of a file through a controller of a file: writes the bits of every action, and of the state at the end. */
#include "rodgym_controllers.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void must(rodgym_status status)
{
    if (status != RODGYM_OK) {
        fprintf(stderr, "code %d: %s\n", (int)status, rodgym_error());
        exit(1);
    }
}

int main(int count, char **arguments)
{
    rodgym_controller *law = NULL;
    if (count != 3) {
        return 2;
    }
    must(rodgym_load_file(arguments[1], &law));
    const size_t d = rodgym_observation_size(law), s = rodgym_state_size(law), a = rodgym_action_size(law);
    float *observation = calloc(d + 1, sizeof *observation), *action = calloc(a + 1, sizeof *action);
    double *state = calloc(s + 1, sizeof *state);
    FILE *file = fopen(arguments[2], "rb");
    if (!file || !observation || !action || !state) {
        return 2;
    }
    for (int begins = 1; fread(observation, sizeof *observation, d, file) == d; begins = 0) {
        if (begins) {
            must(rodgym_start(law, observation, d, state, s));
        }
        must(rodgym_step(law, observation, d, state, s, action, a));
        for (size_t i = 0; i < a; i++) {
            uint32_t bits;
            memcpy(&bits, &action[i], sizeof bits);
            printf("%08x\n", (unsigned)bits);
        }
    }
    for (size_t i = 0; i < s; i++) {
        uint64_t bits;
        memcpy(&bits, &state[i], sizeof bits);
        printf("%016llx\n", (unsigned long long)bits);
    }
    fclose(file);
    free(observation), free(action), free(state);
    rodgym_free(law);
    return 0;
}
