/* A step of the driver: what forbids to move, the path, the motion; and the state of the drive. */
#include "driver.h"

#include "manoeuvres.h"
#include "recovery.h"
#include "route.h"
#include "speed_ramp.h"

/* What may be tuned. Steps are DRIVER_PERIOD_MS each. */
#define CARE_MM 20            /* more margin than the sender keeps */
#define SLOW_MMPS 150         /* while a cell of the map may be outdated */
#define REFUSED_STEPS 20u     /* asked to move, and not moving */
#define LET_GO_STEPS 4u       /* zero is asked for after that */
#define REFUSALS 8u           /* in a row, and the drive is given up */
#define ZONE_STOPS 20u        /* of a robot that stands */
#define UNVOUCHED_MM 1000     /* by which the start that is assumed clear shrinks then */
#define ZONE_OBSTRUCTED 1u    /* causes of the stop zone */
#define ZONE_UNSEEN 2u
#define GOAL_STEPS 6000u      /* for one goal, at most: ten minutes */
#define MOVING_MMPS 20
#define ARRIVING_MMPS 160     /* faster, the goal is not reached before it is nearer: */
#define AT_GOAL_MM 150

#define FARTHEST_MM 40000000 /* from the map's origin: beyond it, sums might not fit */
#define SMALLEST_CELL_MM 10  /* smaller ones are too many about the robot for one step */
#define LARGEST_CELL_MM 1000
#define FASTEST_MMPS 5000
#define WIDEST_CLEAR_MM 30000

static const struct motion standing = {0, 0};

static int32_t within(int32_t number, int32_t low, int32_t high)
{
    return most(low, least(high, number));
}

void driver_init(struct driver *driver, const struct driver_settings *settings)
{
    (void)memset(driver, 0, sizeof *driver);
    driver->settings.clear_mm = within(settings->clear_mm, 0, WIDEST_CLEAR_MM);
    driver->settings.unknown_mmps = within(settings->unknown_mmps, 0, FASTEST_MMPS);
    driver->shape.front = ROBOT_FRONT_MM;
    driver->shape.rear = ROBOT_REAR_MM;
    driver->shape.half = (ROBOT_WIDTH_MM + 1) / 2;
    driver->shape.margin = ROBOT_MARGIN_MM + CARE_MM;
    driver->shape.reach = distance_mm(most(ROBOT_FRONT_MM, ROBOT_REAR_MM), driver->shape.half) + 1;
    field_clear(&driver->field);
}

void driver_goal(struct driver *driver, int32_t x_mm, int32_t y_mm)
{
    driver->goal.x_mm = within(x_mm, -FARTHEST_MM, FARTHEST_MM);
    driver->goal.y_mm = within(y_mm, -FARTHEST_MM, FARTHEST_MM);
    driver->state = DRIVER_DRIVING;
    driver->why = DRIVER_WHY_NOTHING;
    driver->steps = 0u;
    driver->tries = 0u;
    driver->refused = 0u;
    driver->refusals = 0u;
    driver->zone_stops = 0u;
    driver->spent = 0u;
    driver->doubted = 0u;
    driver->turned_back = 0u;
    driver->boxed.x_mm = 2 * FARTHEST_MM; /* nowhere */
    driver->credit_mm = 0;
    driver->looked = false;
    driver->disc_count = 0u;
    driver->hidden = 0u;
    driver->crossed = 0u;
    driver->crossed_back = false;
    driver->looks = 0u;
    driver->viewed_count = 0u;
    driver->farther_mm = 0;
    recovery_begin(driver, RECOVERY_NONE);
}

void driver_halt(struct driver *driver)
{
    driver->state = DRIVER_IDLE;
    driver->why = DRIVER_WHY_HALTED;
    driver->asked = standing;
}

/* ---- what forbids to move ---- */

/* Notes which run of the sender this is; a goal of another run says nothing in this one. */
static void check_session(struct driver *driver, const struct mapod_link *link)
{
    const struct mapod_geom *const geom = mapod_link_geom(link);
    if (geom == NULL) {
        return;
    }
    if (driver->has_session && (geom->session != driver->session)) {
        driver->settings.clear_mm = 0; /* where the new map begins, nothing is assumed */
        driver->crumb_count = 0u;
        if (driver->state == DRIVER_DRIVING) {
            recovery_give_up(driver, DRIVER_WHY_NEW_SESSION);
        }
    }
    driver->session = geom->session;
    driver->has_session = true;
}

static bool does_move(const struct driver *driver)
{
    return (magnitude(driver->moves.v_mmps) > MOVING_MMPS) ||
           (magnitude(driver->moves.w_mradps) > (2 * MOVING_MMPS));
}

/* A sender that stops a standing robot, again and again: the start that is assumed clear shrinks,
 * for it may not know any more where that was, or something else is tried. */
static void note_stop(struct driver *driver, const struct mapod_zone *zone)
{
    const bool is_unseen = (zone->causes & (ZONE_UNSEEN | ZONE_OBSTRUCTED)) == ZONE_UNSEEN;
    driver->zone_stops = does_move(driver) ? 0u : (driver->zone_stops + 1u);
    if (driver->zone_stops < ZONE_STOPS) {
        return;
    }
    driver->zone_stops = 0u;
    if (is_unseen && (driver->settings.clear_mm > 0)) {
        driver->settings.clear_mm = most(0, driver->settings.clear_mm - UNVOUCHED_MM);
    } else {
        driver->why = (uint8_t)DRIVER_WHY_REFUSED;
        recovery_stuck(driver);
    }
}

