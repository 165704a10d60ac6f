/* One step of the driver: what forbids to move, the way, the motion; and the state of the drive. */
#include "driver.h"

#include "tactics.h"

/* What may be tuned. Steps are DRIVER_PERIOD_MS each. */
#define CARE_MM 20            /* more margin than the sender keeps */
#define SLOW_MMPS 150         /* while a cell of the map may be outdated */
#define FASTER_MMPS 60        /* per step: the sender lets speed grow by 0.5 m/s2 */
#define TARGET_MM 2500        /* how far ahead on the way it aims */
#define FRONTIER_MM 500       /* so near to the end of the known way, it is at its end */
#define FIELD_PERIOD 3u       /* steps from one field to the next */
#define FIELD_BUDGET 12000u   /* cells of a field, a step */
#define STUCK_UNSEEN 15u      /* steps until a tactic is begun */
#define STUCK_BLOCKED 40u
#define WAIT_STEPS 60u
#define REFUSED_STEPS 20u     /* asked to move, and not moving */
#define LET_GO_STEPS 4u       /* zero is asked for after that */
#define GOAL_STEPS 6000u      /* for one goal, at most: ten minutes */
#define VIEW_RADIUS_MM 400
#define FACED 2500            /* turns; 14 degrees */
#define LEAVING_MRADPS 150    /* per 100 mm/s of approach to the goal */
#define MOVING_MMPS 20

static const struct motion standing = {0, 0};

void driver_init(struct driver *driver, const struct driver_settings *settings)
{
    (void)memset(driver, 0, sizeof *driver);
    driver->settings = *settings;
    driver->shape.front = settings->front_mm;
    driver->shape.rear = settings->rear_mm;
    driver->shape.half = (settings->width_mm + 1) / 2;
    driver->shape.margin = settings->margin_mm + CARE_MM;
    driver->shape.reach = distance_mm(most(settings->front_mm, settings->rear_mm),
                                      driver->shape.half) + 1;
    field_clear(&driver->field);
}

void driver_goal(struct driver *driver, int32_t x_mm, int32_t y_mm)
{
    driver->goal.x_mm = x_mm;
    driver->goal.y_mm = y_mm;
    driver->state = DRIVER_DRIVING;
    driver->why = DRIVER_WHY_NOTHING;
    driver->steps = 0u;
    driver->tries = 0u;
    driver->refused = 0u;
    driver->paid_mm = 0;
    driver->looked = false;
    driver->disc_count = 0u;
    tactics_begin(driver, TACTIC_GO);
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
        driver->crumb_count = 0u;
        if (driver->state == DRIVER_DRIVING) {
            tactics_give_up(driver, DRIVER_WHY_NEW_SESSION);
        }
    }
    driver->session = geom->session;
    driver->has_session = true;
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
    limits->ahead_mmps = least(driver->settings.max_mmps, zone->allowed_ahead_mmps);
    limits->behind_mmps = least(driver->settings.max_mmps, zone->allowed_behind_mmps);
    limits->turn_mradps = driver->settings.max_mradps;
    limits->unknown_mmps = driver->settings.unknown_mmps;
    if (advice == MAPOD_SLOW) {
        limits->ahead_mmps = least(limits->ahead_mmps, SLOW_MMPS);
        limits->behind_mmps = least(limits->behind_mmps, SLOW_MMPS);
        limits->turn_mradps = least(limits->turn_mradps, 2 * SLOW_MMPS);
    }
    if ((judged == MAPOD_STOP) && ((driver->asked.v_mmps != 0) || (driver->asked.w_mradps != 0))) {
        driver->why = (uint8_t)DRIVER_WHY_ZONE_STOP;
        return false;
    }
    return true;
}

static void take_pose(struct driver *driver, const struct mapod_pose *pose)
{
    driver->place.x_mm = pose->x_mm;
    driver->place.y_mm = pose->y_mm;
    driver->place.yaw = turn_from_link(pose->yaw);
    driver->moves.v_mmps = pose->v_mmps;
    driver->moves.w_mradps = pose->w_mradps;
}

/* ---- the way ---- */

/* What the field in work is to lead to. */
static struct field_task task_of(const struct driver *driver)
{
    struct field_task task = {0, 0, 0, 0, 0, 0, 0, false, NULL, 0u};
    const struct spot to = (driver->tactic == TACTIC_VIEW) ? driver->view : driver->goal;
    task.x_mm = to.x_mm;
    task.y_mm = to.y_mm;
    task.radius_mm = (driver->tactic == TACTIC_VIEW) ? VIEW_RADIUS_MM
                                                     : ((driver->settings.goal_radius_mm * 3) / 4);
    task.robot_x_mm = driver->place.x_mm;
    task.robot_y_mm = driver->place.y_mm;
    task.half_mm = driver->shape.half + driver->settings.margin_mm;
    task.around_mm = driver->shape.reach + driver->settings.margin_mm;
    task.only_free = (driver->tactic == TACTIC_VIEW) || (driver->tactic == TACTIC_PROBE);
    task.discs = driver->discs;
    task.disc_count = (uint32_t)least((int32_t)driver->disc_count, (int32_t)FIELD_DISCS);
    if (driver->tactic == TACTIC_PROBE) { /* from the robot to everywhere */
        task.x_mm = driver->place.x_mm;
        task.y_mm = driver->place.y_mm;
        task.radius_mm = 300;
        task.robot_x_mm = driver->goal.x_mm + 1000000; /* out of the window: all cells are wanted */
    }
    return task;
}

