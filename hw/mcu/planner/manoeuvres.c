/* What each tactic asks for in a step, and when it ends. */
#include "manoeuvres.h"

#include "route.h"
#include "tactics.h"
#include "views.h"

/* What may be tuned. Steps are DRIVER_PERIOD_MS each. */
#define CRUISE_MMPS 800   /* faster, the map gets too few looks at each cell */
#define TURNING_MRADPS 600
#define GOAL_MMPS2 150    /* how it slows down for the goal: a nod shows floor as an obstacle */
#define GOAL_SHORT_MM 150
#define CREEP_MMPS 60
#define FRONTIER_MM 500   /* so near to the end of the known way, it is at its end */
#define BEFORE_MM 1500    /* so near before unseen ground, that is what stops it */
#define STUCK_UNSEEN 15u  /* steps until a tactic is begun */
#define STUCK_BLOCKED 40u
#define STUCK_VIEW 20u
#define STUCK_PASS 5u
#define MOST_DOUBTS 3u     /* for one goal */
#define DOUBTS 25u        /* steps without any way, until obstacles are doubted */
#define BACK_MM 2600
#define WAIT_STEPS 60u
#define CROSSED_MOST 100u     /* steps */
#define CROSSED_MMPS 50       /* slower is standing */
#define CROSSED_BACK_MM 1500
#define FACED 2500        /* turns; 14 degrees */
#define PASSED_MM 7600    /* so near, the line on the floor has passed it for good */
#define NEARER_MM 3000    /* nearer, going back is no shorter than looking from elsewhere */
#define TURN_BACKS 3u      /* for one goal */
#define BAND_CELLS 10u    /* of the way, what the robot needs before and behind it included */
#define PASS_MMPS 500
#define PASS_GAIN_MRADPS 500 /* per radian that it looks past it */
#define PASS_MRADPS 200
#define PASS_STEPS 150u
#define TURNS_PER_RAD 10430
#define VIEW_BACKS 2u

static const struct motion standing = {0, 0};

/* So slow that it can stop at the goal. */
static struct motion paced(struct motion motion, int32_t left_mm)
{
    const int32_t stop = root(2 * GOAL_MMPS2 * most(0, left_mm - GOAL_SHORT_MM)) + CREEP_MMPS;
    if (motion.v_mmps > stop) {
        motion.w_mradps = (motion.w_mradps * stop) / motion.v_mmps;
        motion.v_mmps = stop;
    }
    return motion;
}

/* Whether what is not known on the way is a narrow band, behind which known ground goes on. */
static bool is_band(const struct driver *driver)
{
    uint32_t k = driver->known_count;
    const uint32_t end = k + BAND_CELLS;
    while ((k < driver->way_count) && driver->way[k].soft) {
        k++;
    }
    return (k < end) && (k < driver->way_count);
}

/* A band on the way that the laser's line has passed without showing it: goes back at once, to let
 * the line pass again, while that is near. */
static bool turns_back(struct driver *driver)
{
    const struct step_cell *const cell =
        &driver->way[least((int32_t)driver->known_count, (int32_t)driver->way_count - 1)];
    const int32_t dx = cell->x_mm - driver->place.x_mm;
    const int32_t dy = cell->y_mm - driver->place.y_mm;
    const int32_t away = distance_mm(dx, dy);
    const struct spot to = {cell->x_mm, cell->y_mm};
    const struct spot from = {driver->place.x_mm, driver->place.y_mm};
    if ((!is_band(driver)) || (driver->turned_back >= TURN_BACKS) || (away > PASSED_MM) ||
        (away < NEARER_MM) ||
        (magnitude(difference(direction(dx, dy), driver->place.yaw)) > FACED) ||
        (driver->crumb_count < 10u) || (driver->tactic != TACTIC_GO) ||
        (!views_are_in_sight(driver, from, to))) {
        return false;
    }
    driver->tries++;
    driver->spent++;
    driver->turned_back++;
    driver->back_mm = TACTICS_AGAIN_FROM_MM - away;
    tactics_begin(driver, TACTIC_BACK);
    return true;
}

