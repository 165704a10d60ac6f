/* What is asked for in a step, along the path and by each recovery behaviour, and when it ends. */
#include "manoeuvres.h"

#include "recovery.h"
#include "route.h"
#include "views.h"

/* What may be tuned. Steps are DRIVER_PERIOD_MS each. */
#define CRUISE_MMPS 800   /* faster, the map gets too few looks at each cell */
#define TURNING_MRADPS 600
#define GOAL_MMPS2 150    /* how it slows down for the goal: a nod shows floor as an obstacle */
#define GOAL_SHORT_MM 150
#define GOAL_FAR_MM 100000 /* farther off, the goal slows nobody down */
#define CREEP_MMPS 60
#define FRONTIER_MM 500   /* so near to the end of the known path, it is at its end */
#define BEFORE_MM 1500    /* so near before unseen ground, that is what stops it */
#define STUCK_UNSEEN 15u  /* steps until a recovery is begun */
#define STUCK_BLOCKED 40u
#define STUCK_VIEW 20u
#define STUCK_PASS 5u
#define MOST_DOUBTS 3u     /* for one goal */
#define DOUBTS 25u        /* steps without any path, until obstacles are doubted */
#define BACK_MM 2600
#define TURN_MM 800       /* at least, before it turns: where it stood it got stuck */
#define WAIT_STEPS 60u
#define CROSSED_MOST 100u     /* steps */
#define CROSSED_MMPS 50       /* slower is standing */
#define CROSSED_BACK_MM 1500
#define FACED 2500        /* 14 degrees */
#define PASSED_MM (ROBOT_LINE_MM - 850) /* so near, the line has passed it for good */
#define NEARER_MM 3000    /* nearer, going back is no shorter than looking from elsewhere */
#define TURN_BACKS 3u      /* for one goal */
#define BAND_CELLS 10u    /* of the path, what the robot needs before and behind it included */
#define PASS_MMPS 500
#define PASS_GAIN_MRADPS 500 /* per radian that it looks past it */
#define PASS_MRADPS 200
#define PASS_STEPS 150u
#define VIEW_BACKS 2u

static const struct motion standing = {0, 0};

/* So slow that it can stop at the goal. */
static struct motion paced(struct motion motion, int32_t left_mm)
{
    const int32_t free_mm = most(0, least(left_mm - GOAL_SHORT_MM, GOAL_FAR_MM));
    const int32_t stop = root(2 * GOAL_MMPS2 * free_mm) + CREEP_MMPS;
    if (motion.v_mmps > stop) {
        motion.w_mradps = (motion.w_mradps * stop) / motion.v_mmps;
        motion.v_mmps = stop;
    }
    return motion;
}

/* Whether what is not known on the path is a narrow band, behind which known ground goes on. */
static bool is_band(const struct driver *driver)
{
    uint32_t k = driver->known_count;
    const uint32_t end = k + BAND_CELLS;
    while ((k < driver->path_count) && driver->path[k].soft) {
        k++;
    }
    return (k < end) && (k < driver->path_count);
}

/* A cell of the path, or its last one. */
static const struct path_cell *path_cell_at(const struct driver *driver, uint32_t k)
{
    return &driver->path[least((int32_t)k, (int32_t)driver->path_count - 1)];
}

static void note_unseen(struct driver *driver, const struct path_cell *cell)
{
    driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
    driver->unseen = cell->at;
}

/* A band on the path that the laser's line has passed without showing it: goes back at once, to let
 * the line pass again, while that is near. */
static bool turns_back(struct driver *driver)
{
    const struct point from = driver->place.at;
    const struct point to = path_cell_at(driver, driver->known_count)->at;
    const int32_t away = apart_mm(to, from);
    if ((!is_band(driver)) || (driver->turned_back >= TURN_BACKS) || (away > PASSED_MM) ||
        (away < NEARER_MM) ||
        (magnitude(difference(bearing(from, to), driver->place.yaw)) > FACED) ||
        (driver->crumb_count < 10u) || (driver->recovery != RECOVERY_NONE) ||
        (!views_are_in_sight(driver, from, to))) {
        return false;
    }
    driver->tries++;
    driver->spent++;
    driver->turned_back++;
    driver->back_mm = RECOVERY_AGAIN_FROM_MM - away;
    recovery_begin(driver, RECOVERY_BACK);
    return true;
}