/* Keeps a field in work; false: the window is too large for one. */
static bool work_on_field(struct driver *driver)
{
    struct field *const field = &driver->field;
    driver->field_steps++;
    if (field->is_busy) {
        (void)field_work(field, FIELD_BUDGET);
    } else if ((driver->field_steps >= FIELD_PERIOD) || (!field->has_any)) {
        const struct field_task task = task_of(driver);
        driver->field_steps = 0u;
        if (!field_begin(field, &driver->ground, &task)) {
            return false;
        }
        (void)field_work(field, FIELD_BUDGET);
    } else {
        /* The newest one will do. */
    }
    driver->way_count = field_way(field, driver->place.x_mm, driver->place.y_mm, driver->way,
                                  (uint32_t)(sizeof driver->way / sizeof driver->way[0]));
    return true;
}

/* How many cells of the way are known to be free. */
static uint32_t known_way(const struct driver *driver)
{
    uint32_t k = 0u;
    while ((k < driver->way_count) && (!driver->way[k].soft)) {
        k++;
    }
    return k;
}

/* The farthest place on the known way that a straight line leads to. */
static struct place target_on(const struct driver *driver, uint32_t known)
{
    const struct place *const from = &driver->place;
    struct place target = *from;
    uint32_t k;
    for (k = 0u; k < known; k++) {
        const struct step_cell *const cell = &driver->way[k];
        const int32_t away = distance_mm(cell->x_mm - from->x_mm, cell->y_mm - from->y_mm);
        if ((k > 2u) && ((away > TARGET_MM) ||
                         (!field_is_straight(&driver->field, from->x_mm, from->y_mm, cell->x_mm,
                                             cell->y_mm)))) {
            break;
        }
        target.x_mm = cell->x_mm;
        target.y_mm = cell->y_mm;
    }
    return target;
}

/* ---- motions ---- */

/* As fast as a robot may become from step to step, and so slow that it can stop at the goal. */
static struct motion paced(const struct driver *driver, struct motion motion, int32_t left_mm)
{
    const int32_t now = most(magnitude(driver->asked.v_mmps), magnitude(driver->moves.v_mmps));
    const int32_t stop = root(2 * 300 * most(0, left_mm)) + 60;
    const int32_t wanted = magnitude(motion.v_mmps);
    const int32_t most_v = least(least(wanted, now + FASTER_MMPS), stop);
    if ((wanted > 0) && (most_v < wanted)) {
        motion.v_mmps = (motion.v_mmps * most_v) / wanted;
        motion.w_mradps = (motion.w_mradps * most_v) / wanted;
    }
    return motion;
}

/* Along the way; zero where nothing is worth asking for, and why. */
static struct motion go(struct driver *driver, const struct limits *limits)
{
    const uint32_t known = known_way(driver);
    const struct place target = target_on(driver, known);
    const int32_t left = distance_mm(driver->goal.x_mm - driver->place.x_mm,
                                     driver->goal.y_mm - driver->place.y_mm);
    struct place aim = target;
    if (driver->way_count == 0u) {
        const struct layer *const layer = &driver->field.layers[driver->field.now];
        driver->why = (uint8_t)(layer->goal_is_closed ? DRIVER_WHY_GOAL_BLOCKED
                                                      : DRIVER_WHY_WAITS);
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
        aim.x_mm = (driver->tactic == TACTIC_VIEW) ? driver->view.x_mm : driver->goal.x_mm;
        aim.y_mm = (driver->tactic == TACTIC_VIEW) ? driver->view.y_mm : driver->goal.y_mm;
    }
    driver->last = arcs_choose(&driver->sweep, &driver->field, driver->place, aim, limits,
                               &driver->last);
    if ((driver->last.motion.v_mmps == 0) && (driver->last.motion.w_mradps == 0)) {
        driver->why = (driver->why == DRIVER_WHY_NOTHING) ? (uint8_t)DRIVER_WHY_WAITS : driver->why;
        return standing;
    }
    return paced(driver, driver->last.motion,
                 (driver->tactic == TACTIC_VIEW) ? 100000 : (left - 100));
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
    if ((driver->back_mm > 0) && tactics_crumb(driver, &crumb)) {
        motion = arcs_back(&driver->sweep, driver->place, crumb.x_mm, crumb.y_mm, limits);
    }
    if (motion.v_mmps == 0) {
        tactics_begin(driver, TACTIC_GO);
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
        tactics_begin(driver, TACTIC_GO);
        return standing;
    }
    return arcs_spin(&driver->sweep, wrong, limits);
}

