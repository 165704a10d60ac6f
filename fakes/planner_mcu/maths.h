/* Angles, places and roots in whole numbers: the same bits on every processor.
 *
 * A binary angle counts 65 536 to the full circle, counter-clockwise, so that sums wrap as angles
 * do. Sines are in 1/32 768. Coordinates are at most 150 km off each other.
 */
#ifndef MATHS_H
#define MATHS_H

#include <stdint.h>

#define ONE 32768 /* of a sine */
#define ANGLES_PER_RAD 10430

typedef uint16_t binary_angle;

struct point { /* map frame */
    int32_t x_mm;
    int32_t y_mm;
};

int32_t sine(binary_angle angle);
int32_t cosine(binary_angle angle);
binary_angle direction(int32_t x, int32_t y); /* of a vector, within 3 units; 0 for no vector */
binary_angle bearing(struct point from, struct point to);
int32_t difference(binary_angle angle, binary_angle from); /* -32 768 to 32 767, the short side */
binary_angle angle_from_link(int16_t angle);               /* from 0.0001 rad */
int32_t root(int32_t square);                      /* rounded down; 0 for what is negative */
int32_t distance_mm(int32_t dx_mm, int32_t dy_mm); /* beyond 32 m within a thousandth */
int32_t apart_mm(struct point a, struct point b);
/* After `part` of `of` equal steps from one point to another; their distance times `part` fits. */
struct point between(struct point from, struct point to, int32_t part, int32_t of);
int32_t magnitude(int32_t number);
int32_t least(int32_t a, int32_t b);
int32_t most(int32_t a, int32_t b);
int32_t floor_div(int32_t number, int32_t by); /* by > 0; towards minus infinity */

#endif
