/* mapod_link.h: the planner's end of the planner link, version 1, in C99.
 *
 * Takes the frames that mapod sends (serial or UDP), keeps the obstacle map, the robot's pose and
 * the state of the link, and builds what a planner may say: ACK, HELLO, DRIVE, EXTERNAL_POSE, ASK.
 * No heap, no floating point, no division in the core, no library call but memset and memcpy, no
 * recursion; every loop ends after a number of rounds that was checked before. The time comes with
 * each call. The link is not safety-rated: a safety scanner or bumper must be able to stop the
 * robot without it.
 *
 * HOW TO BUILD IT IN. This file is all of it. Include it where you use it; in exactly one C file,
 * put `#define MAPOD_LINK_IMPLEMENTATION` before the include. Build with -ffunction-sections and
 * link with -Wl,--gc-sections, then what you do not call costs nothing. Where only one C file uses
 * it, put `#define MAPOD_LINK_STATIC` there instead: all functions are `static inline` then.
 * Settings, each to be defined (the same everywhere) before the include:
 *   MAPOD_LINK_AUTH           tags, section 9: + some 0.9 KB of code, 150 bytes of stack
 *   MAPOD_LINK_LEFT_SESSIONS  with AUTH: runs of the sender that can be told as left (8)
 *   MAPOD_FRAME_MAX           longest frame taken, 64 to 368 (368); told to the sender by HELLO
 *   MAPOD_LINK_NO_TILES       no STOP_ZONE and no TILE: their frames count as of unknown type
 *   MAPOD_LINK_OBJECTS        OBJECTS and PATH; without it their frames count as of unknown type
 *   MAPOD_OBJECTS_MAX         with it: objects that there is room for (32)
 *   MAPOD_CORNERS_MAX         with it: corners of one, 4 to 64 (16); of more, its box is kept
 *   MAPOD_PATH_MAX            with it: points of the path that there is room for (256)
 *
 * WHAT TO CALL WHEN (example.c is all of this, ready to be copied).
 *   At start: mapod_link_init, with memory for the map: MAPOD_CELL_BYTES(w, h) gives 2 551 bytes
 *     for 101 x 101 cells, 10 101 for 201 x 201, 40 201 for 401 x 401. mapod_talk_init, with a
 *     random number that is not 0 and differs from start to start.
 *   For each byte from the UART: mapod_link_byte. For each UDP datagram: mapod_link_datagram. Both
 *     tell what came of it, see `enum mapod_outcome`. After MAPOD_DIGEST call
 *     mapod_link_check_digest, after MAPOD_STOP_ZONE mapod_zone_from, after MAPOD_TILE
 *     mapod_tile_from, after MAPOD_OBJECTS mapod_objects_from, after MAPOD_PATH mapod_path_from, at
 *     once: the next byte overwrites them.
 *   Every 10 to 50 ms: mapod_talk_poll; send what it builds (HELLO until the geometry is known,
 *     ACK every 16 frames and every 100 ms). Without a return path leave it out. On a serial line
 *     every frame goes through mapod_talk_serial; over UDP it goes out as it is.
 *   Before every decision to move, and at least once a day: mapod_link_advice, with the time as of
 *     now. It is the table of section 5:
 *
 *     | what is known                            | why (mapod_link_why)  | the planner MUST       |
 *     | ---------------------------------------- | --------------------- | ---------------------- |
 *     | no map or no pose yet                    | BLANK                 | stop                   |
 *     | pose or map has not come for `stale_ms`  | STALE                 | stop                   |
 *     | mode 0, 3 or 4 (4: a replay, a bench)    | MODE                  | stop                   |
 *     | emergency stop is pressed (bit 15)       | OPERATOR_STOP         | stop                   |
 *     | pose or map not valid (bits 4, 5)        | POSE_, MAP_INVALID    | stop                   |
 *     | attitude out of range (bit 9)            | TILTED                | stop                   |
 *     | a drop-off lies in the way (bit 7)       | DROP_OFF              | stop                   |
 *     | the sender's digest is another           | MAP_DIFFERS           | stop, a new map comes  |
 *     | a frame got lost, not yet made good      | SUSPECT               | slow down to a speed   |
 *     |   (an obstacle may be missing)           |                       | from which its own     |
 *     |                                          |                       | sensors can stop it    |
 *     | nothing of this                          | NOTHING               | it may go, on FREE     |
 *
 *     UNKNOWN is not FREE. What lies outside the window is UNKNOWN.
 *
 * THE MAP. A window of width x height cells, aligned with the map frame (x forward at the start, y
 * left, it does not turn with the robot), moves with the robot in whole cells. Column 0 and row 0
 * are at the lowest x and y. mapod_link_cell takes column and row, mapod_link_at a place in the map
 * frame, in mm (right within 32 768 cells of the window). `ox`, `oy` are the endless grid's indices
 * of column 0, row 0, modulo 65 536: the cell (i, j) covers i * cell_mm <= x < (i + 1) * cell_mm.
 *
 * TIME. `now_ms` is any clock that counts milliseconds modulo 2^32 and never goes back. What has
 * become stale stays so until new frames come, whatever the clock does.
 *
 * INTERRUPTS, THREADS. Nothing is locked, nothing is shared between two `struct mapod_link`. All
 * calls for one of them belong into one context. A MAP frame's last byte does all its work: up to
 * a whole map is written, 401 x 401 cells being 40 KB. So let the interrupt or the DMA put bytes
 * into a ring of 400 bytes or more, and feed them from the main loop; a task that only reads may
 * copy `struct mapod_pose` with interrupts off. Feed from the interrupt only small windows.
 *
 * MEMORY (32 bit). struct mapod_link 460 bytes with its frame buffer (with AUTH and 8 left
 * sessions 504), struct mapod_talk 20. Code of init, byte, datagram, cell, pose, suspect, stale and
 * ACK by gcc 12 -Os: 2.1 KB on a Cortex-M3 or M4, 2.3 KB on an M0; tables 80 bytes; STOP_ZONE and
 * TILE 0.1 KB more; all of this file 3.9 KB. Stack 192 bytes at most, 344 with AUTH. With
 * MAPOD_LINK_OBJECTS 1.6 KB of code more, 2.0 KB on an M0; struct mapod_objects 40 bytes and 100 for
 * each object, of 16 corners; struct mapod_path 28 and 12 for each point.
 *
 * OBJECTS, PATH (MAPOD_LINK_OBJECTS): mapod_objects_init and mapod_path_init at start. Before each
 * use mapod_objects_worth or mapod_path_worth: all but MAPOD_WORTH_KNOWN says that something may be
 * missing, gone or elsewhere. What is not in the list is not therefore free: the map alone says
 * that. If MAPOD_WORTH_DIFFERS lasts for 300 ms, mapod_talk_ask with MAPOD_ASK_OBJECTS or
 * MAPOD_ASK_PATH, and again every second.
 *
 * WITH A KEY (MAPOD_LINK_AUTH): mapod_link_set_key after mapod_link_init, the same nonce as for
 * mapod_talk_init. Frames without a valid tag are then dropped, old ones and those of left runs of
 * the sender too. After MAPOD_LINK_LEFT_SESSIONS restarts of the sender no new run is accepted, and
 * the link stays stale: mapod_talk_renew with a new random nonce, at a standstill, mends that.
 *
 * POLL ONLY (`poll_only` of mapod_talk_init): the sender pushes nothing, mapod_talk_ask asks. There
 * is no map but the tiles then (mapod_link_init takes NULL as `cells`, 0xFFFFFFFF as `max_cells`),
 * and mapod_link_advice always says stop: use mapod_zone_advice, and ask for STOP_ZONE and POSE at
 * least three times within MAPOD_ZONE_STALE_MS. When nothing answers for a second, send
 * mapod_talk_hello again: the sender may have started anew.
 *
 * Source: planner link, version 1 (docs/protocols/planner-link.md of mapod).
 */
#ifndef MAPOD_LINK_H
#define MAPOD_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef MAPOD_FRAME_MAX
#define MAPOD_FRAME_MAX 368u
#endif
#if (MAPOD_FRAME_MAX < 64u) || (MAPOD_FRAME_MAX > 368u)
#error "MAPOD_FRAME_MAX must be within 64 to 368"
#endif
#ifndef MAPOD_LINK_LEFT_SESSIONS
#define MAPOD_LINK_LEFT_SESSIONS 8u
#endif
#ifndef MAPOD_ZONE_STALE_MS
#define MAPOD_ZONE_STALE_MS 350u /* three periods of STOP_ZONE and a half */
#endif
#ifndef MAPOD_LINK_API
#ifdef MAPOD_LINK_STATIC
#define MAPOD_LINK_API static inline
#else
#define MAPOD_LINK_API
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define MAPOD_CELL_BYTES(width, height) ((((uint32_t)(width) * (uint32_t)(height)) + 3u) / 4u)
#define MAPOD_OUT_MAX 64u /* bytes: the longest frame that is sent, ready for a serial line */

/* What a cell is. 3 does not occur. */
#define MAPOD_UNKNOWN 0u
#define MAPOD_FREE 1u
#define MAPOD_OBSTACLE 2u

/* mode of a pose; the robot must not move in any but RUNNING and DEGRADED. */
#define MAPOD_MODE_RUNNING 1u
#define MAPOD_MODE_DEGRADED 2u

/* Bits of `health` that make a planner stop; section 3 has the others. */
#define MAPOD_HEALTH_POSE_VALID 0x0010u
#define MAPOD_HEALTH_MAP_VALID 0x0020u
#define MAPOD_HEALTH_DROP_OFF 0x0080u
#define MAPOD_HEALTH_TILTED 0x0200u
#define MAPOD_HEALTH_OPERATOR_STOP 0x8000u

/* What came of a byte or a datagram. Below 0: a frame was rejected, it changed nothing but a count.
 * NOTHING: the frame is not complete, or it was old, repeated, or an echo of an own one. */
enum mapod_outcome {
    MAPOD_BAD_TAG = -7,
    MAPOD_BAD_BODY = -6,
    MAPOD_BAD_FLAGS = -5,
    MAPOD_BAD_VERSION = -4,
    MAPOD_BAD_CRC = -3,
    MAPOD_BAD_LENGTH = -2,
    MAPOD_BAD_COBS = -1,
    MAPOD_NOTHING = 0,
    MAPOD_GEOM = 1, /* from here on: a frame was accepted */
    MAPOD_POSE = 2,
    MAPOD_MAP = 3,
    MAPOD_DIGEST = 4,
    MAPOD_STOP_ZONE = 5,
    MAPOD_TILE = 6,
    MAPOD_OBJECTS = 13,
    MAPOD_PATH = 14,
    MAPOD_UNKNOWN_TYPE = 16,
    MAPOD_FOREIGN_MAP = 17, /* MAP of another geometry: not used, GEOM is asked for */
    MAPOD_TOO_LARGE = 18    /* GEOM of a window that `cells` does not hold: there is no map */
};

enum mapod_advice { MAPOD_STOP = 0, MAPOD_SLOW = 1, MAPOD_GO = 2 };

enum mapod_why {
    MAPOD_WHY_NOTHING = 0,
    MAPOD_WHY_SUSPECT, /* the only one that lets the robot go on, slowly */
    MAPOD_WHY_BLANK,
    MAPOD_WHY_STALE,
    MAPOD_WHY_MODE,
    MAPOD_WHY_OPERATOR_STOP,
    MAPOD_WHY_POSE_INVALID,
    MAPOD_WHY_MAP_INVALID,
    MAPOD_WHY_TILTED,
    MAPOD_WHY_DROP_OFF,
    MAPOD_WHY_MAP_DIFFERS
};

struct mapod_geom { /* laid out as the frame's body */
    uint8_t geom_id;
    uint8_t reserved;
    uint16_t width;  /* cells along x */
    uint16_t height; /* cells along y */
    uint16_t cell_mm;
    uint32_t session;  /* one run of the sender */
    uint16_t tick_ms;  /* nominal period of MAP frames */
    uint16_t stale_ms; /* silence after which the link is stale */
};

struct mapod_pose { /* laid out as the frame's body, but for t_ms */
    int32_t x_mm; /* map frame */
    int32_t y_mm;
    int16_t yaw;   /* 0.0001 rad, counter-clockwise */
    int16_t pitch; /* 0.0001 rad, nose down positive */
    int16_t roll;  /* 0.0001 rad */
    int16_t v_mmps;
    int16_t w_mradps; /* counter-clockwise */
    uint16_t health;
    uint8_t age_scan; /* units of 4 ms; 255: 1020 ms or more */
    uint8_t age_attitude;
    uint8_t age_encoders;
    uint8_t mode;
    uint32_t t_ms; /* the sender's clock */
};

/* The receiver. Its members are for mapod_link's own use, but for `bad_frames` (rejected since
 * start, modulo 65 536), `ox`, `oy` and `last`, which may be read. */
