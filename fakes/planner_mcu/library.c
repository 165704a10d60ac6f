/* The planner as a shared library for other languages, for simulations: link and driver behind a
 * handle. Only the standard library of a host is used beyond the planner's own sources.
 */
#include <stdlib.h>

#include "planner.h"

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
    uint32_t accepted, tries;
    uint16_t yaw, bad_frames;
    uint8_t state, why, recovery, advice, link_why, blank, suspect, stale;
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
    report->yaw = (pose == NULL) ? 0u : angle_from_link(pose->yaw);
    report->goal_x_mm = driver->goal.x_mm;
    report->goal_y_mm = driver->goal.y_mm;
    report->width = (geom == NULL) ? 0 : geom->width;
    report->height = (geom == NULL) ? 0 : geom->height;
    report->ox = (int16_t)self->link.ox;
    report->oy = (int16_t)self->link.oy;
    report->accepted = self->accepted;
    report->tries = driver->tries;
    report->bad_frames = self->link.bad_frames;
    report->state = driver->state;
    report->why = driver->why;
    report->recovery = driver->recovery;
    report->advice = (uint8_t)mapod_link_advice(&self->link, now_ms);
    report->link_why = (uint8_t)mapod_link_why(&self->link, now_ms);
    report->blank = mapod_link_blank(&self->link);
    report->suspect = mapod_link_suspect(&self->link);
    report->stale = mapod_link_stale(&self->link, now_ms);
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
