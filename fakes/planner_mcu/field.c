/* Costs from the goal outwards, cheapest first. */
#include "field.h"

#include "field_weights.h"

#define NOBODY 0xFFFFu
#define STRAIGHT 5u /* steps to a neighbour, times its weight */
#define DIAGONAL 7u
#define OPEN_COST 20u  /* of one cell of open ground */
#define OUTSIDE_COST 35u /* of one cell beyond the window, of which nothing is known */
#define BEYOND 800u    /* cost that is worked out beyond the robot's own cell */

static struct layer *layer_in_work(struct field *field)
{
    return &field->layers[1u - field->now];
}

void field_clear(struct field *field)
{
    field->has_any = false;
    field->is_busy = false;
}

uint32_t field_cost_of_m(const struct field *field)
{
    return (OPEN_COST * 1000u) / (uint32_t)field->layers[field->now].frame.cell_mm;
}

/* Into the bucket of its new cost, and out of the one where it was. */
static void queue(struct field *field, struct layer *layer, uint32_t at, uint32_t cost)
{
    uint16_t *const head = &field->heads[cost % FIELD_BUCKETS];
    if (layer->cost[at] != FIELD_NO_PATH) {
        const uint16_t before = field->previous[at];
        const uint16_t after = field->next[at];
        if (before == NOBODY) {
            field->heads[layer->cost[at] % FIELD_BUCKETS] = after;
        } else {
            field->next[before] = after;
        }
        if (after != NOBODY) {
            field->previous[after] = before;
        }
    } else {
        field->queued++;
    }
    layer->cost[at] = (uint16_t)cost;
    field->next[at] = *head;
    field->previous[at] = NOBODY;
    if (*head != NOBODY) {
        field->previous[*head] = (uint16_t)at;
    }
    *head = (uint16_t)at;
}

static void offer(struct field *field, struct layer *layer, uint32_t at, uint32_t cost)
{
    if (((uint32_t)layer->weight[at] != FIELD_CLOSED) && (cost < layer->cost[at])) {
        queue(field, layer, at, cost);
    }
}

/* Goal cells within the window; false: none of them is open. */
static bool seed_goal(struct field *field, struct layer *layer, const struct field_task *task)
{
    const struct frame *const frame = &layer->frame;
    const int32_t reach = (task->radius_mm / frame->cell_mm) + 1;
    const int32_t at_i = cell_of(frame, task->goal.x_mm) - frame->column0;
    const int32_t at_j = cell_of(frame, task->goal.y_mm) - frame->row0;
    int32_t i, j;
    for (j = most(0, at_j - reach); j <= least(frame->height - 1, at_j + reach); j++) {
        for (i = most(0, at_i - reach); i <= least(frame->width - 1, at_i + reach); i++) {
            const int32_t away_mm = apart_mm(middle_at(frame, i, j), task->goal);
            if ((away_mm <= task->radius_mm) || ((i == at_i) && (j == at_j))) {
                offer(field, layer, (uint32_t)((j * frame->width) + i),
                      ((uint32_t)away_mm * OPEN_COST) / (uint32_t)frame->cell_mm);
            }
        }
    }
    return field->queued > 0u;
}

/* A goal beyond the window: every cell at its edge, by how far the goal is from there. */
static void seed_edge(struct field *field, struct layer *layer, const struct field_task *task)
{
    const struct frame *const frame = &layer->frame;
    uint32_t nearest = 0xFFFFFFFFu;
    uint32_t pass;
    int32_t i, j;
    for (pass = 0u; pass < 2u; pass++) { /* to find the nearest; to enter all */
        for (j = 0; j < frame->height; j++) {
            const bool all = (j == 0) || (j == (frame->height - 1));
            const int32_t step = (all || (frame->width < 2)) ? 1 : (frame->width - 1);
            for (i = 0; i < frame->width; i += step) {
                const int32_t away_mm = apart_mm(middle_at(frame, i, j), task->goal);
                const uint32_t cost =
                    ((uint32_t)away_mm * OUTSIDE_COST) / (uint32_t)frame->cell_mm;
                if (pass == 0u) {
                    nearest = (cost < nearest) ? cost : nearest;
                } else if ((cost - nearest) < (FIELD_BUCKETS - 300u)) {
                    offer(field, layer, (uint32_t)((j * frame->width) + i), cost - nearest);
                }
            }
        }
    }
}

