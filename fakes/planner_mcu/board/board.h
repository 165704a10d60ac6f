/* The board that qemu-system-arm emulates as mps2-an385: clock and two UARTs.
 *
 * Source: Arm DAI 0385 (memory map, interrupts), CMSDK technical reference (UART).
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum uart { UART_LINK = 0, UART_TEXT = 1 };

void board_start(void);
uint32_t board_now_ms(void);
bool board_read(uint8_t *byte);      /* of the link, from the interrupt's ring; false: empty */
bool board_read_text(uint8_t *byte); /* of the text port, as it stands in the UART */
void board_write(enum uart uart, const uint8_t *bytes, uint32_t count);
void board_say(const char *text);    /* on the text port */
void board_say_number(const char *name, int32_t number); /* a name and a number, likewise */
uint32_t stack_used(void); /* bytes, the most since reset */

void uart_heard(void); /* interrupt */

#endif