/* Along the way; zero where nothing is worth asking for, and why. */
static struct motion go(struct driver *driver, const struct limits *limits)
{
    const uint32_t known = driver->known_count;
    const struct place target = route_target(driver);
    const struct spot to = (driver->tactic == TACTIC_VIEW) ? driver->view : driver->goal;
    const int32_t left = distance_mm(to.x_mm - driver->place.x_mm, to.y_mm - driver->place.y_mm);
    struct limits own = *limits;
    struct place aim = target;
    own.ahead_mmps = least(own.ahead_mmps, CRUISE_MMPS);
    own.turn_mradps = least(own.turn_mradps, TURNING_MRADPS);
    if (driver->way_count == 0u) {
        const struct layer *const layer = &driver->field.layers[driver->field.now];
        driver->why = (uint8_t)(layer->goal_is_closed ? DRIVER_WHY_GOAL_BLOCKED
                                                      : DRIVER_WHY_WAITS);
        if ((driver->stuck >= DOUBTS) && (driver->doubted < MOST_DOUBTS) && (!driver->doubts)) {
            driver->doubts = true;
            driver->doubted++;
        }
        return standing;
    }
    if (turns_back(driver)) {
        driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
        return standing;
    }
    if ((known < driver->way_count) &&
        ((known == 0u) || (distance_mm(driver->way[known - 1u].x_mm - driver->place.x_mm,
                                       driver->way[known - 1u].y_mm - driver->place.y_mm) <
                           FRONTIER_MM))) {
        driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
        driver->unseen.x_mm = driver->way[known].x_mm;
        driver->unseen.y_mm = driver->way[known].y_mm;
        if (driver->settings.unknown_mmps <= 0) {
            return standing;
        }
        aim.x_mm = driver->way[least((int32_t)known + 5, (int32_t)driver->way_count - 1)].x_mm;
        aim.y_mm = driver->way[least((int32_t)known + 5, (int32_t)driver->way_count - 1)].y_mm;
    } else {
        driver->why = DRIVER_WHY_NOTHING;
    }
    if (distance_mm(aim.x_mm - driver->place.x_mm, aim.y_mm - driver->place.y_mm) < 300) {
        aim.x_mm = to.x_mm;
        aim.y_mm = to.y_mm;
    }
    driver->last = arcs_choose(&driver->sweep, &driver->field, driver->place, aim, &own,
                               &driver->last);
    if ((driver->last.motion.v_mmps == 0) && (driver->last.motion.w_mradps == 0)) {
        const struct step_cell *const end =
            &driver->way[least((int32_t)known, (int32_t)driver->way_count - 1)];
        if (end->soft && (distance_mm(end->x_mm - driver->place.x_mm,
                                      end->y_mm - driver->place.y_mm) < BEFORE_MM)) {
            driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
            driver->unseen.x_mm = end->x_mm;
            driver->unseen.y_mm = end->y_mm;
        } else if (driver->why == DRIVER_WHY_NOTHING) {
            driver->why = (uint8_t)DRIVER_WHY_WAITS;
        } else {
            /* It is known already. */
        }
        return standing;
    }
    return paced(driver->last.motion, left);
}

static struct motion look(struct driver *driver, const struct limits *limits)
{
    struct motion motion;
    driver->why = (uint8_t)DRIVER_WHY_LOOKS;
    driver->turned += (magnitude(driver->moves.w_mradps) * 1043) / 1000;
    motion = arcs_spin(&driver->sweep, 12000, limits);
    if ((motion.w_mradps == 0) || (driver->turned > 65536) || (driver->since > 180u)) {
        tactics_begin(driver, TACTIC_GO);
        return standing;
    }
    return motion;
}

static struct motion back(struct driver *driver, const struct limits *limits)
{
    struct spot crumb = {0, 0};
    struct motion motion = {0, 0};
    driver->why = (uint8_t)DRIVER_WHY_BACKS;
    driver->back_mm -= (magnitude(driver->moves.v_mmps) * (int32_t)DRIVER_PERIOD_MS) / 1000;
    if ((driver->then != TACTIC_GO) && tactics_has_room(driver)) {
        tactics_begin(driver, (enum driver_tactic)driver->then);
        return standing;
    }
    if ((driver->back_mm > 0) && tactics_crumb(driver, &crumb)) {
        motion = arcs_back(&driver->sweep, driver->place, crumb.x_mm, crumb.y_mm, limits);
    }
    if (motion.v_mmps == 0) {
        tactics_begin(driver, (enum driver_tactic)driver->then);
    }
    return motion;
}

static struct motion face(struct driver *driver, const struct limits *limits)
{
    const turn_t towards = direction(driver->unseen.x_mm - driver->place.x_mm,
                                     driver->unseen.y_mm - driver->place.y_mm);
    const int32_t wrong = difference(towards, driver->place.yaw);
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    if ((magnitude(wrong) < FACED) || (driver->since > 100u)) {
        tactics_begin(driver, TACTIC_PASS);
        return standing;
    }
    return arcs_spin(&driver->sweep, wrong, limits);
}

