/* Coverage-guided fuzzing of the header: libFuzzer's bytes become frames, and must do no harm.
 *
 * The input is a list of pieces: a byte that says how the piece is fed, two bytes of length, bytes.
 * Most pieces are made into whole frames (version, sequence, CRC put right), so that bodies are
 * reached. Each piece goes to a receiver of datagrams, one of a serial line, one with a key, and one
 * that has no memory for a map. Held after each: a rejected or ignored frame changes no cell; no cell
 * outside the map's memory is written; cells are 0 to 2; the map is empty while blank.
 * With FUZZ_MAIN it is a program of its own, for any compiler; inputs are the files it is given.
 */
#include <stdio.h>
#include <stdlib.h>

#define MAPOD_LINK_AUTH
#define MAPOD_LINK_OBJECTS
#define MAPOD_OBJECTS_MAX 6u
#define MAPOD_CORNERS_MAX 8u
#define MAPOD_PATH_MAX 20u
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#define MOST_CELLS 900u
#define CELL_BYTES MAPOD_CELL_BYTES(MOST_CELLS, 1)
#define KINDS 4u /* datagram, serial, keyed, without a map */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct end {
    struct mapod_link link;
    struct mapod_talk talk;
    struct mapod_zone zone;
    struct mapod_objects objects;
    struct mapod_path path;
    uint8_t *cells; /* of its own, so that the sanitizer sees each byte beyond it */
    uint8_t before[CELL_BYTES];
};

static const uint8_t key[32] = {1, 2, 3};

#define must(holds) must_hold((holds), __LINE__)

static void must_hold(bool holds, int line)
{
    if (!holds) {
        (void)fprintf(stderr, "fuzz.c:%d does not hold\n", line);
        abort();
    }
}

/* Objects and the path: no more than there is room for, and none while nothing was told. */
static void look_at_vectors(struct end *end, uint32_t now_ms)
{
    struct mapod_objects *const objects = &end->objects;
    uint32_t digest = 0, k;
    (void)mapod_objects_from(objects, &end->link);
    (void)mapod_path_from(&end->path, &end->link);
    must(objects->count <= MAPOD_OBJECTS_MAX);
    for (k = 0; k < objects->count; k++) {
        must(objects->items[k].corners >= 3u && objects->items[k].corners <= MAPOD_CORNERS_MAX);
        digest += objects->items[k].digest;
        (void)mapod_objects_old(objects, k, now_ms);
    }
    must(digest == objects->digest);
    if (mapod_objects_worth(objects, &end->link, now_ms) == MAPOD_WORTH_KNOWN) {
        must(objects->count == objects->told && mapod_link_geom(&end->link) != NULL);
    }
    must(objects->any || objects->count == 0u);
    if (mapod_path_worth(&end->path, &end->link, now_ms) == MAPOD_WORTH_KNOWN) {
        must(end->path.number != 0u && end->path.missing == 0u);
    }
    must(end->path.missing <= MAPOD_PATH_MAX);
}

static void look(struct end *end, uint32_t now_ms, int outcome)
{
    const struct mapod_geom *const geom = mapod_link_geom(&end->link);
    uint8_t out[MAPOD_OUT_MAX];
    struct mapod_tile tile;
    uint32_t row, column, seen = 0;
    if (outcome <= 0) {
        must(memcmp(end->cells, end->before, CELL_BYTES) == 0);
    }
    if (outcome == MAPOD_DIGEST) {
        (void)mapod_link_check_digest(&end->link);
    }
    (void)mapod_zone_from(&end->link, &end->zone);
    (void)mapod_zone_advice(&end->zone, &end->link, now_ms);
    if (mapod_tile_from(&end->link, &tile)) {
        for (column = 0; column <= tile.count; column++) {
            (void)mapod_tile_value(&tile, column);
        }
    }
    look_at_vectors(end, now_ms);
    if (geom != NULL) {
        must((uint32_t)geom->width * geom->height <= MOST_CELLS);
        for (row = 0; row < geom->height; row++) {
            for (column = 0; column < geom->width; column++) {
                const uint8_t cell = mapod_link_cell(&end->link, column, row);
                must(cell <= MAPOD_OBSTACLE);
                seen |= cell;
            }
        }
        must(mapod_link_cell(&end->link, geom->width, 0) == MAPOD_UNKNOWN);
        (void)mapod_link_at(&end->link, (int32_t)now_ms, -(int32_t)(now_ms & 0xFFFFFu));
    }
    must(!mapod_link_blank(&end->link) || seen == 0u);
    must(mapod_link_blank(&end->link) || end->link.cells != NULL);
    if (mapod_link_advice(&end->link, now_ms) != MAPOD_STOP) {
        must(!mapod_link_blank(&end->link) && !mapod_link_stale(&end->link, now_ms));
    }
    must(mapod_talk_poll(&end->talk, &end->link, now_ms, out) <= MAPOD_OUT_MAX);
    memcpy(end->before, end->cells, CELL_BYTES);
}

