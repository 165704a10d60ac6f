/* How fast a motion may become another one. */
#ifndef PACE_H
#define PACE_H

#include "driver.h"

/* A motion between the one that was asked for last and the wanted one; never less safe than what
 * lies in the way allows. */
struct motion pace(const struct driver *driver, struct motion wanted, const struct limits *limits);

#endif