/* Straight towards what is to be seen, until the line has passed the farthest of it. */
static struct motion pass(struct driver *driver, const struct limits *limits)
{
    const struct sighting farthest = views_farthest(driver);
    const int32_t wrong = difference(farthest.towards, driver->place.yaw);
    const int32_t turn = (wrong * PASS_GAIN_MRADPS) / TURNS_PER_RAD;
    struct motion motion = {0, 0};
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    if ((farthest.away_mm > PASSED_MM) && (driver->since < PASS_STEPS)) {
        motion.v_mmps = least(PASS_MMPS, limits->ahead_mmps);
        motion.w_mradps = most(-PASS_MRADPS, least(PASS_MRADPS, turn));
        motion = arcs_safe(&driver->sweep, motion, limits);
    }
    driver->stuck = (motion.v_mmps == 0) ? (driver->stuck + 1u) : 0u;
    if ((farthest.away_mm <= PASSED_MM) || (driver->stuck > STUCK_PASS)) {
        tactics_begin(driver, TACTIC_GO);
    }
    return motion;
}

static struct motion view(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    if (distance_mm(driver->view.x_mm - driver->place.x_mm,
                    driver->view.y_mm - driver->place.y_mm) < ROUTE_VIEW_MM) {
        tactics_begin(driver, TACTIC_FACE);
        return standing;
    }
    if (driver->field.has_any) {
        motion = go(driver, limits);
    }
    driver->stuck = ((motion.v_mmps == 0) && (motion.w_mradps == 0)) ? (driver->stuck + 1u) : 0u;
    if (driver->stuck > STUCK_VIEW) { /* no room to turn here, it may be */
        const bool again = driver->view_backs < VIEW_BACKS;
        driver->view_backs++;
        driver->back_mm = BACK_MM;
        tactics_begin(driver, TACTIC_BACK);
        driver->then = (uint8_t)(again ? TACTIC_VIEW : TACTIC_GO);
    } else if (driver->since > 600u) {
        tactics_begin(driver, TACTIC_GO);
    } else {
        /* On the way there. */
    }
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    return motion;
}

/* Chooses a place to look from, over several steps. */
static void probe(struct driver *driver)
{
    driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
    if ((!driver->field.has_any) || (!views_search(driver))) {
        return;
    }
    driver->view_backs = 0u;
    if (driver->view_cost != FIELD_NO_WAY) {
        tactics_begin(driver, TACTIC_VIEW);
    } else {
        tactics_no_view(driver);
    }
}

/* Something has come on to the way: somebody crosses it. While the robot stands, what they leave
 * behind in the map goes with them; what the robot saw as it still drove, goes as it drives back.
 */
static bool waits_for_crossing(struct driver *driver)
{
    if (driver->crossed == 0u) {
        driver->crossed_for = 0u;
        return false;
    }
    driver->crossed -= (magnitude(driver->moves.v_mmps) < CROSSED_MMPS) ? 1u : 0u;
    driver->crossed_for++;
    if ((driver->crossed > 0u) && (driver->crossed_for < CROSSED_MOST)) {
        return true;
    }
    driver->crossed = 0u;
    driver->crossed_for = 0u;
    if ((!driver->crossed_back) && (driver->crumb_count > 6u) &&
        (field_weight(&driver->field, driver->crossing.x_mm, driver->crossing.y_mm) ==
         FIELD_CLOSED)) {
        driver->crossed_back = true;
        driver->back_mm = CROSSED_BACK_MM;
        tactics_begin(driver, TACTIC_BACK);
    }
    return true;
}

/* Along the way to the goal, and what to do where nothing leads on. */
static struct motion go_on(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    uint32_t patience = STUCK_BLOCKED;
    if (!driver->field.has_any) {
        return motion;
    }
    if (waits_for_crossing(driver)) {
        driver->why = (uint8_t)DRIVER_WHY_WAITS;
        return motion;
    }
    motion = go(driver, limits);
    if ((motion.v_mmps != 0) || (motion.w_mradps != 0)) {
        driver->stuck = 0u;
        return motion;
    }
    driver->stuck++;
    patience = (driver->why == DRIVER_WHY_UNSEEN) ? STUCK_UNSEEN : STUCK_BLOCKED;
    if (driver->stuck >= patience) {
        tactics_stuck(driver);
    }
    return motion;
}

struct motion manoeuvre(struct driver *driver, const struct limits *limits)
{
    driver->since++;
    switch (driver->tactic) {
    case TACTIC_LOOK:
        return look(driver, limits);
    case TACTIC_BACK:
        return back(driver, limits);
    case TACTIC_FACE:
        return face(driver, limits);
    case TACTIC_PASS:
        return pass(driver, limits);
    case TACTIC_VIEW:
        return view(driver, limits);
    case TACTIC_PROBE:
        probe(driver);
        return standing;
    case TACTIC_WAIT:
        driver->why = (uint8_t)DRIVER_WHY_WAITS;
        if (driver->since > WAIT_STEPS) {
            tactics_begin(driver, TACTIC_GO);
        }
        return standing;
    default:
        return go_on(driver, limits);
    }
}