struct mapod_link {
    uint16_t flags;
    uint16_t used;        /* bytes in the buffer; after an accepted frame: of its body */
    struct mapod_geom geom;
    uint16_t base_column; /* where column 0 stands in the ring */
    uint16_t base_row;
    uint16_t ox;
    uint16_t oy;
    uint16_t last;        /* number of the newest accepted frame */
    uint16_t gap;         /* newest frame that may have changed cells unseen, while suspect */
    uint16_t bad_frames;
    uint8_t left;         /* bytes that the COBS block still has */
    uint8_t *cells;
    uint32_t max_cells;
    uint32_t mask;        /* bit i: frame last - 1 - i was accepted */
    uint32_t newest_t_ms; /* the sender's clock */
    uint32_t newest_ms;   /* own clock */
    uint32_t pose_ms;
    uint32_t map_ms;
    struct mapod_pose pose;
#ifdef MAPOD_LINK_OBJECTS
    uint32_t gaps;   /* how often frames were missing */
    uint32_t epochs; /* how often all that was told became void */
#endif
#ifdef MAPOD_LINK_AUTH
    const uint8_t *key; /* 32 bytes, or NULL */
    uint32_t nonce;
    uint32_t left_count;
    uint32_t left_sessions[MAPOD_LINK_LEFT_SESSIONS];
#endif
    uint8_t frame[MAPOD_FRAME_MAX];
};

/* The return path. `stopped` is yours to set: the planner has stopped, nobody shall drive. */
struct mapod_talk {
    uint32_t nonce;
    uint32_t sent_ms; /* newest ACK */
    uint32_t hello_ms;
    uint16_t seq;   /* of the newest frame sent */
    uint16_t acked; /* newest frame that an ACK has told of */
    bool stopped;
    bool poll_only;
    bool said; /* a HELLO has been sent */
};

/* ---- the receiver ---- */

/* Begins anew: blank and stale. `cells` holds `max_cells` cells, MAPOD_CELL_BYTES of them; NULL: no
 * map is kept, and it stays blank. */
MAPOD_LINK_API void mapod_link_init(struct mapod_link *link, uint8_t *cells, uint32_t max_cells);
#ifdef MAPOD_LINK_AUTH
/* 32 bytes, which must stay where they are. Nonce 0 where there is no return path. */
MAPOD_LINK_API void mapod_link_set_key(struct mapod_link *link, const uint8_t *key, uint32_t nonce);
#endif
/* One byte of a serial line; an `enum mapod_outcome`. */
MAPOD_LINK_API int mapod_link_byte(struct mapod_link *link, uint32_t now_ms, uint8_t byte);
/* One datagram of any size; an `enum mapod_outcome`. Not to be mixed with mapod_link_byte. */
MAPOD_LINK_API int mapod_link_datagram(struct mapod_link *link, uint32_t now_ms,
                                       const uint8_t *data, uint32_t size);
/* MAPOD_UNKNOWN, _FREE or _OBSTACLE; UNKNOWN outside the window and while blank. */
MAPOD_LINK_API uint8_t mapod_link_cell(const struct mapod_link *link, uint32_t column,
                                       uint32_t row);
/* The cell at a place of the map frame. */
MAPOD_LINK_API uint8_t mapod_link_at(const struct mapod_link *link, int32_t x_mm, int32_t y_mm);
/* Newest pose, geometry in use; NULL: none yet. */
MAPOD_LINK_API const struct mapod_pose *mapod_link_pose(const struct mapod_link *link);
MAPOD_LINK_API const struct mapod_geom *mapod_link_geom(const struct mapod_link *link);
/* Suspect: some cell may be outdated. Blank: there is no map. Stale: poses or maps are late. */
MAPOD_LINK_API bool mapod_link_suspect(const struct mapod_link *link);
MAPOD_LINK_API bool mapod_link_blank(const struct mapod_link *link);
MAPOD_LINK_API bool mapod_link_stale(struct mapod_link *link, uint32_t now_ms);
/* What the planner must do now, and the first reason for it. */
MAPOD_LINK_API enum mapod_advice mapod_link_advice(struct mapod_link *link, uint32_t now_ms);
MAPOD_LINK_API enum mapod_why mapod_link_why(struct mapod_link *link, uint32_t now_ms);
/* CRC-32 of the window, and its comparison with the DIGEST frame just accepted. A difference that
 * no gap explains asks for a new map, and stops the planner until one agrees. 160 000 cells take
 * some 5 million cycles. */
MAPOD_LINK_API uint32_t mapod_link_digest(const struct mapod_link *link);
MAPOD_LINK_API bool mapod_link_check_digest(struct mapod_link *link);

/* Each builder writes one frame to `out` (MAPOD_OUT_MAX bytes) and gives its size; 0: it can't be
 * built now, or a value is out of its range. On a serial line, mapod_talk_serial comes next. */

/* ---- the return path ---- */

/* Nonce: random, not 0, another one at each start. Poll only: the sender is to push nothing. */
MAPOD_LINK_API void mapod_talk_init(struct mapod_talk *talk, uint32_t nonce, bool poll_only);
/* HELLO or ACK if one is due, else 0: all that a receiver needs to say. */
MAPOD_LINK_API uint32_t mapod_talk_poll(struct mapod_talk *talk, struct mapod_link *link,
                                        uint32_t now_ms, uint8_t *out);
#ifdef MAPOD_LINK_AUTH
/* A new nonce in mid-life: what was signed for the one before is void, runs that were left may be
 * forgotten. The sender learns it by the next HELLO, and begins a new map. */
MAPOD_LINK_API void mapod_talk_renew(struct mapod_talk *talk, struct mapod_link *link,
                                     uint32_t nonce);
#endif
/* HELLO: I have started, this is what I can hold. */
MAPOD_LINK_API uint32_t mapod_talk_hello(struct mapod_talk *talk, const struct mapod_link *link,
                                         uint32_t now_ms, uint8_t *out);
/* ACK as of now; `_held` for who knows better how long ago the newest frame came (0.1 ms). */
MAPOD_LINK_API uint32_t mapod_talk_ack(struct mapod_talk *talk, struct mapod_link *link,
                                       uint32_t now_ms, uint8_t *out);
MAPOD_LINK_API uint32_t mapod_talk_ack_held(struct mapod_talk *talk, struct mapod_link *link,
                                            uint32_t now_ms, uint16_t hold, uint8_t *out);
/* Makes a frame in `out` ready for a serial line, in place: COBS and the zero. Gives the new size,
 * 2 more. For frames of up to 253 bytes. */
MAPOD_LINK_API uint32_t mapod_talk_serial(uint8_t *out, uint32_t size);

/* DRIVE: move so, for valid_ms (1 to 1000) from now; 0 ms: stop now. To be sent again at least
 * three times within valid_ms. 0: no geometry yet, a nonce of 0, or a value out of range. */
MAPOD_LINK_API uint32_t mapod_talk_drive(struct mapod_talk *talk, const struct mapod_link *link,
                                         uint32_t now_ms, int16_t v_mmps, int16_t w_mradps,
                                         uint16_t valid_ms, uint8_t *out);

#define MAPOD_NO_YAW (-32767 - 1)

/* Where a positioning system saw the robot, in that system's own frame. To be set to 0 as a whole
 * first: fields that the caller does not know of then tell nothing. */
struct mapod_external_pose {
    int32_t x_mm; /* of the point on the ground under the middle of the drive axle */
    int32_t y_mm;
    int16_t yaw; /* 0.0001 rad, -31 416 to 31 415; MAPOD_NO_YAW: not known */
    uint16_t sigma_x_mm;
    uint16_t sigma_y_mm;
    int16_t correlation; /* of the errors of x and y, 0.0001 */
    uint16_t sigma_yaw;  /* 0.0001 rad */
    uint16_t age_ms;     /* how long ago the robot was there, up to 1000 */
    uint16_t sigma_z_mm; /* 0: nothing below is known, and the frame is the short one */
    int32_t z_mm;        /* up */
    int16_t pitch;       /* 0.0001 rad, nose down positive; MAPOD_NO_YAW, and in roll: not known */
    int16_t roll;        /* right side down positive */
    uint16_t sigma_tilt; /* of both, 0.0001 rad */
};

/* EXTERNAL_POSE; 0 as for DRIVE. */
MAPOD_LINK_API uint32_t mapod_talk_external_pose(struct mapod_talk *talk,
                                                 const struct mapod_link *link, uint32_t now_ms,
                                                 const struct mapod_external_pose *pose,
                                                 uint8_t *out);

/* Bits of `what`. */
#define MAPOD_ASK_GEOM 0x01u
#define MAPOD_ASK_POSE 0x02u
#define MAPOD_ASK_STOP_ZONE 0x04u
#define MAPOD_ASK_TILE 0x08u
#define MAPOD_ASK_OBJECTS 0x20u
#define MAPOD_ASK_PATH 0x40u
#define MAPOD_ASK_IN_WINDOW 0x80u /* i, j count from the window's lowest column and row */

#define MAPOD_LAYER_CLASS 0u
#define MAPOD_LAYER_HEIGHT 1u   /* mm above the ground that the sender tracks */
#define MAPOD_LAYER_VARIANCE 2u /* mm^2, of the height */
#define MAPOD_LAYER_SLOPE 3u    /* 0.0001 rad, of the ground; 0: level */
/* Layers 4 (cause), 5 (age), 6 (z), 7 (edge), 8 (foothold) and 9 to 11 (filled in, sigmas), and SCAN
 * frames (type 7), are for larger machines: here such a tile holds no values, and a SCAN counts as of unknown type. */

struct mapod_ask {
    uint16_t id; /* told back by the answer */
    uint8_t what;
    uint8_t layer;
    int16_t i; /* the rectangle's lowest column, in the endless grid */
    int16_t j;
    uint16_t width; /* cells */
    uint16_t height;
};

/* ASK; without MAPOD_ASK_TILE only `id` and `what` are told. 0: nothing, or what nobody knows. */
MAPOD_LINK_API uint32_t mapod_talk_ask(struct mapod_talk *talk, const struct mapod_link *link,
                                       uint32_t now_ms, const struct mapod_ask *ask, uint8_t *out);

/* ---- STOP_ZONE: what the sender makes of the map before and behind the robot ---- */

#define MAPOD_NONE_KNOWN 65535u /* obstacle_, contact_ms, nearest_mm: none in sight */
#define MAPOD_ZONE_UNKNOWN 0u
#define MAPOD_ZONE_CLEAR 1u
#define MAPOD_ZONE_SLOW 2u
#define MAPOD_ZONE_STOP 3u
#define MAPOD_CAUSE_OBSTACLE 0x01u
#define MAPOD_CAUSE_UNSEEN 0x02u
#define MAPOD_CAUSE_DROP 0x04u
#define MAPOD_CAUSE_NOT_TRUSTED 0x08u

struct mapod_zone {
    uint32_t arrived_ms;        /* own clock */
    uint32_t t_ms;              /* the sender's clock */
    uint16_t free_ahead_mm;     /* straight ahead until a cell that is not FREE */
    uint16_t obstacle_ahead_mm; /* to the nearest OBSTACLE of the corridor */
    uint16_t free_behind_mm;
    uint16_t obstacle_behind_mm;
    uint16_t contact_ms; /* as the robot moves now */
    uint16_t allowed_ahead_mmps;
    uint16_t allowed_behind_mmps;
    uint16_t nearest_mm; /* from the robot's edge to the nearest OBSTACLE anywhere */
    int16_t bearing;     /* of it, 0.0001 rad, counter-clockwise from ahead */
    uint8_t state;
    uint8_t causes;
};

/* After MAPOD_STOP_ZONE: takes it out of the buffer. False: there is none, `zone` is unchanged.
 * Begin with a zone of zeros: it says stop. */
MAPOD_LINK_API bool mapod_zone_from(const struct mapod_link *link, struct mapod_zone *zone);
/* Stop if its state says so (unknown and stop), and if it is older than MAPOD_ZONE_STALE_MS, by
 * the own clock or by the newest frame: its state is MAPOD_ZONE_UNKNOWN from then on. It speaks of
 * the way the robot moves, or is asked to move, or else of ahead, and is no part of
 * mapod_link_advice: a robot before a wall may turn, or back off. While it is not
 * MAPOD_ZONE_UNKNOWN, go ahead no faster than allowed_ahead_mmps, back no faster than
 * allowed_behind_mmps (0: not at all). */
MAPOD_LINK_API enum mapod_advice mapod_zone_advice(struct mapod_zone *zone,
                                                   const struct mapod_link *link, uint32_t now_ms);

/* ---- TILE: one piece of the answer to an ASK ---- */

#define MAPOD_NOT_KNOWN (-2147483647 - 1)

struct mapod_tile {
    const uint8_t *values; /* in the receiver's buffer: gone with the next byte */
    uint32_t first;        /* first cell of this piece: row * width + column in the rectangle */
    uint16_t id;
    uint16_t width; /* of the whole rectangle, cells */
    uint16_t height;
    uint16_t count; /* cells in this piece */
    uint16_t cell_mm;
    int16_t i; /* lowest column of the whole rectangle, in the endless grid */
    int16_t j;
    uint8_t layer;
    uint8_t status; /* 0 values, 1 no such layer, 2 wrong size, 3 too many tiles, 4 no map */
    uint8_t geom_id;
};

/* After MAPOD_TILE: a view of the piece in the buffer. False: there is none. */
MAPOD_LINK_API bool mapod_tile_from(const struct mapod_link *link, struct mapod_tile *tile);
/* Cell first + k of the rectangle, in the layer's unit; MAPOD_NOT_KNOWN where the sender does not
 * know it (class: MAPOD_UNKNOWN), and for k >= count. Low ground is no promise: only class FREE
 * says that a cell is free. */
