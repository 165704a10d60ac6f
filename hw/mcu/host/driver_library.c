/* The planner as a shared library for other languages, for simulations: link and driver behind a
 * handle. Only the standard library of a host is used beyond the planner's own sources.
 */
#include <stdlib.h>

#include "../planner/planner.h"

/* `key` is NULL or 32 bytes. NULL: no memory. */
struct planner *planner_new(const struct driver_settings *settings, uint32_t nonce,
                            const uint8_t *key)
{
    struct planner *const self = malloc(sizeof *self);
    if (self != NULL) {
        planner_init(self, settings, nonce, key);
    }
    return self;
}

void planner_free(struct planner *self)
{
    free(self);
}

void planner_stream(struct planner *self, uint32_t now_ms, const uint8_t *data, uint32_t size)
{
    uint32_t at;
    for (at = 0; at < size; at++) {
        (void)planner_byte(self, now_ms, data[at]);
    }
}

uint32_t planner_serial(uint8_t *out, uint32_t size)
{
    return mapod_talk_serial(out, size);
}

void planner_goal(struct planner *self, int32_t x_mm, int32_t y_mm)
{
    driver_goal(&self->driver, x_mm, y_mm);
}

void planner_halt(struct planner *self)
{
    driver_halt(&self->driver);
}

struct planner_report { /* laid out for ctypes */
    int32_t v_mmps, w_mradps, x_mm, y_mm, goal_x_mm, goal_y_mm, width, height, ox, oy;
    int32_t unseen_x_mm, unseen_y_mm, view_x_mm, view_y_mm;
    int32_t allowed_ahead_mmps, allowed_behind_mmps, known_cells, close_cells;
    uint32_t accepted, way_count, tries;
    uint16_t yaw, bad_frames, last;
    uint8_t state, why, tactic, advice, link_why, zone_state, blank, suspect, stale;
};

/* Everything small that it knows, as of now. */
void planner_report(struct planner *self, uint32_t now_ms, struct planner_report *report)
{
    const struct driver *const driver = &self->driver;
    const struct mapod_geom *const geom = mapod_link_geom(&self->link);
    const struct mapod_pose *const pose = mapod_link_pose(&self->link);
    memset(report, 0, sizeof *report);
    report->v_mmps = driver->asked.v_mmps;
    report->w_mradps = driver->asked.w_mradps;
    report->x_mm = (pose == NULL) ? 0 : pose->x_mm;
    report->y_mm = (pose == NULL) ? 0 : pose->y_mm;
    report->yaw = (pose == NULL) ? 0u : turn_from_link(pose->yaw);
    report->goal_x_mm = driver->goal.x_mm;
    report->goal_y_mm = driver->goal.y_mm;
    report->width = (geom == NULL) ? 0 : geom->width;
    report->height = (geom == NULL) ? 0 : geom->height;
    report->ox = (int16_t)self->link.ox;
    report->oy = (int16_t)self->link.oy;
    report->unseen_x_mm = driver->unseen.x_mm;
    report->unseen_y_mm = driver->unseen.y_mm;
    report->view_x_mm = driver->view.x_mm;
    report->view_y_mm = driver->view.y_mm;
    report->allowed_ahead_mmps = self->zone.allowed_ahead_mmps;
    report->allowed_behind_mmps = self->zone.allowed_behind_mmps;
    report->known_cells = (int32_t)driver->known_count;
    report->close_cells = (int32_t)driver->sweep.count;
    report->accepted = self->accepted;
    report->way_count = driver->way_count;
    report->tries = driver->tries;
    report->bad_frames = self->link.bad_frames;
    report->last = self->link.last;
    report->state = driver->state;
    report->why = driver->why;
    report->tactic = driver->tactic;
    report->advice = (uint8_t)mapod_link_advice(&self->link, now_ms);
    report->link_why = (uint8_t)mapod_link_why(&self->link, now_ms);
    report->zone_state = self->zone.state;
    report->blank = mapod_link_blank(&self->link);
    report->suspect = mapod_link_suspect(&self->link);
    report->stale = mapod_link_stale(&self->link, now_ms);
}

/* The way as the driver sees it: x, y in mm, and whether it is only hoped for; 3 numbers each. */
uint32_t planner_way(const struct planner *self, int32_t *numbers, uint32_t room)
{
    const uint32_t count = (self->driver.way_count < room) ? self->driver.way_count : room;
    uint32_t k;
    for (k = 0; k < count; k++) {
        numbers[3u * k] = self->driver.way[k].x_mm;
        numbers[3u * k + 1u] = self->driver.way[k].y_mm;
        numbers[3u * k + 2u] = self->driver.way[k].soft ? 1 : 0;
    }
    return count;
}

/* All cells of the window, one a byte, row-major. */
void planner_window(const struct planner *self, uint8_t *cells)
{
    uint32_t row, column, at = 0;
    for (row = 0; row < self->link.geom.height; row++) {
        for (column = 0; column < self->link.geom.width; column++) {
            cells[at] = mapod_link_cell(&self->link, column, row);
            at++;
        }
    }
}
