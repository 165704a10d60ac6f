/* Where to look from at ground on the way that cannot be seen from where the robot is. */
#ifndef VIEWS_H
#define VIEWS_H

#include "driver.h"

struct sighting { /* how far off, and in which direction */
    int32_t away_mm;
    turn_t towards;
};

/* Whether nothing that is an obstacle stands between two places, but for the last bit. */
bool views_are_in_sight(const struct driver *driver, struct spot from, struct spot to);
/* Notes what is to be seen: the unknown cells about the way, from `driver->unseen` on. */
void views_aim(struct driver *driver);
/* Begins to search for a place; the newest field must tell what can be reached. */
void views_begin(struct driver *driver);
/* Searches on, a few rows of the window; true: done, and `driver->view_cost` tells whether. */
bool views_search(struct driver *driver);
/* The farthest of what is to be seen. */
struct sighting views_farthest(const struct driver *driver);

#endif