MAPOD_LINK_API int32_t mapod_tile_value(const struct mapod_tile *tile, uint32_t k);

#ifdef MAPOD_LINK_OBJECTS

/* What a list of objects, or the path, is worth. All but KNOWN: it may be outdated. */
enum mapod_worth {
    MAPOD_WORTH_KNOWN = 0,
    MAPOD_WORTH_NONE,     /* nothing was told yet */
    MAPOD_WORTH_LATE,     /* no frame for MAPOD_OBJECTS_STALE_MS, or MAPOD_PATH_STALE_MS */
    MAPOD_WORTH_GAP,      /* a frame is missing since the newest one */
    MAPOD_WORTH_LEFT_OUT, /* not all fits here: MAPOD_OBJECTS_MAX, MAPOD_PATH_MAX */
    MAPOD_WORTH_DIFFERS,  /* something is missing: ask for it, if that does not end by itself */
    MAPOD_WORTH_WAITING,  /* the sender has more to tell */
    MAPOD_WORTH_BLIND     /* nothing has looked for objects for MAPOD_LOOK_STALE_MS */
};

/* ---- OBJECTS: the sender's vector map. What is not in it is not therefore free. ---- */

#ifndef MAPOD_OBJECTS_MAX
#define MAPOD_OBJECTS_MAX 32u
#endif
#ifndef MAPOD_CORNERS_MAX
#define MAPOD_CORNERS_MAX 16u
#endif
#if (MAPOD_CORNERS_MAX < 4u) || (MAPOD_CORNERS_MAX > 64u)
#error "MAPOD_CORNERS_MAX must be within 4 to 64"
#endif
#ifndef MAPOD_OBJECTS_STALE_MS
#define MAPOD_OBJECTS_STALE_MS 350u
#endif
#ifndef MAPOD_MOVING_STALE_MS
#define MAPOD_MOVING_STALE_MS 500u
#endif
#ifndef MAPOD_LOOK_STALE_MS
#define MAPOD_LOOK_STALE_MS 1000u
#endif
#define MAPOD_OBJECT_STATIC 1u /* has never moved; kinds above 4 are of later days, and stand */
#define MAPOD_OBJECT_MOVED 2u
#define MAPOD_OBJECT_MOVING 3u
#define MAPOD_OBJECT_WALL 4u /* a piece of one, from door to door: of no known height */
#define MAPOD_OBJECT_ENLARGED 0x01u /* the outline is larger than the object's own */

struct mapod_object {
    uint32_t id;     /* never that of another object in one run of the sender */
    uint32_t digest; /* of all but its age, as it was told */
    uint32_t seen_ms; /* the sender's clock, when it was last seen */
    int32_t x_mm;    /* map frame: where the corners count from */
    int32_t y_mm;
    int16_t bottom_mm; /* above the floor */
    int16_t top_mm;    /* 32 767: that or more */
    int16_t vx_mmps;   /* along map x and y */
    int16_t vy_mmps;
    uint8_t kind;
    uint8_t confidence; /* 0 to 255: that it is there */
    uint8_t flags;
    uint8_t unit_mm; /* that corner_x and corner_y count in */
    uint8_t corners; /* counter-clockwise */
    bool forgotten;  /* it was not seen for 65 s or more when it was told, or has grown old since */
    int16_t corner_x[MAPOD_CORNERS_MAX];
    int16_t corner_y[MAPOD_CORNERS_MAX];
};

struct mapod_objects {
    uint32_t count;      /* of `items`, in no order */
    uint32_t told;       /* that there must be */
    uint32_t waiting;    /* that the sender still has to tell, or to tell again */
    uint32_t digest;     /* sum of the items' */
    uint32_t arrived_ms; /* own clock, newest frame */
    uint32_t t_ms;       /* the sender's clock there */
    uint32_t look_ms;    /* how old the newest look for objects was then */
    uint32_t gaps;
    uint32_t epochs;
    bool any;      /* a frame of this epoch has come */
    bool agrees;   /* the list is the one that the newest frame speaks of */
    bool left_out; /* an object did not fit in */
    bool late;
    struct mapod_object items[MAPOD_OBJECTS_MAX];
};

/* Begins with an empty list. */
MAPOD_LINK_API void mapod_objects_init(struct mapod_objects *objects);
/* After MAPOD_OBJECTS: takes it out of the buffer. False: there is none, it is of another epoch, or
 * it can't be read: then MAPOD_WORTH_DIFFERS. */
MAPOD_LINK_API bool mapod_objects_from(struct mapod_objects *objects,
                                       const struct mapod_link *link);
/* What the list is worth now; to be called before it is used, and at least once a day. A new epoch
 * empties it. */
MAPOD_LINK_API enum mapod_worth mapod_objects_worth(struct mapod_objects *objects,
                                                    const struct mapod_link *link,
                                                    uint32_t now_ms);
/* Whether item k moved and was not seen for MAPOD_MOVING_STALE_MS: nobody knows where it is. To be
 * called at least once a day: what is old stays so until it is told anew. */
MAPOD_LINK_API bool mapod_objects_old(struct mapod_objects *objects, uint32_t k, uint32_t now_ms);

/* ---- PATH: what the robot is to drive along ---- */

#ifndef MAPOD_PATH_MAX
#define MAPOD_PATH_MAX 256u
#endif
#ifndef MAPOD_PATH_STALE_MS
#define MAPOD_PATH_STALE_MS 700u
#endif
#define MAPOD_PATH_TRAVEL 0u /* kinds of a segment; higher ones are of later days */
#define MAPOD_PATH_SWEEP 1u
#define MAPOD_PATH_NOWHERE 65535u

struct mapod_path_point {
    int32_t x_mm; /* map frame */
    int32_t y_mm;
    uint16_t segment;
    uint8_t kind;
    bool here; /* it has arrived */
};

struct mapod_path {
    uint32_t arrived_ms; /* own clock, newest frame */
    uint32_t gaps;
    uint32_t epochs;
    uint32_t missing; /* points that have not arrived */
    uint16_t number;  /* of the path; 0: none was told */
    uint16_t total;   /* points of the whole path; those from MAPOD_PATH_MAX on are not kept */
    uint16_t segments;
    uint16_t ahead;    /* the point that the robot drives to; total: it has passed all; or NOWHERE */
    uint16_t left_out; /* points behind the last that the sender could not tell */
    bool damaged;
    bool late;
    struct mapod_path_point points[MAPOD_PATH_MAX];
};

/* Begins without a path. */
MAPOD_LINK_API void mapod_path_init(struct mapod_path *path);
/* After MAPOD_PATH: takes it out of the buffer. False: there is none, it is of another epoch, or it
 * can't be read: then MAPOD_WORTH_DIFFERS until the next one. */
MAPOD_LINK_API bool mapod_path_from(struct mapod_path *path, const struct mapod_link *link);
/* What the path is worth now; to be called before it is used, and at least once a day. */
MAPOD_LINK_API enum mapod_worth mapod_path_worth(struct mapod_path *path,
                                                 const struct mapod_link *link, uint32_t now_ms);

#endif

#ifdef __cplusplus
}
#endif

#endif /* MAPOD_LINK_H */

#if defined(MAPOD_LINK_IMPLEMENTATION) || defined(MAPOD_LINK_STATIC)
#ifndef MAPOD_LINK_INSIDE
#define MAPOD_LINK_INSIDE

#ifdef __cplusplus
extern "C" {
#endif

/* ======== Implementation: its own names ==================================================== */

#define MAPOD_P_CRC_START 0x2994717Fu /* CRC-32 of "MPL1" */
#define MAPOD_P_HEAD 8u               /* bytes: kind, flags, seq, t_ms */
#define MAPOD_P_MAP_HEAD 10u          /* bytes of a MAP body before its operations */
#define MAPOD_P_AUTH 0x10u            /* flag bit 4 */
#define MAPOD_P_SILENCE_MS 60000u      /* after it, numbers may have wrapped unseen */
#define MAPOD_P_KEEP 3u               /* an operation that leaves cells as they are */

#ifdef MAPOD_LINK_NO_TILES
#define MAPOD_P_ZONE_SIZE 0u
#define MAPOD_P_LAST_TYPE ((uint32_t)MAPOD_DIGEST)
#else
#define MAPOD_P_ZONE_SIZE 20u
#define MAPOD_P_LAST_TYPE ((uint32_t)MAPOD_TILE)
#endif

/* Frame types that travel to the sender. */
#define MAPOD_P_ACK 8u
#define MAPOD_P_HELLO 9u
#define MAPOD_P_DRIVE 10u
#define MAPOD_P_ASK 11u
#define MAPOD_P_EXTERNAL_POSE 12u

/* Bits of the ACK's status that are no flags. */
#define MAPOD_P_ACK_STALE 0x04u
#define MAPOD_P_ACK_STOPPED 0x10u

/* Bits of link->flags; the lowest are the ACK's status. */
#define MAPOD_P_NEED_GEOM 0x0001u
#define MAPOD_P_NEED_FULL 0x0002u
#define MAPOD_P_SUSPECT 0x0008u
#define MAPOD_P_DIGEST_OK 0x0020u
#define MAPOD_P_AUTH_FAILED 0x0040u
#define MAPOD_P_IN_STATUS 0x006Bu
#define MAPOD_P_HAS_GEOM 0x0080u
#define MAPOD_P_HAS_MAP 0x0100u /* there is an origin */
#define MAPOD_P_HAS_POSE 0x0200u
#define MAPOD_P_ANY 0x0400u /* a frame has been accepted: `last` means something */
#define MAPOD_P_POSE_LATE 0x0800u
#define MAPOD_P_MAP_LATE 0x1000u
#define MAPOD_P_BEGUN 0x2000u    /* bytes of a serial frame are in the buffer */
#define MAPOD_P_BROKEN 0x4000u   /* it is too long: nothing counts until the next zero */
#define MAPOD_P_ZERO_DUE 0x8000u /* the COBS block that ends stands for a zero after it */
#define MAPOD_P_AT_START (MAPOD_P_NEED_GEOM | MAPOD_P_POSE_LATE | MAPOD_P_MAP_LATE)

/* What a new geometry ends. */
#define MAPOD_P_OF_GEOM (MAPOD_P_HAS_MAP | MAPOD_P_SUSPECT | MAPOD_P_NEED_FULL | MAPOD_P_DIGEST_OK)


/* Where the next operation writes. */
struct mapod_p_cursor {
    uint32_t column;
    uint32_t row;
};

/* ======== Bytes and CRC ==================================================================== */

static uint16_t mapod_p_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | ((uint16_t)at[1] << 8));
}

static uint32_t mapod_p_u32(const uint8_t *at)
{
    return (uint32_t)mapod_p_u16(at) | ((uint32_t)mapod_p_u16(&at[2]) << 16);
}

static uint32_t mapod_p_u24(const uint8_t *at)
{
    return (uint32_t)mapod_p_u16(at) | ((uint32_t)at[2] << 16);
}

#if defined(__BYTE_ORDER__) && !defined(MAPOD_LINK_BIG_ENDIAN)
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
#define MAPOD_LINK_BIG_ENDIAN
#endif
#endif

/* Two's complement by arithmetic: the cast alone would be the compiler's choice. */
static int16_t mapod_p_signed(uint16_t number)
{
    return (number < 0x8000u) ? (int16_t)number : (int16_t)((int32_t)number - 0x10000);
}

static int16_t mapod_p_i16(const uint8_t *at)
{
    return mapod_p_signed(mapod_p_u16(at));
}

#if defined(MAPOD_LINK_BIG_ENDIAN) || defined(MAPOD_LINK_OBJECTS)
static int32_t mapod_p_i32(const uint8_t *at)
{
    const uint32_t number = mapod_p_u32(at);
    return (number < 0x80000000u) ? (int32_t)number : (-1 - (int32_t)(0xFFFFFFFFu - number));
}
#endif

/* How far `later` is ahead of `earlier` on the circle of 65 536; negative: it is behind. */
static int16_t mapod_p_ahead(uint16_t later, uint16_t earlier)
{
    return mapod_p_signed((uint16_t)(later - earlier));
}

static uint32_t mapod_p_crc(uint32_t running, const uint8_t *data, uint32_t size)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u,
        0x4DB26158u, 0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
        0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu};
    uint32_t crc = ~running;
    uint32_t i;
    for (i = 0u; i < size; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return ~crc;
}

/* ======== The map: a ring of 2-bit cells, section 4 ======================================== */

static void mapod_p_set(struct mapod_link *link, uint16_t bits, bool on)
{
    link->flags = (uint16_t)(on ? (link->flags | bits) : (link->flags & ~(uint32_t)bits));
}

static bool mapod_p_is(const struct mapod_link *link, uint16_t bits)
{
    return (link->flags & bits) != 0u;
}

static uint32_t mapod_p_area(const struct mapod_link *link)
{
    return (uint32_t)link->geom.width * link->geom.height;
}

