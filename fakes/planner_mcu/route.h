/* The path of a drive: which field is to be worked out, and where on its path to aim. */
#ifndef ROUTE_H
#define ROUTE_H

#include "driver.h"

#define ROUTE_VIEW_MM 400 /* so near to a point to look from is there */

/* Keeps a field in work, and the path as the newest tells; false: the window is too large. */
bool route_work(struct driver *driver);
/* The farthest point on the known path that a straight line leads to. */
struct point route_target(const struct driver *driver);

#endif
