/* The way of a drive: which field is to be worked out, and where on its way to aim. */
#ifndef ROUTE_H
#define ROUTE_H

#include "driver.h"

#define ROUTE_VIEW_MM 400 /* so near to a place to look from is there */

/* Keeps a field in work, and the way as the newest tells; false: the window is too large. */
bool route_work(struct driver *driver);
/* The farthest place on the known way that a straight line leads to. */
struct place route_target(const struct driver *driver);

#endif