/* Cells that follow each other in memory: whole bytes in the middle, single cells at the ends. */
static void mapod_p_span(uint8_t *cells, uint32_t index, uint32_t count, uint8_t state)
{
    while (count > 0u) {
        uint8_t *const byte = &cells[index >> 2];
        uint32_t done = 1u;
        if (((index & 3u) == 0u) && (count >= 4u)) {
            done = count & ~(uint32_t)3u;
            (void)memset(byte, state * 0x55, done >> 2);
        } else {
            const uint32_t shift = (index & 3u) * 2u;
            *byte = (uint8_t)((*byte & ~(3u << shift)) | ((uint32_t)state << shift));
        }
        index += done;
        count -= done;
    }
}

/* `count` cells of one row of the window; the row's end is not passed. */
static void mapod_p_row(struct mapod_link *link, uint32_t column, uint32_t row, uint32_t count,
                        uint8_t state)
{
    const uint32_t width = link->geom.width;
    const uint32_t height = link->geom.height;
    uint32_t ring_row = row + link->base_row;
    uint32_t index = column + link->base_column;
    uint32_t part; /* up to the ring's edge first, then from its other edge on */
    ring_row -= (ring_row >= height) ? height : 0u;
    index -= (index >= width) ? width : 0u;
    ring_row *= width;
    part = width - index;
    index += ring_row;
    while (count > 0u) { /* twice at most */
        if (part > count) {
            part = count;
        }
        mapod_p_span(link->cells, index, part, state);
        count -= part;
        part = count;
        index = ring_row;
    }
}

static void mapod_p_clear(struct mapod_link *link)
{
    if (link->cells != NULL) {
        (void)memset(link->cells, 0, (mapod_p_area(link) + 3u) >> 2);
    }
    link->base_column = 0u;
    link->base_row = 0u;
    mapod_p_set(link, MAPOD_P_SUSPECT, false);
}

/* A ring base after a move by `by` cells, |by| < size. */
static uint16_t mapod_p_turn(uint32_t base, int32_t by, uint32_t size)
{
    uint32_t turned = base + (uint32_t)by + size;
    while (turned >= size) { /* twice at most */
        turned -= size;
    }
    return (uint16_t)turned;
}

/* Section 4: what enters the window is UNKNOWN. */
static void mapod_p_move(struct mapod_link *link, uint16_t ox, uint16_t oy)
{
    const uint32_t width = link->geom.width;
    const uint32_t height = link->geom.height;
    const int32_t dx = mapod_p_ahead(ox, link->ox);
    const int32_t dy = mapod_p_ahead(oy, link->oy);
    const uint32_t columns = (uint32_t)((dx < 0) ? -dx : dx);
    const uint32_t rows = (uint32_t)((dy < 0) ? -dy : dy);
    link->ox = ox;
    link->oy = oy;
    if ((!mapod_p_is(link, MAPOD_P_HAS_MAP)) || (columns >= width) || (rows >= height)) {
        mapod_p_clear(link);
    } else if ((columns | rows) != 0u) {
        const uint32_t column = (dx < 0) ? 0u : (width - columns);
        uint32_t row;
        link->base_column = mapod_p_turn(link->base_column, dx, width);
        link->base_row = mapod_p_turn(link->base_row, dy, height);
        for (row = 0u; row < height; row++) {
            const bool stayed = (row + (uint32_t)dy) < height; /* it was a row of the window */
            mapod_p_row(link, stayed ? column : 0u, row, stayed ? columns : width, MAPOD_UNKNOWN);
        }
    } else {
        /* It stands where it stood. */
    }
    mapod_p_set(link, MAPOD_P_HAS_MAP, true);
}

/* Writes one run and moves the cursor behind it; the run fits into the window. */
static void mapod_p_write(struct mapod_link *link, struct mapod_p_cursor *at, uint32_t run,
                          uint8_t state)
{
    const uint32_t width = link->geom.width;
    while (run > 0u) {
        const uint32_t room = width - at->column;
        const uint32_t count = (run < room) ? run : room;
        if (state != MAPOD_P_KEEP) {
            mapod_p_row(link, at->column, at->row, count, state);
        }
        at->column += count;
        if (at->column == width) {
            at->column = 0u;
            at->row++;
        }
        run -= count;
    }
}

/* Walks the operations of the MAP frame in the buffer; false: they do not fit. Writes if told to,
 * which is only done once a first walk has shown that they fit. */
static bool mapod_p_walk(struct mapod_link *link, uint32_t size, bool write)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    const uint32_t start = mapod_p_u24(&body[7]);
    const uint32_t area = mapod_p_area(link);
    struct mapod_p_cursor cursor = {0u, 0u};
    uint32_t left = (start < area) ? (area - start) : 0u; /* cells from the cursor on */
    uint32_t at = MAPOD_P_MAP_HEAD;
    if (write && (left > 0u)) {
        cursor.column = start;
        while (cursor.column >= link->geom.width) {
            cursor.column -= link->geom.width;
            cursor.row++;
        }
    }
    while (at < size) {
        const uint8_t op = body[at];
        uint32_t run = (op & 63u) + 1u;
        at++;
        if (run == 64u) {
            uint32_t shift = 0u;
            uint8_t digit;
            do {
                if ((at >= size) || (shift > 14u)) {
                    return false;
                }
                digit = body[at];
                at++;
                run += (uint32_t)(digit & 127u) << shift;
                shift += 7u;
            } while (digit >= 128u);
        }
        if (run > left) {
            return false;
        }
        left -= run;
        if (write) {
            mapod_p_write(link, &cursor, run, (uint8_t)(op >> 6));
        }
    }
    return true;
}

/* ======== What the receiver says, sections 3 and 6 ========================================= */

static void mapod_p_put16(uint8_t *at, uint16_t number)
{
    at[0] = (uint8_t)(number & 255u);
    at[1] = (uint8_t)(number >> 8);
}

static void mapod_p_put32(uint8_t *at, uint32_t number)
{
    mapod_p_put16(&at[0], (uint16_t)(number & 0xFFFFu));
    mapod_p_put16(&at[2], (uint16_t)(number >> 16));
}

/* The low 16 bits of two's complement. */
static uint16_t mapod_p_bits(int32_t number)
{
    return (uint16_t)((uint32_t)number & 0xFFFFu);
}

#ifdef MAPOD_LINK_AUTH
static void mapod_p_tag(const struct mapod_link *link, uint32_t session, const uint8_t *frame,
                        uint32_t size, uint8_t *tag);
#endif

/* Head, tag and CRC around a body that stands at its place; gives the frame's size. */
static uint32_t mapod_p_close(struct mapod_talk *talk, const struct mapod_link *link,
                              uint32_t now_ms, uint8_t type, uint32_t body, uint8_t *out)
{
    uint32_t size = MAPOD_P_HEAD + body;
    talk->seq++;
    out[0] = (uint8_t)(0x10u | type);
    out[1] = 0u;
    mapod_p_put16(&out[2], talk->seq);
    mapod_p_put32(&out[4], now_ms);
#ifdef MAPOD_LINK_AUTH
    if ((link->key != NULL) && mapod_p_is(link, MAPOD_P_HAS_GEOM)) { /* else: no session yet */
        out[1] = MAPOD_P_AUTH;
        mapod_p_tag(link, link->geom.session, out, size, &out[size]);
        size += 8u;
    }
#else
    (void)link;
#endif
    mapod_p_put32(&out[size], mapod_p_crc(MAPOD_P_CRC_START, out, size));
    return size + 4u;
}

MAPOD_LINK_API void mapod_talk_init(struct mapod_talk *talk, uint32_t nonce, bool poll_only)
{
    (void)memset(talk, 0, sizeof *talk);
    talk->nonce = nonce;
    talk->poll_only = poll_only;
}

MAPOD_LINK_API uint32_t mapod_talk_ack_held(struct mapod_talk *talk, struct mapod_link *link,
                                            uint32_t now_ms, uint16_t hold, uint8_t *out)
{
    uint8_t *const body = &out[MAPOD_P_HEAD];
    uint32_t status = link->flags & MAPOD_P_IN_STATUS;
    status |= mapod_link_stale(link, now_ms) ? MAPOD_P_ACK_STALE : 0u;
    status |= talk->stopped ? MAPOD_P_ACK_STOPPED : 0u;
    mapod_p_put16(&body[0], link->last);
    mapod_p_put32(&body[2], link->mask);
    mapod_p_put32(&body[6], link->newest_t_ms);
    mapod_p_put16(&body[10], hold);
    mapod_p_put16(&body[12], link->bad_frames);
    body[14] = (uint8_t)status;
    body[15] = mapod_p_is(link, MAPOD_P_HAS_GEOM) ? link->geom.geom_id : 0u;
    talk->acked = link->last;
    talk->sent_ms = now_ms;
    return mapod_p_close(talk, link, now_ms, MAPOD_P_ACK, 16u, out);
}

MAPOD_LINK_API uint32_t mapod_talk_ack(struct mapod_talk *talk, struct mapod_link *link,
                                       uint32_t now_ms, uint8_t *out)
{
    const uint32_t held_ms = now_ms - link->newest_ms;
    const uint16_t hold = (held_ms > 6553u) ? 0xFFFFu : (uint16_t)(held_ms * 10u);
    return mapod_talk_ack_held(talk, link, now_ms, hold, out);
}

MAPOD_LINK_API uint32_t mapod_talk_hello(struct mapod_talk *talk, const struct mapod_link *link,
                                         uint32_t now_ms, uint8_t *out)
{
    uint8_t *const body = &out[MAPOD_P_HEAD];
    mapod_p_put32(&body[0], talk->nonce);
    mapod_p_put32(&body[4], link->max_cells);
    mapod_p_put16(&body[8], MAPOD_FRAME_MAX);
    mapod_p_put16(&body[10], talk->poll_only ? 1u : 0u);
    talk->hello_ms = now_ms;
    talk->said = true;
    return mapod_p_close(talk, link, now_ms, MAPOD_P_HELLO, 12u, out);
}

#ifdef MAPOD_LINK_AUTH
MAPOD_LINK_API void mapod_talk_renew(struct mapod_talk *talk, struct mapod_link *link,
                                     uint32_t nonce)
{
    talk->nonce = nonce;
    talk->said = false;
    link->nonce = nonce;
    link->left_count = 0u;
    mapod_p_set(link, MAPOD_P_AUTH_FAILED, true); /* until the sender has heard of it */
}
#endif

MAPOD_LINK_API uint32_t mapod_talk_poll(struct mapod_talk *talk, struct mapod_link *link,
                                        uint32_t now_ms, uint8_t *out)
{
    const uint32_t waited_ms = now_ms - talk->sent_ms;
    const uint32_t period_ms = mapod_p_is(link, MAPOD_P_NEED_GEOM | MAPOD_P_NEED_FULL) ? 50u : 100u;
    const int16_t news = mapod_p_ahead(link->last, talk->acked);
    /* A sender that has begun anew does not know the nonce, nor that nothing shall be pushed. */
    const bool unknown = (!mapod_p_is(link, MAPOD_P_HAS_GEOM)) ||
                         mapod_p_is(link, MAPOD_P_AUTH_FAILED) ||
                         (talk->poll_only && ((now_ms - link->map_ms) < 250u) &&
                          (!mapod_p_is(link, MAPOD_P_MAP_LATE)));
    /* Nor, that frames of the full length are too long here: nothing else would tell it. */
    const bool tells = unknown || (MAPOD_FRAME_MAX < 368u);
    if (tells && ((!talk->said) || ((now_ms - talk->hello_ms) >= (unknown ? 250u : 1000u)))) {
        return mapod_talk_hello(talk, link, now_ms, out);
    }
    if ((!mapod_p_is(link, MAPOD_P_ANY)) || talk->poll_only) {
        return 0u;
    }
    if ((waited_ms >= period_ms) || (news >= 16) || (news < 0)) {
        return mapod_talk_ack(talk, link, now_ms, out);
    }
    return 0u;
}

/* Who a command is from, and to which run of the sender; false: it may not be sent. */
static bool mapod_p_address(const struct mapod_talk *talk, const struct mapod_link *link,
                            uint8_t *body)
{
    mapod_p_put32(&body[0], link->geom.session);
    mapod_p_put32(&body[4], talk->nonce);
    return mapod_p_is(link, MAPOD_P_HAS_GEOM) && (talk->nonce != 0u);
}

MAPOD_LINK_API uint32_t mapod_talk_drive(struct mapod_talk *talk, const struct mapod_link *link,
                                         uint32_t now_ms, int16_t v_mmps, int16_t w_mradps,
                                         uint16_t valid_ms, uint8_t *out)
{
    uint8_t *const body = &out[MAPOD_P_HEAD];
    const bool wrong = (v_mmps < -32767) || (w_mradps < -32767) || (valid_ms > 1000u);
    if ((!mapod_p_address(talk, link, body)) || wrong) {
        return 0u;
    }
    mapod_p_put16(&body[8], mapod_p_bits(v_mmps));
    mapod_p_put16(&body[10], mapod_p_bits(w_mradps));
    mapod_p_put16(&body[12], valid_ms);
    mapod_p_put16(&body[14], 0u);
    return mapod_p_close(talk, link, now_ms, MAPOD_P_DRIVE, 16u, out);
}

static bool mapod_p_angle_wrong(int16_t angle)
{
    return (angle < -31416) || (angle > 31415);
}

