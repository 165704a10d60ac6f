/* Which motion to ask for: arcs that are safe until the robot stands, the best for the path. */
#ifndef ARCS_H
#define ARCS_H

#include "field.h"
#include "sweep.h"

struct limits { /* of a step */
    int32_t ahead_mmps;  /* 0: not ahead */
    int32_t behind_mmps; /* 0: not back */
    int32_t turn_mradps;
    int32_t unknown_mmps; /* over ground that is not known to be free; 0: never */
};

struct choice {
    struct motion motion; /* as fast as it may be; zero: nothing is safe and useful */
    int32_t curvature;    /* mrad per m; of an arc */
    bool spins;
};

/* The best motion towards a point of the path. */
struct choice arcs_choose(const struct sweep *sweep, const struct field *field, struct place place,
                          struct point target, const struct limits *limits,
                          const struct choice *last);
/* Turning in place towards a direction; zero where that is not safe. */
struct motion arcs_spin(const struct sweep *sweep, int32_t by, const struct limits *limits);
/* Backwards to a point behind; zero where that is not safe. */
struct motion arcs_back(const struct sweep *sweep, struct place place, struct point to,
                        const struct limits *limits);
/* A motion, as slow as what is ahead of it demands; zero where it may not even begin. */
struct motion arcs_safe(const struct sweep *sweep, struct motion motion,
                        const struct limits *limits);

#endif
