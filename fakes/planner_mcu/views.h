/* Where to look from at ground on the path that cannot be seen from where the robot is. */
#ifndef VIEWS_H
#define VIEWS_H

#include "driver.h"

/* Ground that did not show is looked at from so much farther off, each time. */
#define VIEWS_FARTHER_MM 1600

struct sighting { /* how far off, and in which direction */
    int32_t away_mm;
    binary_angle towards;
};

/* Whether nothing that is an obstacle stands between two points, but for the last bit. */
bool views_are_in_sight(const struct driver *driver, struct point from, struct point to);
/* Notes what is to be seen: the unknown cells about the path, from `driver->unseen` on. */
void views_aim(struct driver *driver);
/* Begins to search for a point; the newest field must tell what can be reached. */
void views_begin(struct driver *driver);
/* Searches on, a few rows of the window; true: done, and `driver->view_cost` tells whether. */
bool views_search(struct driver *driver);
/* The line has passed the aims: what has not shown is to be looked at from farther off. */
void views_end(struct driver *driver);
/* The farthest of what is to be seen. */
struct sighting views_farthest(const struct driver *driver);

#endif
