/* A consumer in C: estimates on standard input, as `consumer PREFIX --raw` writes them.
 *   cc -O2 -I deploy/include deploy/examples/consumer.c -o consumer_in_c
 *   target/release/examples/consumer main --raw | ./consumer_in_c */
#include <stdio.h>

#include "ilns_estimate.h"

int main(void) {
    struct ilns_estimate estimate;
    while (fread(&estimate, sizeof estimate, 1, stdin) == 1) {
        if (estimate.header.schema != ILNS_ESTIMATE_SCHEMA) {
            fprintf(stderr, "consumer: schema %u, built for %d\n", estimate.header.schema, ILNS_ESTIMATE_SCHEMA);
            return 2;
        }
        if (estimate.mode == ILNS_INITIALISING || estimate.mode >= ILNS_INVALID) {
            puts("no position");
            continue;
        }
        printf("mode %u: east %.3f m, north %.3f m, up %.3f m\n", (unsigned)estimate.mode, estimate.position_enu[0],
               estimate.position_enu[1], estimate.position_enu[2]);
    }
    return 0;
}
