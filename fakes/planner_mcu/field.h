/* The path to a goal: what each cell of the window costs from there, over ground to be driven on.
 *
 * Cells too near to an OBSTACLE are closed. Cells too near to UNKNOWN ones cost more than free
 * ones: they may turn out free when the robot has looked at them, and least where it could still
 * see them as it drives (the laser sees ground only on a line far ahead). Nothing here says that
 * the robot may drive.
 *
 * A field is worked out over several steps, in a bounded number of cells each; meanwhile the one
 * before holds. Source: E. W. Dijkstra, 1959, with the buckets of R. B. Dial, 1969.
 */
#ifndef FIELD_H
#define FIELD_H

#include "ground.h"
#include "robot.h"

#if (ROBOT_WINDOW_CELLS < 3) || (ROBOT_WINDOW_CELLS > 255)
#error "a field's cells are numbered in 16 bits: windows of 3 to 255 cells"
#endif
#define FIELD_CELLS ((uint32_t)ROBOT_WINDOW_CELLS * (uint32_t)ROBOT_WINDOW_CELLS)
#define FIELD_BUCKETS 16384u
#define FIELD_NO_PATH 65535u
#define FIELD_DISCS 12u

/* What a cell weighs, in the low bits of its byte. */
#define FIELD_CLOSED 0u
#define FIELD_MOST_WEIGHT 40u
#define FIELD_ROOM_WEIGHT 6u /* of known ground with room to turn, at most */
#define FIELD_SOFT 0x80u /* not known to be free: a path there is only hoped for */

struct disc { /* ground that has been given up */
    struct point at;
    int32_t radius_mm;
    bool free_too; /* also what is known to be free: the robot could not get through there */
};

struct path_cell {
    struct point at;
    bool soft;
};

struct field_task { /* what a field is asked for */
    struct point goal;
    int32_t radius_mm; /* about it */
    struct point robot;
    int32_t half_mm;   /* what the robot needs to either side, margin included */
    int32_t around_mm; /* what it needs to turn */
    bool only_free;    /* closed is all that is not known to be free */
    bool doubts_obstacles; /* they are not closed, but unknown: some may be there by mistake */
    const struct disc *discs;
    uint32_t disc_count;
    const struct path_cell *before; /* the path that was taken until now */
    uint32_t before_count;
};

struct layer { /* one field */
    struct frame frame;
    bool goal_is_closed;
    uint16_t cost[FIELD_CELLS];
    uint8_t weight[FIELD_CELLS]; /* 0: closed; bit 7: soft */
};

struct field {
    struct layer layers[2];
    uint32_t now; /* which layer is finished; the other one is being worked on */
    bool has_any;
    bool is_busy;
    int32_t robot_cell; /* of the layer in work; below 0: outside */
    uint32_t level;     /* cost of the bucket in work */
    uint32_t queued;
    uint16_t heads[FIELD_BUCKETS];
    uint16_t next[FIELD_CELLS]; /* in its bucket; before that, distances */
    uint16_t previous[FIELD_CELLS];
};

/* Forgets all fields. */
void field_clear(struct field *field);
/* Begins a new field over the ground as it is now; false: the window is too large. */
bool field_begin(struct field *field, const struct ground *ground, const struct field_task *task);
/* Works on it, so many cells at most; true: it has been finished and is the newest now. */
bool field_work(struct field *field, uint32_t cells);
/* Of the newest field at a point, between its cells; FIELD_NO_PATH: none leads from there. */
uint32_t field_cost(const struct field *field, struct point at);
/* What one metre of open ground costs. */
uint32_t field_cost_of_m(const struct field *field);

/* The path from a point downhill, cell by cell; how many there are, at most `room`. */
uint32_t field_path(const struct field *field, struct point from, struct path_cell *path,
                    uint32_t room);
/* Whether the straight line between two points is neither closed nor soft anywhere, and nowhere
 * weighs more. */
bool field_is_straight(const struct field *field, struct point from, struct point to,
                       uint32_t most_weight);
/* What a cell weighs; FIELD_CLOSED outside the window, too. */
uint32_t field_weight(const struct field *field, struct point at);
/* Whether the robot can turn at a point. */
bool field_has_room(const struct field *field, struct point at);

#endif