/* What a long EXTERNAL_POSE has more than a short one. */
static bool mapod_p_upright_wrong(const struct mapod_external_pose *pose)
{
    const bool tilt_known = (pose->pitch != MAPOD_NO_YAW) || (pose->roll != MAPOD_NO_YAW);
    const bool tilt_wrong = tilt_known && (mapod_p_angle_wrong(pose->pitch) ||
                                           mapod_p_angle_wrong(pose->roll) ||
                                           (pose->sigma_tilt == 0u));

    return (pose->sigma_z_mm != 0u) && ((pose->z_mm < -2147483647) || tilt_wrong);
}

MAPOD_LINK_API uint32_t mapod_talk_external_pose(struct mapod_talk *talk,
                                                 const struct mapod_link *link, uint32_t now_ms,
                                                 const struct mapod_external_pose *pose,
                                                 uint8_t *out)
{
    uint8_t *const body = &out[MAPOD_P_HEAD];
    const bool yaw_known = pose->yaw != MAPOD_NO_YAW;
    const bool yaw_wrong = yaw_known && ((pose->yaw < -31416) || (pose->yaw > 31415) ||
                                         (pose->sigma_yaw == 0u));
    const bool wrong = (pose->x_mm < -2147483647) || (pose->y_mm < -2147483647) || yaw_wrong ||
                       (pose->sigma_x_mm == 0u) || (pose->sigma_y_mm == 0u) ||
                       (pose->correlation < -10000) || (pose->correlation > 10000) ||
                       (pose->age_ms > 1000u) || mapod_p_upright_wrong(pose);
    uint32_t size = 28u;

    if ((!mapod_p_address(talk, link, body)) || wrong) {
        return 0u;
    }
    mapod_p_put32(&body[8], (uint32_t)pose->x_mm);
    mapod_p_put32(&body[12], (uint32_t)pose->y_mm);
    mapod_p_put16(&body[16], mapod_p_bits(pose->yaw));
    mapod_p_put16(&body[18], pose->sigma_x_mm);
    mapod_p_put16(&body[20], pose->sigma_y_mm);
    mapod_p_put16(&body[22], mapod_p_bits(pose->correlation));
    mapod_p_put16(&body[24], pose->sigma_yaw);
    mapod_p_put16(&body[26], pose->age_ms);
    if (pose->sigma_z_mm != 0u) {
        mapod_p_put32(&body[28], (uint32_t)pose->z_mm);
        mapod_p_put16(&body[32], pose->sigma_z_mm);
        mapod_p_put16(&body[34], mapod_p_bits(pose->pitch));
        mapod_p_put16(&body[36], mapod_p_bits(pose->roll));
        mapod_p_put16(&body[38], pose->sigma_tilt);
        size = 40u;
    }
    return mapod_p_close(talk, link, now_ms, MAPOD_P_EXTERNAL_POSE, size, out);
}

MAPOD_LINK_API uint32_t mapod_talk_ask(struct mapod_talk *talk, const struct mapod_link *link,
                                       uint32_t now_ms, const struct mapod_ask *ask, uint8_t *out)
{
    uint8_t *const body = &out[MAPOD_P_HEAD];
    const bool tile = (ask->what & MAPOD_ASK_TILE) != 0u;
    const uint8_t known = MAPOD_ASK_GEOM | MAPOD_ASK_POSE | MAPOD_ASK_STOP_ZONE | MAPOD_ASK_TILE |
                          MAPOD_ASK_OBJECTS | MAPOD_ASK_PATH;
    if (((ask->what & known) == 0u) ||
        ((ask->what & (uint32_t) ~((uint32_t)known | MAPOD_ASK_IN_WINDOW)) != 0u)) {
        return 0u;
    }
    mapod_p_put16(&body[0], ask->id);
    body[2] = ask->what;
    body[3] = tile ? ask->layer : 0u;
    mapod_p_put16(&body[4], tile ? mapod_p_bits(ask->i) : 0u);
    mapod_p_put16(&body[6], tile ? mapod_p_bits(ask->j) : 0u);
    mapod_p_put16(&body[8], tile ? ask->width : 0u);
    mapod_p_put16(&body[10], tile ? ask->height : 0u);
    return mapod_p_close(talk, link, now_ms, MAPOD_P_ASK, 12u, out);
}

/* From the end to the start, in place: each zero becomes the distance to the next one. */
MAPOD_LINK_API uint32_t mapod_talk_serial(uint8_t *out, uint32_t size)
{
    uint8_t code = 1u;
    uint32_t i;
    out[size + 1u] = 0u;
    for (i = size; i > 0u; i--) {
        const uint8_t byte = out[i - 1u];
        out[i] = (byte == 0u) ? code : byte;
        code = (byte == 0u) ? 1u : (uint8_t)(code + 1u);
    }
    out[0] = code;
    return size + 2u;
}

/* ======== Tags: BLAKE2s (RFC 7693), section 9 ============================================== */

#ifdef MAPOD_LINK_AUTH

struct mapod_p_hash {
    uint32_t state[8];
    uint32_t size; /* bytes that went in before the block */
    uint32_t used; /* of the block */
    uint8_t block[64];
};

static void mapod_p_mix(uint32_t *v, uint32_t round, uint32_t x, uint32_t y)
{
    const uint32_t diagonal = (round >= 4u) ? 1u : 0u;
    const uint32_t column = round & 3u;
    uint32_t *const a = &v[column];
    uint32_t *const b = &v[4u + ((column + diagonal) & 3u)];
    uint32_t *const c = &v[8u + ((column + (2u * diagonal)) & 3u)];
    uint32_t *const d = &v[12u + ((column + (3u * diagonal)) & 3u)];
    *a += *b + x;
    *d ^= *a;
    *d = (*d >> 16) | (*d << 16);
    *c += *d;
    *b ^= *c;
    *b = (*b >> 12) | (*b << 20);
    *a += *b + y;
    *d ^= *a;
    *d = (*d >> 8) | (*d << 24);
    *c += *d;
    *b ^= *c;
    *b = (*b >> 7) | (*b << 25);
}

static const uint32_t mapod_p_start[8] = {0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au,
                                          0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u};

static void mapod_p_compress(struct mapod_p_hash *hash, bool last)
{
    static const uint8_t order[80] = { /* two words of the message a byte, the first one high */
        0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF, 0xEA, 0x48, 0x9F, 0xD6, 0x1C, 0x02,
        0xB7, 0x53, 0xB8, 0xC0, 0x52, 0xFD, 0xAE, 0x36, 0x71, 0x94, 0x79, 0x31, 0xDC, 0xBE,
        0x26, 0x5A, 0x40, 0xF8, 0x90, 0x57, 0x24, 0xAF, 0xE1, 0xBC, 0x68, 0x3D, 0x2C, 0x6A,
        0x0B, 0x83, 0x4D, 0x75, 0xFE, 0x19, 0xC5, 0x1F, 0xED, 0x4A, 0x07, 0x63, 0x92, 0x8B,
        0xDB, 0x7E, 0xC1, 0x39, 0x50, 0xF4, 0x86, 0x2A, 0x6F, 0xE9, 0xB3, 0x08, 0xC2, 0xD7,
        0x14, 0xA5, 0xA2, 0x84, 0x76, 0x15, 0xFB, 0x9E, 0x3C, 0xD0};
    uint32_t v[16];
    uint32_t i;
    hash->size += hash->used;
    (void)memset(&hash->block[hash->used], 0, 64u - hash->used);
    (void)memcpy(v, hash->state, sizeof hash->state);
    (void)memcpy(&v[8], mapod_p_start, sizeof mapod_p_start);
    v[12] ^= hash->size;
    v[14] = last ? ~v[14] : v[14];
    for (i = 0u; i < 80u; i++) {
        mapod_p_mix(v, i & 7u, mapod_p_u32(&hash->block[((uint32_t)order[i] >> 4) * 4u]),
                    mapod_p_u32(&hash->block[(order[i] & 15u) * 4u]));
    }
    for (i = 0u; i < 8u; i++) {
        hash->state[i] ^= v[i] ^ v[i + 8u];
    }
    hash->used = 0u;
}

/* The tag of a frame's first `size` bytes, for a run of the sender and one of the receiver. */
static void mapod_p_tag(const struct mapod_link *link, uint32_t session, const uint8_t *frame,
                        uint32_t size, uint8_t *tag)
{
    struct mapod_p_hash hash;
    uint32_t i;
    (void)memset(&hash, 0, sizeof hash);
    (void)memcpy(hash.state, mapod_p_start, sizeof mapod_p_start);
    hash.state[0] ^= 0x01010000u ^ (32u << 8) ^ 8u;
    (void)memcpy(hash.block, link->key, 32u);
    hash.used = 64u; /* the key's block is padded with the zeros that stand there */
    mapod_p_compress(&hash, false);
    mapod_p_put32(&hash.block[0], session);
    mapod_p_put32(&hash.block[4], link->nonce);
    hash.used = 8u;
    for (i = 0u; i < size; i++) {
        if (hash.used == 64u) {
            mapod_p_compress(&hash, false);
        }
        hash.block[hash.used] = frame[i];
        hash.used++;
    }
    mapod_p_compress(&hash, true);
    mapod_p_put32(&tag[0], hash.state[0]);
    mapod_p_put32(&tag[4], hash.state[1]);
}

static bool mapod_p_was_left(const struct mapod_link *link, uint32_t session)
{
    uint32_t i;
    for (i = 0u; i < link->left_count; i++) {
        if (link->left_sessions[i] == session) {
            return true;
        }
    }
    return false;
}

/* Compares in constant time. `end` is where the tag begins; a GEOM names its own session. */
static bool mapod_p_tag_fits(const struct mapod_link *link, uint32_t end)
{
    const uint8_t *const frame = link->frame;
    const bool geom = ((frame[0] & 15u) == (uint8_t)MAPOD_GEOM) && (end == (MAPOD_P_HEAD + 16u));
    const uint32_t session = geom ? mapod_p_u32(&frame[MAPOD_P_HEAD + 8u]) : link->geom.session;
    const bool full = link->left_count >= MAPOD_LINK_LEFT_SESSIONS;
    uint8_t tag[8];
    uint32_t differs = 0u;
    uint32_t i;
    if (((frame[1] & MAPOD_P_AUTH) == 0u) || ((!geom) && (!mapod_p_is(link, MAPOD_P_HAS_GEOM))) ||
        (full && (session != link->geom.session)) || mapod_p_was_left(link, session)) {
        return false;
    }
    mapod_p_tag(link, session, frame, end, tag);
    for (i = 0u; i < 8u; i++) {
        differs |= (uint32_t)tag[i] ^ frame[end + i];
    }
    return differs == 0u;
}

/* The tag's part in section 5; true where no key is set. */
static bool mapod_p_tag_is_right(struct mapod_link *link, uint32_t end)
{
    const bool right = (link->key == NULL) || mapod_p_tag_fits(link, end);
    mapod_p_set(link, MAPOD_P_AUTH_FAILED, !right);
    return right;
}

/* GEOM of a new run of the sender: the one before may not come back. */
static void mapod_p_leave_session(struct mapod_link *link)
{
    const uint32_t count = link->left_count;
    if ((link->geom.width != 0u) && (count < MAPOD_LINK_LEFT_SESSIONS) &&
        (mapod_p_u32(&link->frame[MAPOD_P_HEAD + 8u]) != link->geom.session)) {
        link->left_sessions[count] = link->geom.session;
        link->left_count = count + 1u;
    }
}

MAPOD_LINK_API void mapod_link_set_key(struct mapod_link *link, const uint8_t *key, uint32_t nonce)
{
    link->key = key;
    link->nonce = nonce;
}

#endif

/* ======== Advice, digest, places, STOP_ZONE, TILE ========================================== */

/* Section 5, what the planner must do; the worst reason first. */
MAPOD_LINK_API enum mapod_why mapod_link_why(struct mapod_link *link, uint32_t now_ms)
{
    const uint16_t health = link->pose.health;
    const uint8_t mode = link->pose.mode;
    enum mapod_why why = MAPOD_WHY_NOTHING;
    if (mapod_link_blank(link) || (!mapod_p_is(link, MAPOD_P_HAS_POSE))) {
        why = MAPOD_WHY_BLANK;
    } else if (mapod_link_stale(link, now_ms)) {
        why = MAPOD_WHY_STALE;
    } else if ((mode != MAPOD_MODE_RUNNING) && (mode != MAPOD_MODE_DEGRADED)) {
        why = MAPOD_WHY_MODE;
    } else if ((health & MAPOD_HEALTH_OPERATOR_STOP) != 0u) {
        why = MAPOD_WHY_OPERATOR_STOP;
    } else if ((health & MAPOD_HEALTH_POSE_VALID) == 0u) {
        why = MAPOD_WHY_POSE_INVALID;
    } else if ((health & MAPOD_HEALTH_MAP_VALID) == 0u) {
        why = MAPOD_WHY_MAP_INVALID;
    } else if ((health & MAPOD_HEALTH_TILTED) != 0u) {
        why = MAPOD_WHY_TILTED;
    } else if ((health & MAPOD_HEALTH_DROP_OFF) != 0u) {
        why = MAPOD_WHY_DROP_OFF;
    } else if (mapod_p_is(link, MAPOD_P_NEED_FULL)) {
        why = MAPOD_WHY_MAP_DIFFERS;
    } else if (mapod_p_is(link, MAPOD_P_SUSPECT)) {
        why = MAPOD_WHY_SUSPECT;
    } else {
        /* Nothing is known against it. */
    }
    return why;
}