bool field_begin(struct field *field, const struct ground *ground, const struct field_task *task)
{
    struct layer *const layer = layer_in_work(field);
    const uint32_t count = (uint32_t)(ground->frame.width * ground->frame.height);
    uint32_t at;
    if (count > FIELD_CELLS) {
        return false;
    }
    layer->frame = ground->frame;
    layer->goal_is_closed = false;
    field_weigh(layer, field->next, ground, task);
    for (at = 0u; at < count; at++) {
        layer->cost[at] = FIELD_NO_PATH;
    }
    for (at = 0u; at < FIELD_BUCKETS; at++) {
        field->heads[at] = NOBODY;
    }
    field->queued = 0u;
    field->level = 0u;
    field->robot_cell = cell_index(&layer->frame, task->robot);
    field->is_busy = true;
    if (cell_index(&layer->frame, task->goal) < 0) {
        seed_edge(field, layer, task);
    } else {
        layer->goal_is_closed = !seed_goal(field, layer, task);
    }
    return true;
}

/* All neighbours of a cell whose cost is final. */
static void expand(struct field *field, struct layer *layer, uint32_t at)
{
    const uint32_t width = (uint32_t)layer->frame.width;
    const uint32_t column = at % width;
    const uint32_t row = at / width;
    const uint32_t cost = layer->cost[at];
    const uint32_t weight = layer->weight[at] & 0x7Fu;
    const bool left = column > 0u;
    const bool right = column < (width - 1u);
    const uint32_t straight = cost + (STRAIGHT * weight);
    const uint32_t diagonal = cost + (DIAGONAL * weight);
    if (diagonal >= FIELD_NO_PATH) {
        return;
    }
    if (left) {
        offer(field, layer, at - 1u, straight);
    }
    if (right) {
        offer(field, layer, at + 1u, straight);
    }
    if (row > 0u) {
        offer(field, layer, at - width, straight);
        if (left) {
            offer(field, layer, at - width - 1u, diagonal);
        }
        if (right) {
            offer(field, layer, at - width + 1u, diagonal);
        }
    }
    if (row < ((uint32_t)layer->frame.height - 1u)) {
        offer(field, layer, at + width, straight);
        if (left) {
            offer(field, layer, at + width - 1u, diagonal);
        }
        if (right) {
            offer(field, layer, at + width + 1u, diagonal);
        }
    }
}

/* Whether the robot's own cell, and what lies somewhat beyond it, is final. */
static bool is_enough(const struct field *field, const struct layer *layer)
{
    const int32_t at = field->robot_cell;
    const uint32_t own = (at < 0) ? FIELD_NO_PATH : layer->cost[at];
    return (own != FIELD_NO_PATH) && (field->level > (own + BEYOND));
}

bool field_work(struct field *field, uint32_t cells)
{
    struct layer *const layer = layer_in_work(field);
    uint32_t left = cells;
    if (!field->is_busy) {
        return false;
    }
    while ((field->queued > 0u) && (left > 0u) && (!is_enough(field, layer))) {
        uint16_t *const head = &field->heads[field->level % FIELD_BUCKETS];
        const uint32_t at = *head;
        if (at == NOBODY) {
            field->level++;
            continue;
        }
        *head = field->next[at];
        if (*head != NOBODY) {
            field->previous[*head] = NOBODY;
        }
        field->queued--;
        expand(field, layer, at);
        left--;
    }
    if (left == 0u) {
        return false;
    }
    field->is_busy = false;
    field->has_any = true;
    field->now = 1u - field->now;
    return true;
}