static struct motion view(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    if (distance_mm(driver->view.x_mm - driver->place.x_mm,
                    driver->view.y_mm - driver->place.y_mm) < VIEW_RADIUS_MM) {
        tactics_begin(driver, TACTIC_FACE);
        return standing;
    }
    if (driver->field.has_any) {
        motion = go(driver, limits);
    }
    driver->stuck += ((motion.v_mmps == 0) && (motion.w_mradps == 0)) ? 1u : 0u;
    if ((driver->stuck > STUCK_BLOCKED) || (driver->since > 600u)) {
        tactics_begin(driver, TACTIC_GO);
    }
    driver->why = (uint8_t)DRIVER_WHY_VIEWS;
    return motion;
}

static void probe(struct driver *driver)
{
    driver->why = (uint8_t)DRIVER_WHY_UNSEEN;
    if (!driver->field.has_any) {
        return;
    }
    if (tactics_find_view(driver)) {
        tactics_begin(driver, TACTIC_VIEW);
    } else {
        driver->stuck = 0u;
        tactics_begin(driver, TACTIC_GO);
    }
}

/* Along the way to the goal, and what to do where nothing leads on. */
static struct motion go_on(struct driver *driver, const struct limits *limits)
{
    struct motion motion = {0, 0};
    uint32_t patience = STUCK_BLOCKED;
    if (!driver->field.has_any) {
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

static struct motion act(struct driver *driver, const struct limits *limits)
{
    driver->since++;
    switch (driver->tactic) {
    case TACTIC_LOOK:
        return look(driver, limits);
    case TACTIC_BACK:
        return back(driver, limits);
    case TACTIC_FACE:
        return face(driver, limits);
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

/* Whether a robot that is asked to move does not; then nothing is asked for, for a while. */
static bool is_refused(struct driver *driver)
{
    const bool asked = (driver->asked.v_mmps != 0) || (driver->asked.w_mradps != 0);
    const bool moves = (magnitude(driver->moves.v_mmps) > MOVING_MMPS) ||
                       (magnitude(driver->moves.w_mradps) > (2 * MOVING_MMPS));
    if (driver->refused >= REFUSED_STEPS) {
        driver->refused++;
        if (driver->refused > (REFUSED_STEPS + LET_GO_STEPS)) {
            driver->refused = 0u;
            if (driver->tactic == TACTIC_GO) {
                driver->why = (uint8_t)DRIVER_WHY_REFUSED;
                tactics_stuck(driver);
            } else {
                tactics_begin(driver, TACTIC_GO);
            }
        }
        return true;
    }
    driver->refused = (asked && !moves) ? (driver->refused + 1u) : 0u;
    return false;
}

/* Ends the drive where it is to end. */
static bool is_over(struct driver *driver)
{
    const int32_t left = distance_mm(driver->goal.x_mm - driver->place.x_mm,
                                     driver->goal.y_mm - driver->place.y_mm);
    driver->steps++;
    if (left <= ((driver->settings.goal_radius_mm * 3) / 4)) {
        driver->state = DRIVER_ARRIVED;
        driver->why = DRIVER_WHY_NOTHING;
    } else if (driver->steps > GOAL_STEPS) {
        tactics_give_up(driver, DRIVER_WHY_TOO_LONG);
    } else {
        /* On the way. */
    }
    return driver->state != DRIVER_DRIVING;
}

bool driver_step(struct driver *driver, struct mapod_link *link, struct mapod_zone *zone,
                 uint32_t now_ms)
{
    const struct mapod_pose *const pose = mapod_link_pose(link);
    struct limits limits;
    bool may_go;
    check_session(driver, link);
    if (pose != NULL) {
        take_pose(driver, pose);
    }
    if (driver->state != DRIVER_DRIVING) {
        const bool was_asking = (driver->asked.v_mmps != 0) || (driver->asked.w_mradps != 0);
        driver->asked = standing;
        return was_asking;
    }
    may_go = find_limits(driver, link, zone, now_ms, &limits) && (pose != NULL) &&
             ground_from(&driver->ground, link, driver->place.x_mm, driver->place.y_mm,
                         driver->settings.clear_mm);
    if ((!may_go) || is_over(driver)) {
        driver->asked = standing;
        return true;
    }
    tactics_note_way(driver);
    if (!work_on_field(driver)) {
        tactics_give_up(driver, DRIVER_WHY_WINDOW);
        driver->asked = standing;
        return true;
    }
    sweep_begin(&driver->sweep, &driver->ground, &driver->shape, driver->place);
    driver->asked = is_refused(driver) ? standing : act(driver, &limits);
    return true;
}
