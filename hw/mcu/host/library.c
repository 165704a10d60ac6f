/* The header as a shared library for other languages: a receiver behind a handle.
 *
 * Counts what came of each frame, checks each digest, keeps the newest stop zone and the pieces of
 * tiles. Only the standard library of a host is used beyond the header.
 */
#include <stdlib.h>

#define MAPOD_LINK_AUTH
#ifndef MAPOD_LINK_LEFT_SESSIONS
#define MAPOD_LINK_LEFT_SESSIONS 65536u /* conformance tests are full of new runs */
#endif
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#define KINDS 19
#define REASONS 8
#define PIECES 256

struct piece {
    uint16_t id;
    uint16_t width;
    uint16_t height;
    uint16_t count;
    uint16_t cell_mm;
    int16_t i;
    int16_t j;
    uint8_t layer;
    uint8_t status;
    uint8_t geom_id;
    uint32_t first;
    int32_t values[1392]; /* four classes a byte of the longest frame */
};

struct receiver {
    struct mapod_link link;
    struct mapod_talk talk;
    struct mapod_zone zone;
    uint8_t key[32];
    uint32_t accepted[KINDS]; /* by outcome */
    uint32_t rejected[REASONS]; /* by minus the outcome */
    uint32_t newest_piece; /* counts pieces; they stand in a ring */
    struct piece pieces[PIECES];
#ifdef MAPOD_LINK_OBJECTS
    struct mapod_objects objects;
    struct mapod_path path;
#endif
    uint8_t cells[];
};

/* `key` is NULL or 32 bytes. NULL: no memory. */
struct receiver *receiver_new(uint32_t max_cells, uint32_t nonce, const uint8_t *key,
                              int poll_only, int keeps_map)
{
    const size_t bytes = (keeps_map != 0) ? MAPOD_CELL_BYTES(max_cells, 1) : 0u;
    struct receiver *const self = calloc(1, sizeof *self + bytes);
    if (self == NULL) {
        return NULL;
    }
    mapod_link_init(&self->link, (keeps_map != 0) ? self->cells : NULL, max_cells);
    mapod_talk_init(&self->talk, nonce, poll_only != 0);
    if (key != NULL) {
        memcpy(self->key, key, sizeof self->key);
        mapod_link_set_key(&self->link, self->key, nonce);
    }
    return self;
}

void receiver_free(struct receiver *self)
{
    free(self);
}

static void keep_piece(struct receiver *self)
{
    struct piece *const piece = &self->pieces[self->newest_piece % PIECES];
    struct mapod_tile tile;
    uint32_t k;
    if (!mapod_tile_from(&self->link, &tile)) {
        return;
    }
    piece->id = tile.id;
    piece->width = tile.width;
    piece->height = tile.height;
    piece->count = tile.count;
    piece->cell_mm = tile.cell_mm;
    piece->i = tile.i;
    piece->j = tile.j;
    piece->layer = tile.layer;
    piece->status = tile.status;
    piece->geom_id = tile.geom_id;
    piece->first = tile.first;
    for (k = 0; k < tile.count; k++) {
        piece->values[k] = mapod_tile_value(&tile, k);
    }
    self->newest_piece++;
}

static int note(struct receiver *self, int outcome)
{
    if (outcome < 0) {
        self->rejected[-outcome]++;
    } else if (outcome > 0) {
        self->accepted[outcome]++;
    }
    if (outcome == MAPOD_DIGEST) {
        (void)mapod_link_check_digest(&self->link);
    } else if (outcome == MAPOD_STOP_ZONE) {
        (void)mapod_zone_from(&self->link, &self->zone);
    } else if (outcome == MAPOD_TILE) {
        keep_piece(self);
    }
#ifdef MAPOD_LINK_OBJECTS
    if (outcome == MAPOD_OBJECTS) {
        (void)mapod_objects_from(&self->objects, &self->link);
    } else if (outcome == MAPOD_PATH) {
        (void)mapod_path_from(&self->path, &self->link);
    }
#endif
    return outcome;
}

int receiver_datagram(struct receiver *self, uint32_t now_ms, const uint8_t *data, uint32_t size)
{
    return note(self, mapod_link_datagram(&self->link, now_ms, data, size));
}

/* Feeds bytes up to and with the first that completes a frame; gives how many, and what came. */
uint32_t receiver_stream(struct receiver *self, uint32_t now_ms, const uint8_t *data,
                         uint32_t size, int *outcome)
{
    uint32_t at = 0;
    *outcome = 0;
    while (at < size && *outcome == 0) {
        *outcome = note(self, mapod_link_byte(&self->link, now_ms, data[at]));
        at++;
    }
    return at;
}