/* No path leads on: after a while, obstacles are doubted. */
static void without_path(struct driver *driver)
{
    const struct layer *const layer = &driver->field.layers[driver->field.now];
    driver->why =
        (uint8_t)(layer->goal_is_closed ? DRIVER_WHY_GOAL_BLOCKED : DRIVER_WHY_WAITS);
    if ((driver->stuck >= DOUBTS) && (driver->doubted < MOST_DOUBTS) && (!driver->doubts)) {
        driver->doubts = true;
        driver->doubted++;
    }
}

/* Whether the robot stands where the known path ends before ground that was not seen. */
static bool is_at_frontier(const struct driver *driver)
{
    const uint32_t known = driver->known_count;
    return (known < driver->path_count) &&
           ((known == 0u) ||
            (apart_mm(driver->path[known - 1u].at, driver->place.at) < FRONTIER_MM));
}

/* Why no arc along the path is safe. */
static void why_no_arc(struct driver *driver)
{
    const struct path_cell *const end = path_cell_at(driver, driver->known_count);
    if (end->soft && (apart_mm(end->at, driver->place.at) < BEFORE_MM)) {
        note_unseen(driver, end);
    } else if (driver->why == DRIVER_WHY_NOTHING) {
        driver->why = (uint8_t)DRIVER_WHY_WAITS;
    }
}

/* Along the path; zero where nothing is worth asking for, and why. */
static struct motion go(struct driver *driver, const struct limits *limits)
{
    const uint32_t known = driver->known_count;
    const struct point to = (driver->recovery == RECOVERY_VIEW) ? driver->view : driver->goal;
    struct limits own = *limits;
    struct point aim = route_target(driver);
    own.ahead_mmps = least(own.ahead_mmps, CRUISE_MMPS);
    own.turn_mradps = least(own.turn_mradps, TURNING_MRADPS);
    if (driver->path_count == 0u) {
        without_path(driver);
        return standing;
    }
    if (turns_back(driver)) {
        driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
        return standing;
    }
    driver->why = DRIVER_WHY_NOTHING;
    if (is_at_frontier(driver)) {
        note_unseen(driver, &driver->path[known]);
        if (driver->settings.unknown_mmps <= 0) {
            return standing;
        }
        aim = path_cell_at(driver, known + 5u)->at;
    }
    aim = (apart_mm(aim, driver->place.at) < 300) ? to : aim;
    driver->last = arcs_choose(&driver->sweep, &driver->field, driver->place, aim, &own,
                               &driver->last);
    if (!is_moving(driver->last.motion)) {
        why_no_arc(driver);
        return standing;
    }
    return paced(driver->last.motion, apart_mm(to, driver->place.at));
}

static struct motion look(struct driver *driver, const struct limits *limits)
{
    struct motion motion;
    driver->why = (uint8_t)DRIVER_WHY_LOOKS;
    driver->turned += (magnitude(driver->moves.w_mradps) * 1043) / 1000;
    motion = arcs_spin(&driver->sweep, 12000, limits);
    if ((motion.w_mradps == 0) || (driver->turned > 65536) || (driver->since > 180u)) {
        recovery_begin(driver, RECOVERY_NONE);
        return standing;
    }
    return motion;
}

static struct motion back(struct driver *driver, const struct limits *limits)
{
    struct point crumb = {0, 0};
    struct motion motion = {0, 0};
    driver->why = (uint8_t)DRIVER_WHY_BACKS;
    driver->back_mm -= (magnitude(driver->moves.v_mmps) * (int32_t)DRIVER_PERIOD_MS) / 1000;
    /* what it is to face must lie beyond the line: the whole way; else only until it can turn */
    if ((driver->then != RECOVERY_NONE) && (driver->then != RECOVERY_FACE) &&
        (apart_mm(driver->begun, driver->place.at) >= TURN_MM) && recovery_has_room(driver)) {
        recovery_begin(driver, (enum recovery)driver->then);
        return standing;
    }
    if ((driver->back_mm > 0) && recovery_crumb(driver, &crumb)) {
        motion = arcs_back(&driver->sweep, driver->place, crumb, limits);
    }
    if (motion.v_mmps == 0) {
        recovery_begin(driver, (enum recovery)driver->then);
    }
    return motion;
}

static struct motion face(struct driver *driver, const struct limits *limits)
{
    const int32_t wrong =
        difference(bearing(driver->place.at, driver->unseen), driver->place.yaw);
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    if ((magnitude(wrong) < FACED) || (driver->since > 100u)) {
        recovery_begin(driver, RECOVERY_PASS);
        return standing;
    }
    return arcs_spin(&driver->sweep, wrong, limits);
}

