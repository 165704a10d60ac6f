/* A firmware with the C header of the link and no planner, for the tests of the header: link on
 * UART0, text on UART1.
 *
 * Text, one word a line: `status`, `dump` (the whole window, a digit a cell, row by row), `zone`,
 * `drive V W MS` (asks the robot to move). Each gives one line, `dump` one more for each row.
 * With MAPOD_LINK_AUTH its key is 00 01 .. 1f.
 */
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#include "text.h"

#define NONCE 0x11223344u /* of a test; a robot's firmware draws one at random */

static struct mapod_link receiver;
static struct mapod_talk talk;
static struct mapod_zone zone;
static uint8_t cells[MAPOD_CELL_BYTES(401, 401)];
static uint32_t accepted;

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
    text_end(" stack=", (int32_t)stack_used());
}

static void say_zone(void)
{
    board_say_number("zone state=", zone.state);
    board_say_number(" free_ahead=", zone.free_ahead_mm);
    text_end(" advice=", (int32_t)mapod_zone_advice(&zone, &receiver, board_now_ms()));
}

static void send(uint8_t *frame, uint32_t size)
{
    if (size > 0u) {
        board_write(UART_LINK, frame, mapod_talk_serial(frame, size));
    }
}

static void drive(void)
{
    uint8_t out[MAPOD_OUT_MAX];
    const int16_t v_mmps = (int16_t)text_number();
    const int16_t w_mradps = (int16_t)text_number();
    const uint32_t size = mapod_talk_drive(&talk, &receiver, board_now_ms(), v_mmps, w_mradps,
                                           (uint16_t)text_number(), out);
    send(out, size);
    text_end("drive ", (int32_t)size);
}

static void obey(void)
{
    if (text_word("status")) {
        say_status();
    } else if (text_word("dump")) {
        text_say_map(&receiver);
    } else if (text_word("zone")) {
        say_zone();
    } else if (text_word("drive")) {
        drive();
    } else {
        text_say("what?");
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
        if (text_hear()) {
            obey();
        }
    }
}