/* All cells of the window, one a byte, row-major. */
void receiver_window(const struct receiver *self, uint8_t *cells)
{
    uint32_t row, column, at = 0;
    for (row = 0; row < self->link.geom.height; row++) {
        for (column = 0; column < self->link.geom.width; column++) {
            cells[at] = mapod_link_cell(&self->link, column, row);
            at++;
        }
    }
}

uint32_t receiver_poll(struct receiver *self, uint32_t now_ms, uint8_t *out)
{
    return mapod_talk_poll(&self->talk, &self->link, now_ms, out);
}

uint32_t receiver_hello(struct receiver *self, uint32_t now_ms, uint8_t *out)
{
    return mapod_talk_hello(&self->talk, &self->link, now_ms, out);
}

void receiver_renew(struct receiver *self, uint32_t nonce)
{
    mapod_talk_renew(&self->talk, &self->link, nonce);
}

/* `hold` in 0.1 ms; below 0: as the millisecond clock tells. */
uint32_t receiver_ack(struct receiver *self, uint32_t now_ms, int32_t hold, uint8_t *out)
{
    if (hold < 0) {
        return mapod_talk_ack(&self->talk, &self->link, now_ms, out);
    }
    return mapod_talk_ack_held(&self->talk, &self->link, now_ms, (uint16_t)hold, out);
}

uint32_t receiver_drive(struct receiver *self, uint32_t now_ms, int16_t v_mmps, int16_t w_mradps,
                        uint16_t valid_ms, uint8_t *out)
{
    return mapod_talk_drive(&self->talk, &self->link, now_ms, v_mmps, w_mradps, valid_ms, out);
}

uint32_t receiver_external_pose(struct receiver *self, uint32_t now_ms,
                                const struct mapod_external_pose *pose, uint8_t *out)
{
    return mapod_talk_external_pose(&self->talk, &self->link, now_ms, pose, out);
}

uint32_t receiver_ask(struct receiver *self, uint32_t now_ms, const struct mapod_ask *ask,
                      uint8_t *out)
{
    return mapod_talk_ask(&self->talk, &self->link, now_ms, ask, out);
}

uint32_t receiver_serial(uint8_t *out, uint32_t size)
{
    return mapod_talk_serial(out, size);
}

/* What the receiver asks for with its next ACK, and what it says of itself; `which` by name. */
void receiver_say(struct receiver *self, int which, int on)
{
    if (which == 0) {
        self->talk.stopped = on != 0;
    } else if (which == 1) {
        mapod_p_set(&self->link, MAPOD_P_NEED_FULL, on != 0);
    } else {
        mapod_p_set(&self->link, which == 2 ? MAPOD_P_NEED_GEOM : MAPOD_P_SUSPECT, on != 0);
    }
}

struct state {
    uint32_t session, mask, newest_t_ms, newest_piece;
    uint16_t width, height, cell_mm, tick_ms, stale_ms, last, gap, bad_frames;
    int16_t ox, oy;
    uint8_t geom_id, has_geom, has_pose, blank, suspect, stale, any, need_geom, need_full,
        digest_ok, auth_failed, advice, why, zone_advice;
};

/* Everything small that a receiver knows, as of now. */
void receiver_state(struct receiver *self, uint32_t now_ms, struct state *state)
{
    struct mapod_link *const link = &self->link;
    const struct mapod_geom *const geom = &link->geom;
    memset(state, 0, sizeof *state);
    state->session = geom->session;
    state->mask = link->mask;
    state->newest_t_ms = link->newest_t_ms;
    state->newest_piece = self->newest_piece;
    state->width = geom->width;
    state->height = geom->height;
    state->cell_mm = geom->cell_mm;
    state->tick_ms = geom->tick_ms;
    state->stale_ms = geom->stale_ms;
    state->last = link->last;
    state->gap = link->gap;
    state->bad_frames = link->bad_frames;
    state->ox = mapod_p_signed(link->ox);
    state->oy = mapod_p_signed(link->oy);
    state->geom_id = geom->geom_id;
    state->has_geom = mapod_link_geom(link) != NULL;
    state->has_pose = mapod_link_pose(link) != NULL;
    state->blank = mapod_link_blank(link);
    state->suspect = mapod_link_suspect(link);
    state->stale = mapod_link_stale(link, now_ms);
    state->any = mapod_p_is(link, MAPOD_P_ANY);
    state->need_geom = mapod_p_is(link, MAPOD_P_NEED_GEOM);
    state->need_full = mapod_p_is(link, MAPOD_P_NEED_FULL);
    state->digest_ok = mapod_p_is(link, MAPOD_P_DIGEST_OK);
    state->auth_failed = mapod_p_is(link, MAPOD_P_AUTH_FAILED);
    state->advice = (uint8_t)mapod_link_advice(link, now_ms);
    state->why = (uint8_t)mapod_link_why(link, now_ms);
    state->zone_advice = (uint8_t)mapod_zone_advice(&self->zone, link, now_ms);
}

