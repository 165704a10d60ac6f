/* How far the robot can move on an arc before its footprint comes too near to what is not free.
 *
 * The rules are the sender's own (its stop zone), with a little more care: the rectangle of the
 * robot is swept along the arc, each cell counts with all of its square, a margin is kept all
 * around. A cell within the margin already may be left and passed, but not met. So a sender that
 * knows the same map practically never has to stop this robot.
 *
 * Travel is measured on the fastest point of the footprint: forward speed plus rate of turn times
 * reach. That sum is the `rate` of a motion, mm/s.
 */
#ifndef SWEEP_H
#define SWEEP_H

#include "ground.h"

#define SWEEP_LONGEST_MM 1500 /* no arc is looked at farther than that */
#define SWEEP_CELLS 1536      /* not free, about the robot; more are too many to be looked at */

struct shape { /* of the robot; mm */
    int32_t front;  /* ahead of the drive axle's middle */
    int32_t rear;   /* behind it */
    int32_t half;   /* to either side */
    int32_t margin; /* kept free all around, with the driver's own care */
    int32_t reach;  /* of the farthest corner from the axle's middle */
};

struct place { /* map frame */
    struct point at;
    binary_angle yaw;
};

struct motion {
    int32_t v_mmps;   /* forward */
    int32_t w_mradps; /* counter-clockwise */
};

struct close_cell {
    int16_t x_mm; /* middle, from the robot's place */
    int16_t y_mm;
    int16_t gap_mm; /* between it and the robot as it stands; below 0: it lies under the robot */
    uint8_t state;  /* MAPOD_UNKNOWN or MAPOD_OBSTACLE */
};

struct sweep { /* the cells that are not free about the robot, at one instant */
    struct shape shape;
    binary_angle yaw;
    int32_t half_cell_mm;
    int32_t kept_mm; /* what is to be kept free of cells that are not within the margin yet */
    uint32_t count;
    bool too_many;
    struct close_cell cells[SWEEP_CELLS];
};

/* Collects the cells about a place. */
void sweep_begin(struct sweep *sweep, const struct ground *ground, const struct shape *shape,
                 struct place place);
/* mm of the fastest point, up to `wanted_mm` (at most SWEEP_LONGEST_MM): what a motion can go.
 * With `over_unknown` only OBSTACLE is in the way. */
int32_t sweep_free_mm(const struct sweep *sweep, struct motion motion, int32_t wanted_mm,
                      bool over_unknown);
/* The place that a motion leads to after so much travel of the fastest point. */
struct place sweep_end(struct place from, struct motion motion, int32_t rate_mmps,
                       int32_t travel_mm);
/* Speed that no point of the footprint exceeds, mm/s. */
int32_t sweep_rate_mmps(const struct shape *shape, struct motion motion);
bool is_moving(struct motion motion);

#endif
