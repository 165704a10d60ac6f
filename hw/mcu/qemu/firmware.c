/* A planner's firmware without a planner, for the emulated board: link on UART0, text on UART1.
 *
 * Text, one word a line: `status`, `dump` (the whole window, a digit a cell, row by row), `zone`,
 * `drive V W MS` (asks the robot to move). Each gives one line, `dump` one more for each row.
 * With MAPOD_LINK_AUTH its key is 00 01 .. 1f.
 */
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#include "board.h"

#define LINE 40u
#define NONCE 0x11223344u /* of a test; a robot's firmware draws one at random */

static struct mapod_link receiver;
static struct mapod_talk talk;
static struct mapod_zone zone;
static uint8_t cells[MAPOD_CELL_BYTES(401, 401)];
static uint32_t accepted;
static char line[LINE];
static uint32_t line_size;

static void say_status(void)
{
    const uint32_t now_ms = board_now_ms();
    const struct mapod_pose *const pose = mapod_link_pose(&receiver);
    board_say_number("status blank=", mapod_link_blank(&receiver));
    board_say_number(" suspect=", mapod_link_suspect(&receiver));
    board_say_number(" stale=", mapod_link_stale(&receiver, now_ms));
    board_say_number(" advice=", (int32_t)mapod_link_advice(&receiver, now_ms));
    board_say_number(" why=", (int32_t)mapod_link_why(&receiver, now_ms));
    board_say_number(" last=", receiver.last);
    board_say_number(" accepted=", (int32_t)accepted);
    board_say_number(" bad=", receiver.bad_frames);
    board_say_number(" x_mm=", (pose == NULL) ? 0 : pose->x_mm);
    board_say_number(" digest_ok=", mapod_p_is(&receiver, MAPOD_P_DIGEST_OK));
    board_say_number(" stack=", (int32_t)stack_used());
    board_say("\n");
}

static void say_map(void)
{
    const struct mapod_geom *const geom = mapod_link_geom(&receiver);
    const uint32_t width = (geom == NULL) ? 0u : geom->width;
    const uint32_t height = (geom == NULL) ? 0u : geom->height;
    uint32_t row, column;
    board_say_number("map ", (int32_t)width);
    board_say_number(" ", (int32_t)height);
    board_say("\n");
    for (row = 0u; row < height; row++) {
        for (column = 0u; column < width; column++) {
            const uint8_t digit = (uint8_t)('0' + mapod_link_cell(&receiver, column, row));
            board_write(UART_TEXT, &digit, 1u);
        }
        board_say("\n");
    }
}

static void say_zone(void)
{
    board_say_number("zone state=", zone.state);
    board_say_number(" free_ahead=", zone.free_ahead_mm);
    board_say_number(" advice=", (int32_t)mapod_zone_advice(&zone, &receiver, board_now_ms()));
    board_say("\n");
}

static void send(uint8_t *frame, uint32_t size)
{
    if (size > 0u) {
        board_write(UART_LINK, frame, mapod_talk_serial(frame, size));
    }
}

/* The number in the line from `at` on; moves `at` behind it and the blank that follows. */
static int32_t number_at(uint32_t *at)
{
    const bool negative = line[*at] == '-';
    int32_t number = 0;
    *at += negative ? 1u : 0u;
    while ((*at < line_size) && (line[*at] >= '0') && (line[*at] <= '9') && (number < 100000)) {
        number = (number * 10) + (line[*at] - '0');
        (*at)++;
    }
    (*at)++;
    return negative ? -number : number;
}

static void drive(void)
{
    uint8_t out[MAPOD_OUT_MAX];
    uint32_t at = 6u;
    const int16_t v_mmps = (int16_t)number_at(&at);
    const int16_t w_mradps = (int16_t)number_at(&at);
    const uint16_t valid_ms = (uint16_t)number_at(&at);
    const uint32_t size = mapod_talk_drive(&talk, &receiver, board_now_ms(), v_mmps, w_mradps,
                                           valid_ms, out);
    send(out, size);
    board_say_number("drive ", (int32_t)size);
    board_say("\n");
}

static void obey(void)
{
    switch (line[0]) {
    case 's':
        say_status();
        break;
    case 'd':
        if (line[1] == 'r') {
            drive();
        } else {
            say_map();
        }
        break;
    case 'z':
        say_zone();
        break;
    default:
        board_say("what?\n");
        break;
    }
}

static void take(uint8_t byte)
{
    const int outcome = mapod_link_byte(&receiver, board_now_ms(), byte);
    accepted += (outcome > 0) ? 1u : 0u;
    if (outcome == MAPOD_DIGEST) {
        (void)mapod_link_check_digest(&receiver);
    } else if (outcome == MAPOD_STOP_ZONE) {
        (void)mapod_zone_from(&receiver, &zone);
    } else {
        /* The receiver has done what there was to do. */
    }
}

int main(void)
{
    uint8_t byte;
    uint8_t out[MAPOD_OUT_MAX];
    board_start();
    mapod_link_init(&receiver, cells, 401u * 401u);
    mapod_talk_init(&talk, NONCE, false);
#ifdef MAPOD_LINK_AUTH
    {
        static uint8_t key[32];
        for (byte = 0u; byte < 32u; byte++) {
            key[byte] = byte;
        }
        mapod_link_set_key(&receiver, key, NONCE);
    }
#endif
    for (;;) {
        while (board_read(&byte)) {
            take(byte);
            send(out, mapod_talk_poll(&talk, &receiver, board_now_ms(), out));
        }
        send(out, mapod_talk_poll(&talk, &receiver, board_now_ms(), out));
        if (board_read_text(&byte)) {
            if (byte == (uint8_t)'\n') {
                line[line_size] = '\0';
                obey();
                line_size = 0u;
            } else if (line_size < (LINE - 1u)) {
                line[line_size] = (char)byte;
                line_size++;
            } else {
                /* Nobody asks so much. */
            }
        }
    }
}