MAPOD_LINK_API enum mapod_advice mapod_link_advice(struct mapod_link *link, uint32_t now_ms)
{
    const enum mapod_why why = mapod_link_why(link, now_ms);
    if (why == MAPOD_WHY_NOTHING) {
        return MAPOD_GO;
    }
    return (why == MAPOD_WHY_SUSPECT) ? MAPOD_SLOW : MAPOD_STOP;
}

MAPOD_LINK_API uint32_t mapod_link_digest(const struct mapod_link *link)
{
    const uint32_t width = link->geom.width;
    uint32_t crc = 0u;
    uint32_t row;
    uint32_t column;
    uint32_t shift = 0u;
    uint8_t byte = 0u;
    for (row = 0u; row < link->geom.height; row++) {
        for (column = 0u; column < width; column++) {
            byte = (uint8_t)(byte | ((uint32_t)mapod_link_cell(link, column, row) << shift));
            shift += 2u;
            if (shift == 8u) {
                crc = mapod_p_crc(crc, &byte, 1u);
                byte = 0u;
                shift = 0u;
            }
        }
    }
    return (shift == 0u) ? crc : mapod_p_crc(crc, &byte, 1u);
}

/* Whether the buffer holds the body of an accepted frame of that type. */
static bool mapod_p_holds(const struct mapod_link *link, enum mapod_outcome type)
{
    return (link->used > 0u) && (!mapod_p_is(link, MAPOD_P_BEGUN)) &&
           ((link->frame[0] & 15u) == (uint8_t)type);
}

MAPOD_LINK_API bool mapod_link_check_digest(struct mapod_link *link)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    if (mapod_p_holds(link, MAPOD_DIGEST)) {
        const uint32_t state = link->flags & (MAPOD_P_HAS_MAP | MAPOD_P_SUSPECT);
        const bool known = (state == MAPOD_P_HAS_MAP) && (body[0] == link->geom.geom_id);
        const bool equal = known && (mapod_link_digest(link) == mapod_p_u32(&body[4]));
        mapod_p_set(link, MAPOD_P_DIGEST_OK, equal);
        if (known) {
            mapod_p_set(link, MAPOD_P_NEED_FULL, !equal);
        }
    }
    return mapod_p_is(link, MAPOD_P_DIGEST_OK);
}

/* Long division, bit by bit: a Cortex-M0 has none, and the compiler's is a library function. */
static uint32_t mapod_p_divide(uint32_t number, uint32_t by)
{
    uint32_t rest = 0u;
    uint32_t quotient = 0u;
    uint32_t bit;
    for (bit = 0u; bit < 32u; bit++) {
        rest = (rest << 1) | (number >> 31);
        number <<= 1;
        quotient <<= 1;
        if (rest >= by) {
            rest -= by;
            quotient |= 1u;
        }
    }
    return quotient;
}

/* Index of a place in the endless grid, modulo 65 536; what is below 0 counts down from there. */
static uint16_t mapod_p_index(int32_t place_mm, uint16_t cell_mm)
{
    const uint32_t bits = (uint32_t)place_mm;
    const uint32_t index = (place_mm >= 0) ? mapod_p_divide(bits, cell_mm)
                                           : ~mapod_p_divide(~bits, cell_mm);
    return (uint16_t)(index & 0xFFFFu);
}

MAPOD_LINK_API uint8_t mapod_link_at(const struct mapod_link *link, int32_t x_mm, int32_t y_mm)
{
    uint16_t column;
    uint16_t row;
    if (mapod_link_blank(link)) {
        return MAPOD_UNKNOWN;
    }
    column = (uint16_t)(mapod_p_index(x_mm, link->geom.cell_mm) - link->ox);
    row = (uint16_t)(mapod_p_index(y_mm, link->geom.cell_mm) - link->oy);
    return mapod_link_cell(link, column, row);
}

/* ---- STOP_ZONE ---- */

MAPOD_LINK_API bool mapod_zone_from(const struct mapod_link *link, struct mapod_zone *zone)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    if ((!mapod_p_holds(link, MAPOD_STOP_ZONE)) || (link->used != 20u)) {
        return false;
    }
    zone->arrived_ms = link->newest_ms;
    zone->t_ms = link->newest_t_ms;
    zone->free_ahead_mm = mapod_p_u16(&body[0]);
    zone->obstacle_ahead_mm = mapod_p_u16(&body[2]);
    zone->free_behind_mm = mapod_p_u16(&body[4]);
    zone->obstacle_behind_mm = mapod_p_u16(&body[6]);
    zone->contact_ms = mapod_p_u16(&body[8]);
    zone->allowed_ahead_mmps = mapod_p_u16(&body[10]);
    zone->allowed_behind_mmps = mapod_p_u16(&body[12]);
    zone->nearest_mm = mapod_p_u16(&body[14]);
    zone->bearing = mapod_p_i16(&body[16]);
    zone->state = body[18];
    zone->causes = body[19];
    return true;
}

MAPOD_LINK_API enum mapod_advice mapod_zone_advice(struct mapod_zone *zone,
                                                   const struct mapod_link *link, uint32_t now_ms)
{
    if (((now_ms - zone->arrived_ms) > MAPOD_ZONE_STALE_MS) ||
        ((link->newest_t_ms - zone->t_ms) > MAPOD_ZONE_STALE_MS)) {
        zone->state = MAPOD_ZONE_UNKNOWN;
    }
    if (zone->state == MAPOD_ZONE_CLEAR) {
        return MAPOD_GO;
    }
    return (zone->state == MAPOD_ZONE_SLOW) ? MAPOD_SLOW : MAPOD_STOP;
}

/* ---- TILE ---- */

static uint32_t mapod_p_tile_bytes(uint8_t layer, uint32_t count)
{
    return (layer == MAPOD_LAYER_CLASS) ? ((count + 3u) >> 2) : (count * 2u);
}

/* Whether the piece is as long as it says, and lies in its rectangle. Of a layer of later days
 * nothing can be told: it is taken, and holds no values. */
static bool mapod_p_tile_fits(const uint8_t *body, uint32_t size)
{
    uint32_t count;
    uint32_t area;
    if (size < 20u) {
        return false;
    }
    count = mapod_p_u16(&body[16]);
    area = (uint32_t)mapod_p_u16(&body[8]) * mapod_p_u16(&body[10]);
    if (body[3] != 0u) {
        return (count == 0u) && (size == 20u);
    }
    if (body[2] > MAPOD_LAYER_SLOPE) {
        return true;
    }
    return (count > 0u) && (size == (20u + mapod_p_tile_bytes(body[2], count))) &&
           ((mapod_p_u24(&body[12]) + count) <= area);
}

MAPOD_LINK_API bool mapod_tile_from(const struct mapod_link *link, struct mapod_tile *tile)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    if ((!mapod_p_holds(link, MAPOD_TILE)) || (!mapod_p_tile_fits(body, link->used))) {
        return false;
    }
    tile->values = &body[20];
    tile->first = mapod_p_u24(&body[12]);
    tile->id = mapod_p_u16(&body[0]);
    tile->width = mapod_p_u16(&body[8]);
    tile->height = mapod_p_u16(&body[10]);
    tile->count = (body[2] > MAPOD_LAYER_SLOPE) ? 0u : mapod_p_u16(&body[16]);
    tile->cell_mm = mapod_p_u16(&body[18]);
    tile->i = mapod_p_i16(&body[4]);
    tile->j = mapod_p_i16(&body[6]);
    tile->layer = body[2];
    tile->status = body[3];
    tile->geom_id = body[15];
    return true;
}

MAPOD_LINK_API int32_t mapod_tile_value(const struct mapod_tile *tile, uint32_t k)
{
    const uint8_t *const values = tile->values;
    const bool is_class = tile->layer == MAPOD_LAYER_CLASS;
    uint32_t raw;
    if (k >= tile->count) {
        return is_class ? (int32_t)MAPOD_UNKNOWN : MAPOD_NOT_KNOWN;
    }
    if (is_class) {
        raw = ((uint32_t)values[k >> 2] >> ((k & 3u) * 2u)) & 3u;
        return (raw == 3u) ? (int32_t)MAPOD_UNKNOWN : (int32_t)raw;
    }
    raw = mapod_p_u16(&values[k * 2u]);
    if (tile->layer == MAPOD_LAYER_HEIGHT) {
        return (raw == 0x8000u) ? MAPOD_NOT_KNOWN : (int32_t)mapod_p_signed((uint16_t)raw);
    }
    return (raw == 0xFFFFu) ? MAPOD_NOT_KNOWN : (int32_t)raw;
}

#ifdef MAPOD_LINK_OBJECTS

/* ---- OBJECTS ---- */

#define MAPOD_P_OBJECTS_HEAD 20u
#define MAPOD_P_RECORD 28u /* bytes before the corners, the age with them */
#define MAPOD_P_GONE 8u
#define MAPOD_P_FARTHEST_MM 2100000000

/* Whether the sender's frame is of the epoch in use. */
static bool mapod_p_of_epoch(const struct mapod_link *link, uint8_t geom_id)
{
    return mapod_p_is(link, MAPOD_P_HAS_GEOM) && (geom_id == link->geom.geom_id);
}

static bool mapod_p_is_far(const uint8_t *at)
{
    const int32_t place_mm = mapod_p_i32(at);
    return (place_mm < -MAPOD_P_FARTHEST_MM) || (place_mm > MAPOD_P_FARTHEST_MM);
}

/* Bytes of the record at the front of the `left` bytes; 0: it can't be one. */
static uint32_t mapod_p_record(const uint8_t *at, uint32_t left)
{
    const uint32_t size = MAPOD_P_RECORD + (4u * (uint32_t)((left < MAPOD_P_GONE) ? 0u : at[3]));
    if (left < MAPOD_P_GONE) {
        return 0u;
    }
    if (at[2] == 0u) {
        return (at[3] == 0u) ? MAPOD_P_GONE : 0u;
    }
    if ((at[3] < 3u) || (at[3] > 64u) || (size > left) || mapod_p_is_far(&at[8]) ||
        mapod_p_is_far(&at[12]) || (mapod_p_i16(&at[16]) > mapod_p_i16(&at[18])) ||
        (at[26] == 0u)) {
        return 0u;
    }
    return size;
}

/* Where the object stands in the list; its end if it does not. */
static uint32_t mapod_p_find(const struct mapod_objects *objects, uint32_t id)
{
    uint32_t k = 0u;
    while ((k < objects->count) && (objects->items[k].id != id)) {
        k++;
    }
    return k;
}

/* The last one takes its place. */
static void mapod_p_drop(struct mapod_objects *objects, uint32_t k)
{
    objects->digest -= objects->items[k].digest;
    objects->count--;
    if (k != objects->count) {
        objects->items[k] = objects->items[objects->count];
    }
}

static void mapod_p_corner(struct mapod_object *object, uint32_t k, int16_t x, int16_t y)
{
    object->corner_x[k] = x;
    object->corner_y[k] = y;
}

/* The corners of a record; where there is no room for them, those of their box. */
static void mapod_p_corners(struct mapod_object *object, const uint8_t *at, uint32_t corners)
{
    int16_t low_x = 32767, low_y = 32767, high_x = -32767 - 1, high_y = -32767 - 1;
    uint32_t k;
    for (k = 0u; k < corners; k++) {
        const int16_t x = mapod_p_i16(&at[4u * k]);
        const int16_t y = mapod_p_i16(&at[(4u * k) + 2u]);
        low_x = (x < low_x) ? x : low_x;
        low_y = (y < low_y) ? y : low_y;
        high_x = (x > high_x) ? x : high_x;
        high_y = (y > high_y) ? y : high_y;
        if (k < MAPOD_CORNERS_MAX) {
            mapod_p_corner(object, k, x, y);
        }
    }
    object->corners = (uint8_t)corners;
    if (corners > MAPOD_CORNERS_MAX) {
        mapod_p_corner(object, 0u, low_x, low_y);
        mapod_p_corner(object, 1u, high_x, low_y);
        mapod_p_corner(object, 2u, high_x, high_y);
        mapod_p_corner(object, 3u, low_x, high_y);
        object->corners = 4u;
        object->flags = (uint8_t)(object->flags | MAPOD_OBJECT_ENLARGED);
    }
}