/* Straight towards what is to be seen, until the line has passed the farthest of it. */
static struct motion pass(struct driver *driver, const struct limits *limits)
{
    const struct sighting farthest = views_farthest(driver);
    const int32_t wrong = difference(farthest.towards, driver->place.yaw);
    const int32_t turn = (wrong * PASS_GAIN_MRADPS) / ANGLES_PER_RAD;
    struct motion motion = {0, 0};
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    if ((farthest.away_mm > PASSED_MM) && (driver->since < PASS_STEPS)) {
        motion.v_mmps = least(PASS_MMPS, limits->ahead_mmps);
        motion.w_mradps = most(-PASS_MRADPS, least(PASS_MRADPS, turn));
        motion = arcs_safe(&driver->sweep, motion, limits);
    }
    driver->stuck = (motion.v_mmps == 0) ? (driver->stuck + 1u) : 0u;
    if ((farthest.away_mm <= PASSED_MM) || (driver->stuck > STUCK_PASS)) {
        views_end(driver);
        recovery_begin(driver, RECOVERY_NONE);
    }
    return motion;
}

static struct motion view(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    if (apart_mm(driver->view, driver->place.at) < ROUTE_VIEW_MM) {
        recovery_begin(driver, RECOVERY_FACE);
        return standing;
    }
    if (driver->field.has_any) {
        motion = go(driver, limits);
    }
    driver->stuck = is_moving(motion) ? 0u : (driver->stuck + 1u);
    if (driver->stuck > STUCK_VIEW) { /* no room to turn here, it may be */
        const bool again = driver->view_backs < VIEW_BACKS;
        driver->view_backs++;
        driver->back_mm = BACK_MM;
        recovery_begin(driver, RECOVERY_BACK);
        driver->then = (uint8_t)(again ? RECOVERY_VIEW : RECOVERY_NONE);
    } else if (driver->since > 600u) {
        recovery_begin(driver, RECOVERY_NONE);
    }
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    return motion;
}

/* Chooses a point to look from, over several steps. */
static void probe(struct driver *driver)
{
    driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
    if ((!driver->field.has_any) || (!views_search(driver))) {
        return;
    }
    driver->view_backs = 0u;
    if (driver->view_cost != FIELD_NO_PATH) {
        recovery_begin(driver, RECOVERY_VIEW);
    } else {
        recovery_no_view(driver);
    }
}

/* Something has come on to the path: somebody crosses it. While the robot stands, what they leave
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
        (field_weight(&driver->field, driver->crossing) == FIELD_CLOSED)) {
        driver->crossed_back = true;
        driver->back_mm = CROSSED_BACK_MM;
        recovery_begin(driver, RECOVERY_BACK);
    }
    return true;
}

/* Along the path to the goal, and what to do where nothing leads on. */
static struct motion go_on(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    uint32_t patience;
    if (!driver->field.has_any) {
        return motion;
    }
    if (waits_for_crossing(driver)) {
        driver->why = (uint8_t)DRIVER_WHY_WAITS;
        return motion;
    }
    motion = go(driver, limits);
    if (is_moving(motion)) {
        driver->stuck = 0u;
        return motion;
    }
    driver->stuck++;
    patience = (driver->why == DRIVER_WHY_UNSEEN) ? STUCK_UNSEEN : STUCK_BLOCKED;
    if (driver->stuck >= patience) {
        recovery_stuck(driver);
    }
    return motion;
}

struct motion manoeuvre(struct driver *driver, const struct limits *limits)
{
    driver->since++;
    switch (driver->recovery) {
    case RECOVERY_LOOK:
        return look(driver, limits);
    case RECOVERY_BACK:
        return back(driver, limits);
    case RECOVERY_FACE:
        return face(driver, limits);
    case RECOVERY_PASS:
        return pass(driver, limits);
    case RECOVERY_VIEW:
        return view(driver, limits);
    case RECOVERY_PROBE:
        probe(driver);
        return standing;
    case RECOVERY_WAIT:
        driver->why = (uint8_t)DRIVER_WHY_WAITS;
        if (driver->since > WAIT_STEPS) {
            recovery_begin(driver, RECOVERY_NONE);
        }
        return standing;
    default:
        return go_on(driver, limits);
    }
}