/* What the link and the sender's stop zone allow; false: nothing at all, and why. */
static bool find_limits(struct driver *driver, struct mapod_link *link, struct mapod_zone *zone,
                        uint32_t now_ms, struct limits *limits)
{
    const enum mapod_advice advice = mapod_link_advice(link, now_ms);
    const enum mapod_advice judged = mapod_zone_advice(zone, link, now_ms);
    if (advice == MAPOD_STOP) {
        driver->why = (uint8_t)mapod_link_why(link, now_ms);
        return false;
    }
    if (zone->state == MAPOD_ZONE_UNKNOWN) {
        driver->why = (uint8_t)DRIVER_WHY_ZONE;
        return false;
    }
    limits->ahead_mmps = least(ROBOT_MAX_MMPS, zone->allowed_ahead_mmps);
    limits->behind_mmps = least(ROBOT_MAX_MMPS, zone->allowed_behind_mmps);
    limits->turn_mradps = ROBOT_MAX_MRADPS;
    limits->unknown_mmps = driver->settings.unknown_mmps;
    if (advice == MAPOD_SLOW) {
        limits->ahead_mmps = least(limits->ahead_mmps, SLOW_MMPS);
        limits->behind_mmps = least(limits->behind_mmps, SLOW_MMPS);
        limits->turn_mradps = least(limits->turn_mradps, 2 * SLOW_MMPS);
    }
    if ((judged == MAPOD_STOP) && is_moving(driver->asked)) {
        driver->why = (uint8_t)DRIVER_WHY_ZONE_STOP;
        note_stop(driver, zone);
        return false;
    }
    return true;
}

/* False: it can't be where the robot is. */
static bool take_pose(struct driver *driver, const struct mapod_pose *pose)
{
    if ((pose == NULL) || (pose->x_mm != within(pose->x_mm, -FARTHEST_MM, FARTHEST_MM)) ||
        (pose->y_mm != within(pose->y_mm, -FARTHEST_MM, FARTHEST_MM))) {
        return false;
    }
    driver->place.at.x_mm = pose->x_mm;
    driver->place.at.y_mm = pose->y_mm;
    driver->place.yaw = angle_from_link(pose->yaw);
    driver->moves.v_mmps = pose->v_mmps;
    driver->moves.w_mradps = pose->w_mradps;
    return true;
}

/* The robot has not moved although it was asked to, and was let go of: asks again, does something
 * else, or gives up. */
static void after_refusal(struct driver *driver)
{
    driver->refused = 0u;
    driver->refusals++;
    if (driver->refusals > REFUSALS) {
        recovery_give_up(driver, DRIVER_WHY_REFUSED);
    } else if (driver->recovery != RECOVERY_NONE) {
        recovery_begin(driver, RECOVERY_NONE);
    } else if ((driver->refusals % 2u) == 0u) {
        driver->why = (uint8_t)DRIVER_WHY_REFUSED;
        recovery_stuck(driver);
    }
}

/* Whether a robot that is asked to move does not; then nothing is asked for, for a while. */
static bool is_refused(struct driver *driver)
{
    if (driver->refused >= REFUSED_STEPS) {
        driver->refused++;
        if (driver->refused > (REFUSED_STEPS + LET_GO_STEPS)) {
            after_refusal(driver);
        }
        return true;
    }
    driver->refused = (is_moving(driver->asked) && !does_move(driver)) ? (driver->refused + 1u) : 0u;
    return false;
}

/* Ends the drive where it is to end. */
static bool is_over(struct driver *driver)
{
    const int32_t left = apart_mm(driver->goal, driver->place.at);
    driver->steps++;
    if ((left <= AT_GOAL_MM) || ((left <= DRIVER_GOAL_MM) &&
                                 (magnitude(driver->moves.v_mmps) <= ARRIVING_MMPS))) {
        driver->state = DRIVER_ARRIVED;
        driver->why = DRIVER_WHY_NOTHING;
    } else if (driver->steps > GOAL_STEPS) {
        recovery_give_up(driver, DRIVER_WHY_TOO_LONG);
    }
    return driver->state != DRIVER_DRIVING;
}

/* Whether all sums and the time of a step suffice for cells of this size. */
static bool can_take(const struct frame *frame)
{
    return frame->cell_mm == within(frame->cell_mm, SMALLEST_CELL_MM, LARGEST_CELL_MM);
}

bool driver_step(struct driver *driver, struct mapod_link *link, struct mapod_zone *zone,
                 uint32_t now_ms)
{
    const struct mapod_pose *const pose = mapod_link_pose(link);
    struct limits limits;
    bool may_go;
    check_session(driver, link);
    may_go = take_pose(driver, pose);
    if (driver->state != DRIVER_DRIVING) {
        const bool was_asking = is_moving(driver->asked);
        driver->asked = standing;
        return was_asking;
    }
    driver->why = may_go ? driver->why : (uint8_t)MAPOD_WHY_POSE_INVALID;
    may_go = may_go && find_limits(driver, link, zone, now_ms, &limits) &&
             ground_from(&driver->ground, link, driver->place.at, driver->settings.clear_mm);
    if ((!may_go) || is_over(driver)) {
        driver->asked = standing;
        return true;
    }
    recovery_drop_crumb(driver);
    if ((!can_take(&driver->ground.frame)) || (!route_work(driver))) {
        recovery_give_up(driver, DRIVER_WHY_WINDOW);
        driver->asked = standing;
        return true;
    }
    sweep_begin(&driver->sweep, &driver->ground, &driver->shape, driver->place);
    driver->asked = is_refused(driver) ? standing
                                       : ramp(driver, manoeuvre(driver, &limits), &limits);
    return true;
}
