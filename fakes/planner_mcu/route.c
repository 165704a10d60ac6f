/* Keeps the field up, and reads the path from it. */
#include "route.h"

/* What may be tuned. */
#define FIELD_PERIOD 3u       /* steps from one field to the next */
#define FIELD_BUDGET 12000u   /* cells of a field, a step */
#define CROSSED_MM 9000       /* so near, what comes on to the path is waited for */
#define CROSSED_STEPS 15u     /* without more of it */
#define TARGET_MM 8000        /* how far ahead it aims, where a straight line leads there */

/* What the field in work is to lead to. */
static struct field_task task_of(const struct driver *driver)
{
    struct field_task task = {{0, 0}, 0, {0, 0}, 0, 0, false, false, NULL, 0u, NULL, 0u};
    const bool views = driver->recovery == RECOVERY_VIEW;
    task.goal = views ? driver->view : driver->goal;
    task.radius_mm = views ? ROUTE_VIEW_MM : DRIVER_GOAL_MM;
    task.robot = driver->place.at;
    task.half_mm = driver->shape.half + ROBOT_MARGIN_MM;
    task.around_mm = driver->shape.reach + ROBOT_MARGIN_MM;
    task.only_free = views || (driver->recovery == RECOVERY_PROBE);
    task.doubts_obstacles = driver->doubts && (!task.only_free);
    task.discs = driver->discs;
    task.disc_count = (uint32_t)least((int32_t)driver->disc_count, (int32_t)FIELD_DISCS);
    task.before = driver->path;
    task.before_count = driver->field.has_any ? driver->path_count : 0u;
    if (driver->recovery == RECOVERY_PROBE) { /* from the robot to everywhere */
        task.goal = driver->place.at;
        task.radius_mm = 300;
        task.robot.x_mm = driver->goal.x_mm + 1000000; /* out of the window: all cells are wanted */
    }
    return task;
}

/* How many cells of the path are known to be free. */
static uint32_t known_path(const struct driver *driver)
{
    uint32_t k = 0u;
    while ((k < driver->path_count) && (!driver->path[k].soft)) {
        k++;
    }
    return k;
}

/* Notes whether something has come to stand on the known path, where the ground was free. */
static void note_crossing(struct driver *driver)
{
    uint32_t k;
    for (k = 1u; k < driver->known_count; k++) {
        const struct point at = driver->path[k].at;
        if (apart_mm(at, driver->place.at) > CROSSED_MM) {
            return;
        }
        if (field_weight(&driver->field, at) == FIELD_CLOSED) {
            driver->crossing = at;
            driver->crossed = CROSSED_STEPS;
            return;
        }
    }
}

bool route_work(struct driver *driver)
{
    struct field *const field = &driver->field;
    const uint32_t before = field->now;
    const bool had_any = field->has_any;
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
    }
    if (had_any && (field->now != before) && (driver->recovery == RECOVERY_NONE)) {
        note_crossing(driver);
    }
    driver->path_count = field_path(field, driver->place.at, driver->path, DRIVER_PATH);
    driver->known_count = known_path(driver);
    return true;
}

struct point route_target(const struct driver *driver)
{
    const struct point from = driver->place.at;
    struct point target = from;
    /* Where the path keeps off what stands, so does the straight line. */
    int32_t heaviest = 2 * (int32_t)FIELD_ROOM_WEIGHT;
    uint32_t k;
    for (k = 0u; k < driver->known_count; k++) {
        const struct point at = driver->path[k].at;
        heaviest = most(heaviest, (int32_t)field_weight(&driver->field, at));
        if ((k > 2u) &&
            ((apart_mm(at, from) > TARGET_MM) ||
             (!field_is_straight(&driver->field, from, at, (uint32_t)heaviest)))) {
            break;
        }
        target = at;
    }
    return target;
}
