/* The published estimate (channel nav/estimate, schema ilns.NavEstimate.1), byte for byte, for C and C++.
 *
 * SI units; ENU is a local east-north-up frame, body axes are forward, left, up. Native byte order, no padding. A build of ilns with
 * another layout has another schema number, which is in the header: check it. tests/c_layout.rs compares this file with
 * the Rust definition (shared-types/src/estimate.rs), offset by offset. */
#ifndef ILNS_ESTIMATE_H
#define ILNS_ESTIMATE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ILNS_ESTIMATE_SCHEMA 1

enum ilns_mode {
    ILNS_INITIALISING = 0,   /* no solution yet */
    ILNS_OK = 1,             /* position aiding is current */
    ILNS_DEGRADED = 2,       /* it goes on, but not as asked */
    ILNS_DEAD_RECKONING = 3, /* no position aiding: the error grows as the covariance says */
    ILNS_INVALID = 4         /* do not steer by it; so is every number that is not listed here */
};

struct ilns_header {
    uint64_t sequence;         /* a gap is a loss */
    uint32_t epoch;            /* another one: the sender was restarted */
    uint16_t source;
    uint16_t schema;           /* ILNS_ESTIMATE_SCHEMA */
    int64_t t_valid;           /* data time of the inertial sample, ns */
    int64_t t_arrival;         /* the rest of the times: CLOCK_MONOTONIC, ns, for latency only */
    int64_t t_published;
    uint64_t origin_sequence;  /* the sample's */
    int64_t origin_t_arrival;
};

struct ilns_estimate {
    struct ilns_header header;
    uint64_t solution;         /* which solution it stands on */
    int64_t t_keyframe;        /* that solution's data time, ns */
    double position_enu[3];    /* m */
    double velocity_enu[3];    /* m/s */
    double q_enu_body[4];      /* body to ENU, Hamilton, w x y z */
    double accel_bias[3];      /* m/s^2 */
    double gyro_bias[3];       /* rad/s */
    double position_cov[6];    /* m^2: ee en eu nn nu uu */
    double velocity_cov[6];    /* m^2/s^2, same order */
    double attitude_cov[6];    /* rad^2, small rotations about body x, y, z, same order */
    double sigma_rpy[3];       /* 1-sigma about body x, body y and up, rad */
    double lat_lon_h[3];       /* deg, deg, ellipsoidal height in m */
    double aiding_age[5];      /* s since lbl, gnss, dvl, mcp, ps were last used; infinite: never */
    uint32_t mode;             /* enum ilns_mode */
    uint32_t reserved;
};

#ifdef __cplusplus
}
#endif

#endif
