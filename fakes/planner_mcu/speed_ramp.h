/* How fast a motion may become another one: limits of acceleration. */
#ifndef SPEED_RAMP_H
#define SPEED_RAMP_H

#include "driver.h"

/* A motion between the one that was asked for last and the wanted one; never less safe than what
 * is ahead allows. */
struct motion ramp(const struct driver *driver, struct motion wanted, const struct limits *limits);

#endif