/* A record that has been checked: the object is gone, or is as it says. */
static void mapod_p_take_record(struct mapod_objects *objects, const uint8_t *at, uint32_t size,
                                uint32_t t_ms)
{
    const uint32_t k = mapod_p_find(objects, mapod_p_u32(&at[4]));
    struct mapod_object *const object = &objects->items[k];
    const uint16_t age_ms = mapod_p_u16(at);
    if (k < objects->count) {
        if (at[2] == 0u) {
            mapod_p_drop(objects, k);
            return;
        }
        objects->digest -= object->digest;
    } else {
        if ((at[2] == 0u) || (k >= MAPOD_OBJECTS_MAX)) {
            objects->left_out = objects->left_out || (at[2] != 0u);
            return;
        }
        objects->count++;
    }
    object->id = mapod_p_u32(&at[4]);
    object->digest = mapod_p_crc(0u, &at[2], size - 2u);
    object->seen_ms = t_ms - age_ms;
    object->forgotten = age_ms == 0xFFFFu;
    object->kind = at[2];
    object->x_mm = mapod_p_i32(&at[8]);
    object->y_mm = mapod_p_i32(&at[12]);
    object->bottom_mm = mapod_p_i16(&at[16]);
    object->top_mm = mapod_p_i16(&at[18]);
    object->vx_mmps = mapod_p_i16(&at[20]);
    object->vy_mmps = mapod_p_i16(&at[22]);
    object->confidence = at[24];
    object->flags = at[25];
    object->unit_mm = at[26];
    mapod_p_corners(object, &at[MAPOD_P_RECORD], at[3]);
    objects->digest += object->digest;
}

/* Whether a frame's records tell of the object. */
static bool mapod_p_lists(const uint8_t *body, uint32_t size, uint32_t id)
{
    uint32_t at = MAPOD_P_OBJECTS_HEAD;
    while (at < size) {
        if ((body[at + 2u] != 0u) && (mapod_p_u32(&body[at + 4u]) == id)) {
            return true;
        }
        at += mapod_p_record(&body[at], size - at);
    }
    return false;
}

/* Of the ids from first to last, just those in the frame are there. */
static void mapod_p_take_range(struct mapod_objects *objects, const uint8_t *body, uint32_t size)
{
    const uint32_t first = mapod_p_u32(&body[12]);
    const uint32_t last = mapod_p_u32(&body[16]);
    uint32_t k = 0u;
    while (k < objects->count) {
        const uint32_t id = objects->items[k].id;
        if ((id >= first) && (id <= last) && (!mapod_p_lists(body, size, id))) {
            mapod_p_drop(objects, k); /* another one stands at k now */
        } else {
            k++;
        }
    }
}

/* Of another epoch: the list is empty. */
static void mapod_p_follow(struct mapod_objects *objects, const struct mapod_link *link)
{
    if (objects->epochs != link->epochs) {
        mapod_objects_init(objects);
        objects->epochs = link->epochs;
    }
}

MAPOD_LINK_API void mapod_objects_init(struct mapod_objects *objects)
{
    (void)memset(objects, 0, sizeof *objects);
}

MAPOD_LINK_API bool mapod_objects_from(struct mapod_objects *objects,
                                       const struct mapod_link *link)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    const uint32_t size = link->used;
    uint32_t at = MAPOD_P_OBJECTS_HEAD;
    mapod_p_follow(objects, link);
    if ((!mapod_p_holds(link, MAPOD_OBJECTS)) && (link->used > 0u)) {
        return false;
    }
    while (at < size) {
        const uint32_t record = mapod_p_record(&body[at], size - at);
        at = (record == 0u) ? (size + 1u) : (at + record);
    }
    if (at != size) {
        objects->agrees = false;
        return false;
    }
    if (!mapod_p_of_epoch(link, body[0])) {
        return false;
    }
    mapod_p_take_range(objects, body, size);
    for (at = MAPOD_P_OBJECTS_HEAD; at < size;) {
        const uint32_t record = mapod_p_record(&body[at], size - at);
        mapod_p_take_record(objects, &body[at], record, link->newest_t_ms);
        at += record;
    }
    objects->told = mapod_p_u16(&body[2]);
    objects->waiting = mapod_p_u16(&body[4]);
    objects->look_ms = mapod_p_u16(&body[6]);
    objects->agrees = (objects->count == objects->told) &&
                      (objects->digest == mapod_p_u32(&body[8]));
    objects->left_out = objects->left_out && (!objects->agrees);
    objects->t_ms = link->newest_t_ms;
    objects->arrived_ms = link->newest_ms;
    objects->gaps = link->gaps;
    objects->any = true;
    objects->late = false;
    return true;
}

MAPOD_LINK_API enum mapod_worth mapod_objects_worth(struct mapod_objects *objects,
                                                    const struct mapod_link *link,
                                                    uint32_t now_ms)
{
    const uint32_t since_ms = now_ms - objects->arrived_ms;
    mapod_p_follow(objects, link);
    objects->late = objects->late || (since_ms > MAPOD_OBJECTS_STALE_MS);
    if (!objects->any) {
        return MAPOD_WORTH_NONE;
    }
    if (objects->late) {
        return MAPOD_WORTH_LATE;
    }
    if (objects->gaps != link->gaps) {
        return MAPOD_WORTH_GAP;
    }
    if (!objects->agrees) {
        return objects->left_out ? MAPOD_WORTH_LEFT_OUT : MAPOD_WORTH_DIFFERS;
    }
    if (objects->waiting != 0u) {
        return MAPOD_WORTH_WAITING;
    }
    return ((objects->look_ms + since_ms) > MAPOD_LOOK_STALE_MS) ? MAPOD_WORTH_BLIND
                                                                 : MAPOD_WORTH_KNOWN;
}

MAPOD_LINK_API bool mapod_objects_old(struct mapod_objects *objects, uint32_t k, uint32_t now_ms)
{
    struct mapod_object *object;
    if (k >= objects->count) {
        return true;
    }
    object = &objects->items[k];
    if ((((objects->t_ms - object->seen_ms) + (now_ms - objects->arrived_ms)) >
         MAPOD_MOVING_STALE_MS) &&
        (object->kind == MAPOD_OBJECT_MOVING)) {
        object->forgotten = true;
    }
    return object->forgotten && (object->kind == MAPOD_OBJECT_MOVING);
}

/* ---- PATH ---- */

#define MAPOD_P_PATH_HEAD 24u

MAPOD_LINK_API void mapod_path_init(struct mapod_path *path)
{
    (void)memset(path, 0, sizeof *path);
}

/* Points of the piece in the body; 65 536: its numbers can't be. */
static uint32_t mapod_p_path_points(const uint8_t *body, uint32_t size)
{
    const uint32_t bytes = size - MAPOD_P_PATH_HEAD;
    const uint32_t points = bytes >> 2;
    const uint32_t total = mapod_p_u16(&body[4]);
    const uint32_t first = mapod_p_u16(&body[6]);
    const uint32_t ahead = mapod_p_u16(&body[12]);
    const bool wrong = (size < MAPOD_P_PATH_HEAD) || ((bytes & 3u) != 0u) ||
                       (mapod_p_u16(&body[0]) == 0u) || ((first + points) > total) ||
                       ((points == 0u) && (total != 0u)) || mapod_p_is_far(&body[16]) ||
                       mapod_p_is_far(&body[20]) ||
                       ((ahead != MAPOD_PATH_NOWHERE) && (ahead > total)) ||
                       ((points != 0u) && (mapod_p_u16(&body[8]) >= mapod_p_u16(&body[10])));
    return wrong ? 65536u : points;
}

/* Of another epoch: there is no path. */
static void mapod_p_follow_path(struct mapod_path *path, const struct mapod_link *link)
{
    if (path->epochs != link->epochs) {
        mapod_path_init(path);
        path->epochs = link->epochs;
    }
}

static void mapod_p_take_point(struct mapod_path *path, const uint8_t *body, uint32_t k)
{
    const uint8_t *const at = &body[MAPOD_P_PATH_HEAD + (4u * k)];
    const uint32_t number = mapod_p_u16(&body[6]) + k;
    if (number < MAPOD_PATH_MAX) {
        struct mapod_path_point *const point = &path->points[number];
        path->missing -= point->here ? 0u : 1u;
        point->x_mm = mapod_p_i32(&body[16]) + mapod_p_i16(&at[0]);
        point->y_mm = mapod_p_i32(&body[20]) + mapod_p_i16(&at[2]);
        point->segment = mapod_p_u16(&body[8]);
        point->kind = body[3];
        point->here = true;
    }
}

MAPOD_LINK_API bool mapod_path_from(struct mapod_path *path, const struct mapod_link *link)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    uint32_t points;
    uint32_t k;
    mapod_p_follow_path(path, link);
    if ((!mapod_p_holds(link, MAPOD_PATH)) && (link->used > 0u)) {
        return false;
    }
    points = mapod_p_path_points(body, link->used);
    if (points > 65535u) {
        path->damaged = true;
        return false;
    }
    if (!mapod_p_of_epoch(link, body[2])) {
        return false;
    }
    if ((mapod_p_u16(&body[0]) != path->number) || (mapod_p_u16(&body[4]) != path->total)) {
        mapod_path_init(path);
        path->epochs = link->epochs;
        path->number = mapod_p_u16(&body[0]);
        path->total = mapod_p_u16(&body[4]);
        path->missing = (path->total > MAPOD_PATH_MAX) ? MAPOD_PATH_MAX : path->total;
    }
    for (k = 0u; k < points; k++) {
        mapod_p_take_point(path, body, k);
    }
    path->segments = mapod_p_u16(&body[10]);
    path->ahead = mapod_p_u16(&body[12]);
    path->left_out = mapod_p_u16(&body[14]);
    path->arrived_ms = link->newest_ms;
    path->gaps = link->gaps;
    path->damaged = false;
    path->late = false;
    return true;
}

MAPOD_LINK_API enum mapod_worth mapod_path_worth(struct mapod_path *path,
                                                 const struct mapod_link *link, uint32_t now_ms)
{
    mapod_p_follow_path(path, link);
    path->late = path->late || ((now_ms - path->arrived_ms) > MAPOD_PATH_STALE_MS);
    if (path->number == 0u) {
        return MAPOD_WORTH_NONE;
    }
    if (path->late) {
        return MAPOD_WORTH_LATE;
    }
    if (path->gaps != link->gaps) {
        return MAPOD_WORTH_GAP;
    }
    if ((path->missing != 0u) || path->damaged) {
        return MAPOD_WORTH_DIFFERS;
    }
    return (path->total > MAPOD_PATH_MAX) ? MAPOD_WORTH_LEFT_OUT : MAPOD_WORTH_KNOWN;
}

#endif

/* ======== Which frames count, and what they do, sections 2, 5 and 9 ======================== */

/* Notes an accepted frame: newest number, mask of the ACK, gap. */
static void mapod_p_count(struct mapod_link *link, uint32_t now_ms, bool begins)
{
    const uint16_t seq = mapod_p_u16(&link->frame[2]);
    const uint32_t back = (uint32_t)(uint16_t)(seq - link->last) - 1u; /* frames that are missing */
    if (begins || (!mapod_p_is(link, MAPOD_P_ANY))) {
        link->mask = 0u;
    } else {
        if (back > 0u) {
            link->gap = (uint16_t)(seq - 1u);
            mapod_p_set(link, MAPOD_P_SUSPECT, true);
#ifdef MAPOD_LINK_OBJECTS
            link->gaps++;
#endif
        }
        link->mask = (back > 31u) ? 0u : (((link->mask << back) << 1) | ((uint32_t)1u << back));
    }
    link->last = seq;
    link->newest_t_ms = mapod_p_u32(&link->frame[4]);
    link->newest_ms = now_ms;
    mapod_p_set(link, MAPOD_P_ANY, true);
}

/* Whether the GEOM body in the buffer is of another run of the sender than the one in use. */
static bool mapod_p_is_new_session(const struct mapod_link *link)
{
    return (!mapod_p_is(link, MAPOD_P_HAS_GEOM)) ||
           (mapod_p_u32(&link->frame[MAPOD_P_HEAD + 8u]) != link->geom.session);
}

/* Whether it tells the number, width, height and cell that are in use. */
static bool mapod_p_same_layout(const struct mapod_link *link, const uint8_t *body)
{
    const struct mapod_geom *const geom = &link->geom;
#ifdef MAPOD_LINK_BIG_ENDIAN
    return (geom->geom_id == body[0]) && (geom->width == mapod_p_u16(&body[2])) &&
           (geom->height == mapod_p_u16(&body[4])) && (geom->cell_mm == mapod_p_u16(&body[6]));
#else
    const uint8_t *const old = (const uint8_t *)geom;
    return (((mapod_p_u32(old) ^ mapod_p_u32(body)) & 0xFFFF00FFu) == 0u) &&
           (mapod_p_u32(&old[4]) == mapod_p_u32(&body[4]));
#endif
}

/* A GEOM frame has been accepted. One that is too large leaves no map, never an old one. */
static int mapod_p_adopt(struct mapod_link *link)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    const bool begins = mapod_p_is_new_session(link);
    const bool same = (!begins) && mapod_p_same_layout(link, body);
    uint32_t flags = link->flags & ~(MAPOD_P_HAS_GEOM | MAPOD_P_NEED_GEOM);
    bool fits;
#ifdef MAPOD_LINK_BIG_ENDIAN
    link->geom.geom_id = body[0];
    link->geom.width = mapod_p_u16(&body[2]);
    link->geom.height = mapod_p_u16(&body[4]);
    link->geom.cell_mm = mapod_p_u16(&body[6]);
    link->geom.session = mapod_p_u32(&body[8]);
    link->geom.tick_ms = mapod_p_u16(&body[12]);
    link->geom.stale_ms = mapod_p_u16(&body[14]);
