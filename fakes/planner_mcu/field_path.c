/* What a finished field says: cost between cells, the path downhill, what is on a straight line. */
#include "field.h"

#define SEEK_CELLS 4 /* about a robot that stands where no path leads from */
#define LOOK_MM 100  /* on a straight line */
#define STEPS 400    /* of a straight line, at most */

static uint32_t cost_of(const struct layer *layer, int32_t i, int32_t j)
{
    const struct frame *const frame = &layer->frame;
    if ((i < 0) || (j < 0) || (i >= frame->width) || (j >= frame->height)) {
        return FIELD_NO_PATH;
    }
    return layer->cost[(j * frame->width) + i];
}

static bool is_soft(const struct layer *layer, int32_t i, int32_t j)
{
    return ((uint32_t)layer->weight[(j * layer->frame.width) + i] & FIELD_SOFT) != 0u;
}

uint32_t field_cost(const struct field *field, struct point at)
{
    const struct layer *const layer = &field->layers[field->now];
    const struct frame *const frame = &layer->frame;
    const int32_t half = frame->cell_mm / 2;
    const int32_t i = cell_of(frame, at.x_mm - half);
    const int32_t j = cell_of(frame, at.y_mm - half);
    const int32_t right = at.x_mm - middle_of(frame, i);
    const int32_t up = at.y_mm - middle_of(frame, j);
    uint32_t sum = 0u;
    uint32_t share = 0u;
    int32_t k;
    for (k = 0; k < 4; k++) {
        const int32_t across = ((k & 1) != 0) ? right : (frame->cell_mm - right);
        const int32_t along = ((k & 2) != 0) ? up : (frame->cell_mm - up);
        const uint32_t cost = cost_of(layer, (i + (k & 1)) - frame->column0,
                                      (j + (k / 2)) - frame->row0);
        if (cost != FIELD_NO_PATH) {
            const uint32_t part = (uint32_t)((across * 16) / frame->cell_mm) *
                                  (uint32_t)((along * 16) / frame->cell_mm);
            sum += part * cost;
            share += part;
        }
    }
    return (share < 64u) ? FIELD_NO_PATH : (sum / share);
}

/* The cell from which the path begins: the own one, or the best near by. False: there is none. */
static bool find_begin(const struct layer *layer, int32_t *column, int32_t *row)
{
    const int32_t i = *column;
    const int32_t j = *row;
    uint32_t best = FIELD_NO_PATH;
    int32_t di, dj;
    if (cost_of(layer, i, j) != FIELD_NO_PATH) {
        return true;
    }
    for (dj = -SEEK_CELLS; dj <= SEEK_CELLS; dj++) {
        for (di = -SEEK_CELLS; di <= SEEK_CELLS; di++) {
            const uint32_t cost = cost_of(layer, i + di, j + dj);
            const uint32_t there = 20u * (uint32_t)root((di * di + dj * dj) * 100) / 10u;
            if ((cost != FIELD_NO_PATH) && ((cost + there) < best)) {
                best = cost + there;
                *column = i + di;
                *row = j + dj;
            }
        }
    }
    return best != FIELD_NO_PATH;
}

/* Moves to the cheapest neighbour; false: there is none cheaper. */
static bool descend(const struct layer *layer, int32_t *column, int32_t *row)
{
    const int32_t i = *column;
    const int32_t j = *row;
    uint32_t best = cost_of(layer, i, j);
    bool found = false;
    int32_t di, dj;
    for (dj = -1; dj <= 1; dj++) {
        for (di = -1; di <= 1; di++) {
            const uint32_t cost = cost_of(layer, i + di, j + dj);
            if (cost < best) {
                best = cost;
                *column = i + di;
                *row = j + dj;
                found = true;
            }
        }
    }
    return found;
}

uint32_t field_path(const struct field *field, struct point from, struct path_cell *path,
                    uint32_t room)
{
    const struct layer *const layer = &field->layers[field->now];
    const struct frame *const frame = &layer->frame;
    int32_t i = cell_of(frame, from.x_mm) - frame->column0;
    int32_t j = cell_of(frame, from.y_mm) - frame->row0;
    uint32_t count = 0u;
    bool on;
    if (!field->has_any) {
        return 0u;
    }
    on = find_begin(layer, &i, &j);
    while (on && (count < room)) {
        path[count].at = middle_at(frame, i, j);
        path[count].soft = is_soft(layer, i, j);
        count++;
        on = descend(layer, &i, &j);
    }
    return count;
}

uint32_t field_weight(const struct field *field, struct point at)
{
    const struct layer *const layer = &field->layers[field->now];
    const int32_t index = cell_index(&layer->frame, at);
    return (index < 0) ? FIELD_CLOSED : layer->weight[index];
}

bool field_has_room(const struct field *field, struct point at)
{
    const uint32_t weight = field_weight(field, at);
    return (weight != FIELD_CLOSED) && (weight <= FIELD_ROOM_WEIGHT);
}

bool field_is_straight(const struct field *field, struct point from, struct point to,
                       uint32_t most_weight)
{
    const int32_t steps = least(STEPS, (apart_mm(from, to) / LOOK_MM) + 1);
    int32_t k;
    for (k = 1; k <= steps; k++) {
        const uint32_t weight = field_weight(field, between(from, to, k, steps));
        if ((weight == FIELD_CLOSED) || ((weight & FIELD_SOFT) != 0u) || (weight > most_weight)) {
            return false;
        }
    }
    return true;
}