/* Makes a whole frame of a piece, if `way` says so; gives its size. */
static uint32_t frame_of(const struct mapod_link *link, uint8_t way, uint16_t seq, uint32_t now_ms,
                         uint8_t *frame, uint32_t size)
{
    const bool tagged = link->key != NULL && (way & 0x10u) != 0u;
    if ((way & 0x80u) != 0u || size < MAPOD_P_HEAD) {
        return size; /* as it is: noise */
    }
    frame[0] = (uint8_t)(0x10u | (frame[0] & 15u));
    frame[1] = tagged ? MAPOD_P_AUTH : 0u;
    if ((way & 0x40u) == 0u) {
        mapod_p_put16(&frame[2], seq);
        mapod_p_put32(&frame[4], now_ms);
    }
    if (tagged) {
        const bool geom = (frame[0] & 15u) == (uint8_t)MAPOD_GEOM && size == 24u;
        const uint32_t session = geom ? mapod_p_u32(&frame[16]) : link->geom.session;
        mapod_p_tag(link, session, frame, size, &frame[size]);
        size += 8u;
    }
    mapod_p_put32(&frame[size], mapod_p_crc(MAPOD_P_CRC_START, frame, size));
    return size + 4u;
}

/* COBS, for frames of any length. */
static uint32_t cobs(const uint8_t *frame, uint32_t size, uint8_t *line)
{
    uint32_t code_at = 0u, at = 1u, i;
    uint8_t code = 1u;
    for (i = 0; i < size; i++) {
        if (frame[i] != 0u) {
            line[at] = frame[i];
            at++;
            code++;
        }
        if (frame[i] == 0u || code == 255u) {
            line[code_at] = code;
            code_at = at;
            at++;
            code = 1u;
        }
    }
    line[code_at] = code;
    line[at] = 0u;
    return at + 1u;
}

static void feed(struct end *end, uint32_t kind, uint8_t way, uint16_t seq, uint32_t now_ms,
                 const uint8_t *piece, uint32_t size)
{
    uint8_t frame[MAPOD_FRAME_MAX + 32u];
    uint8_t line[MAPOD_FRAME_MAX + 40u];
    uint32_t i;
    memcpy(frame, piece, size);
    size = frame_of(&end->link, way, seq, now_ms, frame, size);
    if (kind != 1u) {
        look(end, now_ms, mapod_link_datagram(&end->link, now_ms, frame, size));
        return;
    }
    size = cobs(frame, size, line);
    if ((way & 0x20u) != 0u) {
        line[(uint32_t)seq % size] ^= (uint8_t)(1u + (way & 15u)); /* damage on the line */
    }
    for (i = 0; i < size; i++) {
        const int outcome = mapod_link_byte(&end->link, now_ms, line[i]);
        if (outcome != MAPOD_NOTHING || i + 1u == size) {
            look(end, now_ms, outcome);
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct end ends[KINDS];
    uint32_t now_ms = 0xFFFFF000u; /* the clock wraps on the way */
    uint16_t seq = 0xFFF0u;
    size_t at = 0;
    uint32_t kind;
    for (kind = 0; kind < KINDS; kind++) {
        struct end *const end = &ends[kind];
        memset(end, 0, sizeof *end);
        end->cells = calloc(1, CELL_BYTES);
        mapod_link_init(&end->link, (kind == 3u) ? NULL : end->cells, MOST_CELLS);
        mapod_talk_init(&end->talk, 7u, kind == 3u);
        if (kind == 2u) {
            mapod_link_set_key(&end->link, key, 7u);
        }
    }
    while (at + 3u <= size) {
        const uint8_t way = data[at];
        uint32_t length = (uint32_t)data[at + 1u] | ((uint32_t)(data[at + 2u] & 1u) << 8);
        at += 3u;
        length = length > size - at ? (uint32_t)(size - at) : length;
        length = length > MAPOD_FRAME_MAX ? MAPOD_FRAME_MAX : length;
        now_ms += (way & 8u) != 0u ? 70000u : way & 7u;
        seq = (uint16_t)(seq + 1u + ((way & 4u) != 0u ? way : 0u));
        for (kind = 0; kind < KINDS; kind++) {
            feed(&ends[kind], kind, way, seq, now_ms, &data[at], length);
        }
        at += length;
    }
    for (kind = 0; kind < KINDS; kind++) {
        free(ends[kind].cells);
    }
    return 0;
}

#ifdef FUZZ_MAIN
int main(int count, char **names)
{
    static uint8_t bytes[1u << 16];
    int i;
    for (i = 1; i < count; i++) {
        FILE *const file = fopen(names[i], "rb");
        size_t size;
        if (file == NULL) {
            return 2;
        }
        size = fread(bytes, 1, sizeof bytes, file);
        (void)fclose(file);
        (void)LLVMFuzzerTestOneInput(bytes, size);
    }
    (void)printf("%d inputs\n", count - 1);
    return 0;
}
#endif
