/* Speed grows and ends gently: a robot that brakes hard nods, and its laser, 8 m ahead, then takes
 * ground for an obstacle. Where what is ahead leaves no room for that, it brakes hard.
 */
#include "speed_ramp.h"

#define FASTER_MMPS 30 /* a step */
#define SLOWER_MMPS 25
#define AHEAD_OF_MMPS 120 /* more than it moves, a robot that lags behind is not asked for */
#define LATERAL_MMPS2 150 /* of an arc, as in arcs.c */
#define CREEP_MMPS 40     /* from there it may simply stop */

/* The same arc at another speed; `like` goes ahead or back. */
static struct motion at_speed(struct motion like, int32_t v_mmps)
{
    const int32_t v = magnitude(like.v_mmps);
    const int32_t most_mradps = (LATERAL_MMPS2 * 1000) / most(1, v_mmps);
    like.w_mradps = most(-most_mradps, least(most_mradps, (like.w_mradps * v_mmps) / v));
    like.v_mmps = (like.v_mmps > 0) ? v_mmps : -v_mmps;
    return like;
}

struct motion ramp(const struct driver *driver, struct motion wanted, const struct limits *limits)
{
    const struct motion before = driver->asked;
    const int32_t was = least(magnitude(before.v_mmps),
                              magnitude(driver->moves.v_mmps) + AHEAD_OF_MMPS);
    const bool same_way = ((before.v_mmps > 0) && (wanted.v_mmps > 0)) ||
                          ((before.v_mmps < 0) && (wanted.v_mmps < 0));
    const int32_t wants = magnitude(wanted.v_mmps);
    const int32_t most_mmps = (before.v_mmps > 0) ? limits->ahead_mmps : limits->behind_mmps;
    const int32_t slower = least(most_mmps, was - SLOWER_MMPS);
    struct motion slowed;
    if (wants > (was + FASTER_MMPS)) {
        return (same_way || (was <= CREEP_MMPS)) ? at_speed(wanted, was + FASTER_MMPS)
                                                 : (struct motion){0, 0};
    }
    if ((slower <= CREEP_MMPS) || (same_way && (wants >= slower))) {
        return wanted;
    }
    slowed = at_speed(same_way ? wanted : before, slower);
    slowed = arcs_safe(&driver->sweep, slowed, limits);
    return (same_way && (wants >= magnitude(slowed.v_mmps))) ? wanted : slowed;
}
