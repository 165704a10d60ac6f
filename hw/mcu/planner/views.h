/* Where to look from at ground on the way that cannot be seen from where the robot is. */
#ifndef VIEWS_H
#define VIEWS_H

#include "driver.h"

/* Whether nothing that is an obstacle stands between two places, but for the last bit. */
bool views_are_in_sight(const struct driver *driver, struct spot from, struct spot to);
/* Notes what is to be seen: the unknown cells about the way, from `driver->unseen` on. */
void views_aim(struct driver *driver);
/* Begins to search for a place; the newest field must tell what can be reached. */
void views_begin(struct driver *driver);
/* Searches on, a few rows of the window; true: done, and `driver->view_cost` tells whether. */
bool views_search(struct driver *driver);
/* How far off the farthest of what is to be seen lies, and in which direction. */
struct sighting {
    int32_t away_mm;
    turn_t towards;
};
struct sighting views_farthest(const struct driver *driver);

#endif
