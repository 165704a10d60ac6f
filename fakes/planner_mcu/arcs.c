/* Arcs from the robot's place, each judged by where it ends, how it looks there, how fast it is. */
#include "arcs.h"

/* What may be tuned. Costs are those of the field: so much for a metre of open ground. */
#define BRAKE_MMPS2 800     /* how fast the robot surely slows down (the sender's own number) */
#define GENTLY_MMPS2 250    /* as it does where it can choose: a nod shows floor as an obstacle */
#define REACTION_MS 550     /* the sender's 450, and a step of this driver */
#define LATERAL_MMPS2 120   /* of an arc: more tilts what the attitude sensor tells */
#define SET_OUT_MM 120      /* so much must be free before a motion begins: no inching ahead */
#define SLOWEST_MMPS 80     /* there is no going below it */
#define HORIZON_MM 900      /* of an arc, for being judged */
/* What is as bad as so much more of the path: */
#define TURN_COST_MM 700    /* one radian of wrong heading at the end */
#define SPIN_COST_MM 250    /* to stop and begin to turn in place */
#define KEEP_COST_MM 60     /* to change the curvature by 1 rad per m */
#define SLOW_COST_MM 500    /* an arc that can hardly be driven */
#define OFF_COST_MM 1500    /* an arc that ends where the field says nothing */
#define SPIN_DONE 1500      /* 8 degrees */
#define SPIN_GAIN_MRADPS 1600 /* per radian of what is left to turn */
#define SPIN_SLOWEST_MRADPS 200
#define SPIN_FASTEST_MRADPS 600
#define BACK_MMPS 300
#define BACK_ARCS 5
#define AIM_MM 32000        /* a point farther back is aimed at, but not steered to exactly */

static const int16_t curvatures[] = { /* mrad per m */
    0, 120, -120, 250, -250, 450, -450, 700, -700, 1100, -1100, 1700, -1700, 2600, -2600,
};
#define CURVATURES (sizeof curvatures / sizeof curvatures[0])

/* Rate from which the robot can stop within so much free travel, slowing down so fast. */
static int32_t allowed_mmps(int32_t free_mm, int32_t brake_mmps2)
{
    const int32_t lost = (brake_mmps2 * REACTION_MS) / 1000;
    return root((lost * lost) + (2 * brake_mmps2 * most(0, free_mm))) - lost;
}

/* The same arc, so that no point is faster than `rate_mmps`. */
static struct motion scaled(struct motion motion, int32_t rate_mmps, int32_t own_rate_mmps)
{
    if (own_rate_mmps > rate_mmps) {
        motion.v_mmps = (motion.v_mmps * rate_mmps) / own_rate_mmps;
        motion.w_mradps = (motion.w_mradps * rate_mmps) / own_rate_mmps;
    }
    return motion;
}

static const struct motion standing = {0, 0};

/* A motion, as slow as what is ahead of it demands of a robot that slows down so fast. */
static struct motion safe_by(const struct sweep *sweep, struct motion motion,
                             const struct limits *limits, int32_t brake_mmps2)
{
    const int32_t rate = sweep_rate_mmps(&sweep->shape, motion);
    int32_t allowed;
    int32_t free_mm = sweep_free_mm(sweep, motion, SWEEP_LONGEST_MM, false);
    if (limits->unknown_mmps > 0) {
        const int32_t hard_mm = sweep_free_mm(sweep, motion, SWEEP_LONGEST_MM, true);
        allowed = most(allowed_mmps(free_mm, brake_mmps2),
                       least(limits->unknown_mmps, allowed_mmps(hard_mm, brake_mmps2)));
        free_mm = hard_mm;
    } else {
        allowed = allowed_mmps(free_mm, brake_mmps2);
    }
    if (free_mm < SET_OUT_MM) {
        return standing;
    }
    return scaled(motion, allowed, rate);
}

struct motion arcs_safe(const struct sweep *sweep, struct motion motion,
                        const struct limits *limits)
{
    return safe_by(sweep, motion, limits, BRAKE_MMPS2);
}

static struct motion gently(const struct sweep *sweep, struct motion motion,
                            const struct limits *limits)
{
    return safe_by(sweep, motion, limits, GENTLY_MMPS2);
}

/* An arc of this curvature, as fast as the limits let it. */
static struct motion arc_of(int32_t curvature, int32_t v_mmps, int32_t turn_mradps)
{
    struct motion motion;
    if (curvature != 0) {
        v_mmps = least(v_mmps, root((LATERAL_MMPS2 * 1000000) / magnitude(curvature)));
    }
    motion.v_mmps = v_mmps;
    motion.w_mradps = (v_mmps * curvature) / 1000;
    if (magnitude(motion.w_mradps) > turn_mradps) {
        motion.v_mmps = (v_mmps * turn_mradps) / magnitude(motion.w_mradps);
        motion.w_mradps = (motion.w_mradps > 0) ? turn_mradps : -turn_mradps;
    }
    return motion;
}

/* mm of path that a wrong heading is as bad as. */
static int32_t heading_cost_mm(struct place place, struct point target)
{
    const int32_t wrong = difference(bearing(place.at, target), place.yaw);
    return (magnitude(wrong) * TURN_COST_MM) / ANGLES_PER_RAD;
}