#else
    (void)memcpy(&link->geom, body, sizeof link->geom);
#endif
    fits = mapod_p_area(link) <= link->max_cells;
    flags |= fits ? MAPOD_P_HAS_GEOM : MAPOD_P_NEED_GEOM;
    if (begins) {
        flags = (flags & ~MAPOD_P_HAS_POSE) | MAPOD_P_POSE_LATE | MAPOD_P_MAP_LATE;
    }
    if (!same) {
        flags &= ~MAPOD_P_OF_GEOM;
#ifdef MAPOD_LINK_OBJECTS
        link->epochs++;
#endif
    }
    link->flags = (uint16_t)flags;
    if (fits && (!same)) {
        mapod_p_clear(link);
    }
    return fits ? (int)MAPOD_GEOM : (int)MAPOD_TOO_LARGE;
}

static void mapod_p_take_pose(struct mapod_link *link)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    struct mapod_pose *const pose = &link->pose;
#ifdef MAPOD_LINK_BIG_ENDIAN
    pose->x_mm = mapod_p_i32(&body[0]);
    pose->y_mm = mapod_p_i32(&body[4]);
    pose->yaw = mapod_p_i16(&body[8]);
    pose->pitch = mapod_p_i16(&body[10]);
    pose->roll = mapod_p_i16(&body[12]);
    pose->v_mmps = mapod_p_i16(&body[14]);
    pose->w_mradps = mapod_p_i16(&body[16]);
    pose->health = mapod_p_u16(&body[18]);
    pose->age_scan = body[20];
    pose->age_attitude = body[21];
    pose->age_encoders = body[22];
    pose->mode = body[23];
#else
    (void)memcpy(pose, body, 24u);
#endif
    pose->t_ms = link->newest_t_ms;
    link->pose_ms = link->newest_ms;
    mapod_p_set(link, MAPOD_P_HAS_POSE, true);
    mapod_p_set(link, MAPOD_P_POSE_LATE, false);
}

/* MAP of another geometry: its number counts, and GEOM is asked for. */
static bool mapod_p_is_foreign(const struct mapod_link *link)
{
    return (!mapod_p_is(link, MAPOD_P_HAS_GEOM)) ||
           (link->frame[MAPOD_P_HEAD + 6u] != link->geom.geom_id);
}

/* A MAP frame; if it is of this geometry, its operations have been checked. */
static int mapod_p_take_map(struct mapod_link *link, uint32_t size)
{
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    if (mapod_p_is_foreign(link)) {
        mapod_p_set(link, MAPOD_P_NEED_GEOM, true);
        return MAPOD_FOREIGN_MAP;
    }
    link->map_ms = link->newest_ms;
    mapod_p_set(link, MAPOD_P_MAP_LATE, false);
    if (link->cells == NULL) {
        return MAPOD_MAP;
    }
    mapod_p_move(link, mapod_p_u16(&body[0]), mapod_p_u16(&body[2]));
    if (mapod_p_ahead(mapod_p_u16(&body[4]), link->gap) >= 0) {
        mapod_p_set(link, MAPOD_P_SUSPECT, false);
    }
    (void)mapod_p_walk(link, size, true);
    return MAPOD_MAP;
}

/* Whether the body in the buffer has a length, and contents, that can be. */
static bool mapod_p_body_fits(struct mapod_link *link, uint32_t type, uint32_t size)
{
    static const uint8_t sizes[16] = {0u, 16u, 24u, 0u, 8u, MAPOD_P_ZONE_SIZE}; /* 0: any */
    const uint8_t *const body = &link->frame[MAPOD_P_HEAD];
    const uint32_t area = (uint32_t)mapod_p_u16(&body[2]) * mapod_p_u16(&body[4]);
    if (type == (uint32_t)MAPOD_MAP) {
        return (size >= MAPOD_P_MAP_HEAD) &&
               (mapod_p_is_foreign(link) || mapod_p_walk(link, size, false));
    }
#ifndef MAPOD_LINK_NO_TILES
    if (type == (uint32_t)MAPOD_TILE) {
        return mapod_p_tile_fits(body, size);
    }
#endif
    if ((sizes[type] != 0u) && (size != sizes[type])) {
        return false;
    }
    return (type != (uint32_t)MAPOD_GEOM) || ((area != 0u) && (mapod_p_u16(&body[6]) != 0u));
}

/* Whether a frame's number, and with a key its time, make it one to be taken. */
static bool mapod_p_is_newer(const struct mapod_link *link)
{
#ifdef MAPOD_LINK_AUTH
    if ((link->key != NULL) && (mapod_p_u32(&link->frame[4]) < link->newest_t_ms)) {
        return false;
    }
#endif
    return mapod_p_ahead(mapod_p_u16(&link->frame[2]), link->last) > 0;
}

/* A frame of right version, flags, length, CRC and tag: does it count, and what does it do? */
static int mapod_p_act(struct mapod_link *link, uint32_t now_ms, uint32_t size)
{
    const uint32_t type = link->frame[0] & 15u;
    bool fresh; /* a new run of the sender, or after a long silence: numbers before say nothing */
    if ((type >= MAPOD_P_ACK) && (type <= MAPOD_P_EXTERNAL_POSE)) {
        return MAPOD_NOTHING; /* an echo of what travels the other way */
    }
    fresh = (type == (uint32_t)MAPOD_GEOM) && (size == 16u) && mapod_p_is_new_session(link);
    if (mapod_p_is(link, MAPOD_P_ANY) && (!fresh)) {
        const uint32_t silence_ms = mapod_p_u32(&link->frame[4]) - link->newest_t_ms;
        fresh = (silence_ms >= MAPOD_P_SILENCE_MS) && (silence_ms < 0x80000000u);
        if ((!fresh) && (!mapod_p_is_newer(link))) {
            return MAPOD_NOTHING;
        }
    }
    if (!mapod_p_body_fits(link, type, size)) {
        return MAPOD_BAD_BODY;
    }
    if (fresh && mapod_p_is(link, MAPOD_P_HAS_GEOM)) {
        mapod_p_clear(link);
#ifdef MAPOD_LINK_OBJECTS
        link->epochs++;
#endif
    }
    mapod_p_count(link, now_ms, fresh);
    if (type == (uint32_t)MAPOD_GEOM) {
#ifdef MAPOD_LINK_AUTH
        mapod_p_leave_session(link);
#endif
        return mapod_p_adopt(link);
    }
    if (type == (uint32_t)MAPOD_MAP) {
        return mapod_p_take_map(link, size);
    }
    if (type == (uint32_t)MAPOD_POSE) {
        mapod_p_take_pose(link);
    }
#ifdef MAPOD_LINK_OBJECTS
    if ((type == (uint32_t)MAPOD_OBJECTS) || (type == (uint32_t)MAPOD_PATH)) {
        return (int)type;
    }
#endif
    /* The body of any other waits in the buffer for whoever wants it. */
    return ((type == 0u) || (type > MAPOD_P_LAST_TYPE)) ? (int)MAPOD_UNKNOWN_TYPE : (int)type;
}

/* The frame in the buffer; below 0: why it was rejected. */
static int mapod_p_check(struct mapod_link *link, uint32_t now_ms)
{
    const uint8_t *const frame = link->frame;
    uint32_t end = link->used; /* of the body */
    if (end < (MAPOD_P_HEAD + 4u)) {
        return MAPOD_BAD_LENGTH;
    }
    end -= 4u;
    if (mapod_p_crc(MAPOD_P_CRC_START, frame, end) != mapod_p_u32(&frame[end])) {
        return MAPOD_BAD_CRC;
    }
    if ((frame[0] >> 4) != 1u) {
        return MAPOD_BAD_VERSION;
    }
    if ((frame[1] & 0xE0u) != 0u) {
        return MAPOD_BAD_FLAGS;
    }
    if ((frame[1] & MAPOD_P_AUTH) != 0u) {
        if (end < (MAPOD_P_HEAD + 8u)) {
            return MAPOD_BAD_LENGTH;
        }
        end -= 8u;
    }
#ifdef MAPOD_LINK_AUTH
    if (!mapod_p_tag_is_right(link, end)) {
        return MAPOD_BAD_TAG;
    }
#endif
    link->used = (uint16_t)(end - MAPOD_P_HEAD);
    return mapod_p_act(link, now_ms, link->used);
}

/* One decoded byte of a serial frame. */
static void mapod_p_put(struct mapod_link *link, uint8_t byte)
{
    if (link->used < MAPOD_FRAME_MAX) {
        link->frame[link->used] = byte;
        link->used++;
    } else {
        mapod_p_set(link, MAPOD_P_BROKEN, true);
    }
}

/* The bytes in the buffer are all of a frame. */
static int mapod_p_end(struct mapod_link *link, uint32_t now_ms, bool whole)
{
    const int outcome = whole ? mapod_p_check(link, now_ms) : (int)MAPOD_BAD_COBS;
    if (outcome < 0) {
        link->bad_frames++;
    }
    if (outcome <= 0) {
        link->used = 0u; /* else: the size of the body, until the next byte */
    }
    return outcome;
}

/* ======== What is called from outside ======================================================= */

MAPOD_LINK_API void mapod_link_init(struct mapod_link *link, uint8_t *cells, uint32_t max_cells)
{
    (void)memset(link, 0, sizeof *link);
    link->cells = cells;
    link->max_cells = max_cells;
    link->flags = MAPOD_P_AT_START;
}

MAPOD_LINK_API int mapod_link_datagram(struct mapod_link *link, uint32_t now_ms,
                                       const uint8_t *data, uint32_t size)
{
    if (size > MAPOD_FRAME_MAX) {
        link->bad_frames++;
        return MAPOD_BAD_LENGTH;
    }
    (void)memcpy(link->frame, data, size);
    link->used = (uint16_t)size;
    return mapod_p_end(link, now_ms, true);
}

MAPOD_LINK_API int mapod_link_byte(struct mapod_link *link, uint32_t now_ms, uint8_t byte)
{
    const bool begun = mapod_p_is(link, MAPOD_P_BEGUN);
    if (byte == 0u) {
        const bool whole = (link->left == 0u) && (!mapod_p_is(link, MAPOD_P_BROKEN));
        link->left = 0u;
        mapod_p_set(link, MAPOD_P_BEGUN | MAPOD_P_BROKEN | MAPOD_P_ZERO_DUE, false);
        return begun ? mapod_p_end(link, now_ms, whole) : (int)MAPOD_NOTHING;
    }
    if (!begun) {
        link->used = 0u;
        mapod_p_set(link, MAPOD_P_BEGUN, true);
    }
    if (link->left > 0u) {
        link->left--;
        mapod_p_put(link, byte);
    } else {
        if (mapod_p_is(link, MAPOD_P_ZERO_DUE)) {
            mapod_p_put(link, 0u);
        }
        link->left = (uint8_t)(byte - 1u);
        mapod_p_set(link, MAPOD_P_ZERO_DUE, byte != 255u);
    }
    return MAPOD_NOTHING;
}

MAPOD_LINK_API uint8_t mapod_link_cell(const struct mapod_link *link, uint32_t column, uint32_t row)
{
    const uint32_t width = link->geom.width;
    const uint32_t height = link->geom.height;
    uint32_t at_column = column + link->base_column;
    uint32_t at = row + link->base_row;
    if ((column >= width) || (row >= height) || (!mapod_p_is(link, MAPOD_P_HAS_MAP))) {
        return MAPOD_UNKNOWN;
    }
    at -= (at >= height) ? height : 0u;
    at_column -= (at_column >= width) ? width : 0u;
    at = (at * width) + at_column;
    return (uint8_t)(((uint32_t)link->cells[at >> 2] >> ((at & 3u) * 2u)) & 3u);
}

MAPOD_LINK_API const struct mapod_pose *mapod_link_pose(const struct mapod_link *link)
{
    return mapod_p_is(link, MAPOD_P_HAS_POSE) ? &link->pose : NULL;
}

MAPOD_LINK_API const struct mapod_geom *mapod_link_geom(const struct mapod_link *link)
{
    return mapod_p_is(link, MAPOD_P_HAS_GEOM) ? &link->geom : NULL;
}

MAPOD_LINK_API bool mapod_link_suspect(const struct mapod_link *link)
{
    return mapod_p_is(link, MAPOD_P_SUSPECT);
}

MAPOD_LINK_API bool mapod_link_blank(const struct mapod_link *link)
{
    return !mapod_p_is(link, MAPOD_P_HAS_MAP);
}

/* What has been late once stays late until its frame comes: the clock's wrap revives nothing. */
MAPOD_LINK_API bool mapod_link_stale(struct mapod_link *link, uint32_t now_ms)
{
    const uint32_t limit = link->geom.stale_ms;
    if ((now_ms - link->pose_ms) > limit) {
        mapod_p_set(link, MAPOD_P_POSE_LATE, true);
    }
    if ((now_ms - link->map_ms) > limit) {
        mapod_p_set(link, MAPOD_P_MAP_LATE, true);
    }
    return mapod_p_is(link, MAPOD_P_POSE_LATE | MAPOD_P_MAP_LATE) ||
           (!mapod_p_is(link, MAPOD_P_HAS_GEOM));
}

#ifdef __cplusplus
}
#endif

#endif
#endif