uint32_t receiver_digest(const struct receiver *self)
{
    return mapod_link_geom(&self->link) != NULL ? mapod_link_digest(&self->link) : 0u;
}

uint8_t receiver_at(const struct receiver *self, int32_t x_mm, int32_t y_mm)
{
    return mapod_link_at(&self->link, x_mm, y_mm);
}

const struct mapod_pose *receiver_pose(const struct receiver *self)
{
    return mapod_link_pose(&self->link);
}

const struct mapod_zone *receiver_zone(const struct receiver *self)
{
    return &self->zone;
}

const struct piece *receiver_piece(const struct receiver *self, uint32_t number)
{
    return &self->pieces[number % PIECES];
}

const uint32_t *receiver_accepted(const struct receiver *self)
{
    return self->accepted;
}

const uint32_t *receiver_rejected(const struct receiver *self)
{
    return self->rejected;
}

#ifdef MAPOD_LINK_OBJECTS

struct vectors {
    uint32_t count, told, waiting, digest, look_ms, missing;
    uint16_t number, total, segments, ahead, left_out;
    uint8_t objects_worth, path_worth;
};

/* What is known of objects and path, as of now. */
void receiver_vectors(struct receiver *self, uint32_t now_ms, struct vectors *out)
{
    out->objects_worth = (uint8_t)mapod_objects_worth(&self->objects, &self->link, now_ms);
    out->path_worth = (uint8_t)mapod_path_worth(&self->path, &self->link, now_ms);
    out->count = self->objects.count;
    out->told = self->objects.told;
    out->waiting = self->objects.waiting;
    out->digest = self->objects.digest;
    out->look_ms = self->objects.look_ms;
    out->missing = self->path.missing;
    out->number = self->path.number;
    out->total = self->path.total;
    out->segments = self->path.segments;
    out->ahead = self->path.ahead;
    out->left_out = self->path.left_out;
}

struct shown {
    uint32_t id, digest, seen_ms;
    int32_t x_mm, y_mm;
    int16_t bottom_mm, top_mm, vx_mmps, vy_mmps;
    int16_t corner_x[64];
    int16_t corner_y[64];
    uint8_t kind, confidence, flags, unit_mm, corners, old;
};

/* Item k of the list. */
void receiver_object(struct receiver *self, uint32_t now_ms, uint32_t k, struct shown *out)
{
    const struct mapod_object *const object = &self->objects.items[k];
    uint32_t i;
    out->id = object->id;
    out->digest = object->digest;
    out->seen_ms = object->seen_ms;
    out->x_mm = object->x_mm;
    out->y_mm = object->y_mm;
    out->bottom_mm = object->bottom_mm;
    out->top_mm = object->top_mm;
    out->vx_mmps = object->vx_mmps;
    out->vy_mmps = object->vy_mmps;
    for (i = 0; i < object->corners; i++) {
        out->corner_x[i] = object->corner_x[i];
        out->corner_y[i] = object->corner_y[i];
    }
    out->kind = object->kind;
    out->confidence = object->confidence;
    out->flags = object->flags;
    out->unit_mm = object->unit_mm;
    out->corners = object->corners;
    out->old = mapod_objects_old(&self->objects, k, now_ms) ? 1u : 0u;
}

struct way_point {
    int32_t x_mm, y_mm;
    uint16_t segment;
    uint8_t kind, here;
};

/* Point k of the path. */
void receiver_way_point(const struct receiver *self, uint32_t k, struct way_point *out)
{
    const struct mapod_path_point *const point = &self->path.points[k];
    out->x_mm = point->x_mm;
    out->y_mm = point->y_mm;
    out->segment = point->segment;
    out->kind = point->kind;
    out->here = point->here ? 1u : 0u;
}

#endif
