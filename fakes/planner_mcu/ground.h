/* What the ground is to this robot: the link's map, and what the operator assumes to be clear.
 *
 * Cells have whole numbers that do not wrap: cell (i, j) covers i * cell_mm <= x < (i + 1) *
 * cell_mm. UNKNOWN counts as FREE within the radius about the map's origin that is assumed clear.
 */
#ifndef GROUND_H
#define GROUND_H

#include "mapod_link.h"
#include "maths.h"

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
    int32_t clear_mm; /* radius about the map's origin; 0: nothing is assumed clear */
};

/* The map as it is now about the robot; false: there is none. */
bool ground_from(struct ground *ground, const struct mapod_link *link, struct point robot,
                 int32_t clear_mm);
/* MAPOD_UNKNOWN, _FREE or _OBSTACLE; outside the window UNKNOWN, unless assumed clear. */
uint32_t ground_at(const struct ground *ground, int32_t i, int32_t j);
uint32_t ground_at_point(const struct ground *ground, struct point point);
/* The cell that holds x or y, and its middle, mm. */
int32_t cell_of(const struct frame *frame, int32_t at_mm);
int32_t middle_of(const struct frame *frame, int32_t cell);
/* The middle of the window's cell in this column and row. */
struct point middle_at(const struct frame *frame, int32_t column, int32_t row);
/* The cell that holds a point: row * width + column of the window; below 0: it is outside. */
int32_t cell_index(const struct frame *frame, struct point point);

#endif
