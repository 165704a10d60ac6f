/* Clock, UARTs and the ring between interrupt and main loop of the emulated board.
 *
 * The interrupt only moves bytes into the ring; a full ring leaves them in the UART.
 * Source: CMSDK technical reference, UART; MPS2 application note 385, FPGA system control.
 */
#include "board.h"

#define CLOCK_HZ 25000000u
#ifndef BOARD_RING
#define BOARD_RING 1024u /* bytes, a power of two: what comes while the main loop thinks */
#endif
#define RING BOARD_RING

struct uart_registers {
    volatile uint32_t data;
    volatile uint32_t state; /* bit 0: transmitter full, bit 1: receiver full */
    volatile uint32_t control; /* bits: 0 transmit, 1 receive, 3 receive interrupt */
    volatile uint32_t interrupt;
    volatile uint32_t divisor;
};

#define FPGAIO ((volatile uint32_t *)0x40028000u) /* of the MPS2 board; words */
#define COUNTER 6u
#define PRESCALE 7u
#define INTERRUPTS_ON (*(volatile uint32_t *)0xE000E100u)

#define TX_FULL 1u
#define RX_FULL 2u
#define RX_INTERRUPT 2u
#define CONTROL_QUIET 3u /* transmit and receive */
#define CONTROL_HEARING 11u

static uint8_t ring[RING];
static volatile uint32_t written; /* by the interrupt alone */
static volatile uint32_t taken;   /* by the main loop alone */

static struct uart_registers *registers_of(enum uart uart)
{
    return (struct uart_registers *)(0x40004000u + (uint32_t)uart * 0x1000u);
}

void uart_heard(void)
{
    struct uart_registers *const uart = registers_of(UART_LINK);
    uart->interrupt = RX_INTERRUPT;
    while ((uart->state & RX_FULL) != 0u) {
        if (written - taken == RING) {
            uart->control = CONTROL_QUIET;
            return;
        }
        ring[written % RING] = (uint8_t)uart->data;
        written++;
    }
}

void board_start(void)
{
    registers_of(UART_LINK)->divisor = CLOCK_HZ / 115200u;
    registers_of(UART_TEXT)->divisor = CLOCK_HZ / 115200u;
    registers_of(UART_LINK)->control = CONTROL_HEARING;
    registers_of(UART_TEXT)->control = CONTROL_QUIET;
    INTERRUPTS_ON = 1u;
    FPGAIO[PRESCALE] = CLOCK_HZ / 1000u - 1u;
    FPGAIO[COUNTER] = 0u;
}

uint32_t board_now_ms(void)
{
    return FPGAIO[COUNTER]; /* no interrupt to be late for: an emulator that waits loses none */
}

bool board_read(uint8_t *byte)
{
    if (taken == written) {
        if (registers_of(UART_LINK)->control != CONTROL_HEARING) {
            registers_of(UART_LINK)->control = CONTROL_HEARING;
            __asm volatile("cpsid i");
            uart_heard(); /* what waits in the UART makes no new interrupt */
            __asm volatile("cpsie i");
        }
        return false;
    }
    *byte = ring[taken % RING];
    taken++;
    return true;
}

bool board_read_text(uint8_t *byte)
{
    struct uart_registers *const uart = registers_of(UART_TEXT);
    if ((uart->state & RX_FULL) == 0u) {
        return false;
    }
    *byte = (uint8_t)uart->data;
    return true;
}

void board_write(enum uart uart, const uint8_t *bytes, uint32_t count)
{
    struct uart_registers *const to = registers_of(uart);
    while (count > 0u) {
        while ((to->state & TX_FULL) != 0u) {
        }
        to->data = *bytes;
        bytes++;
        count--;
    }
}

void board_say(const char *text)
{
    while (*text != '\0') {
        board_write(UART_TEXT, (const uint8_t *)text, 1u);
        text++;
    }
}

void board_say_number(const char *name, int32_t number)
{
    char digits[12];
    uint32_t left = (number < 0) ? (0u - (uint32_t)number) : (uint32_t)number;
    uint32_t from = sizeof digits - 1u;
    digits[from] = '\0';
    do {
        from--;
        digits[from] = (char)('0' + (char)(left % 10u));
        left /= 10u;
    } while (left > 0u);
    board_say(name);
    board_say((number < 0) ? "-" : "");
    board_say(&digits[from]);
}