/* mm of path from a point to the goal; below 0: there is none. */
static int32_t path_mm(const struct field *field, struct point from)
{
    const uint32_t cost = field_cost(field, from);
    return (cost == FIELD_NO_PATH) ? -1 : (int32_t)((cost * 1000u) / field_cost_of_m(field));
}

struct motion arcs_spin(const struct sweep *sweep, int32_t by, const struct limits *limits)
{
    struct motion motion = {0, 0};
    const int32_t left_mrad = (magnitude(by) * 1000) / ANGLES_PER_RAD;
    int32_t w = (left_mrad * SPIN_GAIN_MRADPS) / 1000;
    w = most(SPIN_SLOWEST_MRADPS, least(least(w, SPIN_FASTEST_MRADPS), limits->turn_mradps));
    motion.w_mradps = (by >= 0) ? w : -w;
    return arcs_safe(sweep, motion, limits);
}

/* Of the arc that leads through a point, mrad per m. */
static int32_t curvature_to(struct place place, struct point to)
{
    int32_t dx = to.x_mm - place.at.x_mm;
    int32_t dy = to.y_mm - place.at.y_mm;
    int32_t away, aside;
    while ((magnitude(dx) > AIM_MM) || (magnitude(dy) > AIM_MM)) {
        dx /= 2;
        dy /= 2;
    }
    away = most(100, distance_mm(dx, dy));
    aside = ((cosine(place.yaw) * dy) - (sine(place.yaw) * dx)) / ONE;
    return ((2 * aside * 1000) / away) * 1000 / away;
}

struct motion arcs_back(const struct sweep *sweep, struct place place, struct point to,
                        const struct limits *limits)
{
    const int32_t curvature = curvature_to(place, to);
    const int32_t v = least(BACK_MMPS, limits->behind_mmps);
    int32_t k;
    for (k = 0; (k <= BACK_ARCS) && (v >= SLOWEST_MMPS); k++) {
        const int32_t by = ((k & 1) != 0) ? (150 * k) : (-150 * k);
        const int32_t chosen = (k < BACK_ARCS) ? (curvature + by) : 0; /* at last, straight */
        struct motion motion = arc_of(chosen, v, limits->turn_mradps / 2);
        motion.v_mmps = -motion.v_mmps;
        motion.w_mradps = -motion.w_mradps;
        motion = gently(sweep, motion, limits);
        if (motion.v_mmps <= -SLOWEST_MMPS) {
            return motion;
        }
    }
    return standing;
}

/* How bad an arc is, mm of path from here to the goal; below 0: it can't be driven. */
static int32_t arc_cost_mm(const struct sweep *sweep, const struct field *field,
                           struct place place, struct point target, struct motion motion,
                           int32_t v_mmps)
{
    const int32_t rate = sweep_rate_mmps(&sweep->shape, motion);
    const int32_t length = most(200, least(HORIZON_MM, apart_mm(place.at, target)));
    struct place end;
    int32_t left;
    if (motion.v_mmps < SLOWEST_MMPS) {
        return -1;
    }
    end = sweep_end(place, motion, rate, (length * rate) / motion.v_mmps);
    left = path_mm(field, end.at);
    if (left < 0) {
        left = path_mm(field, place.at) + OFF_COST_MM;
    }
    return left + length + heading_cost_mm(end, target) +
           ((SLOW_COST_MM * (v_mmps - motion.v_mmps)) / most(1, v_mmps));
}

struct choice arcs_choose(const struct sweep *sweep, const struct field *field, struct place place,
                          struct point target, const struct limits *limits,
                          const struct choice *last)
{
    const int32_t wrong = difference(bearing(place.at, target), place.yaw);
    struct choice best = {{0, 0}, 0, false};
    int32_t best_mm = 0x7FFFFFFF;
    uint32_t k;
    for (k = 0u; (k < CURVATURES) && (limits->ahead_mmps >= SLOWEST_MMPS); k++) {
        const int32_t curvature = curvatures[k];
        const struct motion full = arc_of(curvature, limits->ahead_mmps, limits->turn_mradps);
        const struct motion safe = gently(sweep, full, limits);
        int32_t cost_mm = arc_cost_mm(sweep, field, place, target, safe, limits->ahead_mmps);
        if (cost_mm >= 0) {
            cost_mm += (KEEP_COST_MM * magnitude(curvature - last->curvature)) / 1000;
            if (cost_mm < best_mm) {
                best_mm = cost_mm;
                best.motion = safe;
                best.curvature = curvature;
            }
        }
    }
    if (magnitude(wrong) > (last->spins ? SPIN_DONE : (2 * SPIN_DONE))) {
        const int32_t here_mm = most(0, path_mm(field, place.at));
        const int32_t cost_mm = here_mm + heading_cost_mm(place, target) +
                                (last->spins ? -SPIN_COST_MM : SPIN_COST_MM);
        const struct motion spin = arcs_spin(sweep, wrong, limits);
        if ((spin.w_mradps != 0) && (cost_mm < best_mm)) {
            best.motion = spin;
            best.curvature = 0;
            best.spins = true;
        }
    }
    return best;
}
