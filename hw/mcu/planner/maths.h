/* Angles and roots in whole numbers: the same bits on every processor.
 *
 * An angle is a `turn`: 65 536 of them make a full circle, counter-clockwise, so that sums wrap as
 * angles do. Sines are in 1/32 768.
 */
#ifndef MATHS_H
#define MATHS_H

#include <stdint.h>

#define ONE 32768 /* of a sine */

typedef uint16_t turn_t;

int32_t sine(turn_t angle);
int32_t cosine(turn_t angle);
turn_t direction(int32_t x, int32_t y);        /* of a vector, within 3 units; 0 for no vector */
int32_t difference(turn_t angle, turn_t from); /* -32 768 to 32 767: the short way round */
int32_t root(int32_t square);                  /* rounded down; 0 for what is negative */
int32_t distance_mm(int32_t dx_mm, int32_t dy_mm); /* beyond 32 m within a thousandth */
turn_t turn_from_link(int16_t angle);              /* from 0.0001 rad */
int32_t magnitude(int32_t number);
int32_t least(int32_t a, int32_t b);
int32_t most(int32_t a, int32_t b);
int32_t floor_div(int32_t number, int32_t by); /* by > 0; towards minus infinity */

#endif
