/* What the ground is to this robot: the link's map, and what the operator vouches for.
 *
 * Cells have whole numbers that do not wrap: cell (i, j) covers i * cell_mm <= x < (i + 1) *
 * cell_mm.
 * UNKNOWN counts as FREE within the radius about the map's origin that the operator declares clear.
 */
#ifndef GROUND_H
#define GROUND_H

#include "mapod_link.h"

struct frame { /* of a window */
    int32_t column0; /* lowest i and j */
    int32_t row0;
    int32_t cell_mm;
    int32_t width; /* cells */
    int32_t height;
};

struct ground {
    const struct mapod_link *link;
    struct frame frame;
    int32_t clear_mm; /* radius about the map's origin; 0: nothing is vouched for */
};

/* The map as it is now; false: there is none. (x, y) is where the robot is, map frame, mm. */
bool ground_from(struct ground *ground, const struct mapod_link *link, int32_t x_mm, int32_t y_mm,
                 int32_t clear_mm);
/* MAPOD_UNKNOWN, _FREE or _OBSTACLE; outside the window UNKNOWN, unless vouched for. */
uint32_t ground_at(const struct ground *ground, int32_t i, int32_t j);
/* The cell that holds x or y, and its middle, mm. */
int32_t cell_of(const struct frame *frame, int32_t at_mm);
int32_t middle_of(const struct frame *frame, int32_t cell);

#endif
