/* What stands before main on the emulated board: vectors, memory, the two functions of a library.
 *
 * Paints the stack, so that `stack_used` can tell how deep it ever was.
 * Source: Armv7-M reference manual, B1.5 (vectors, reset); linker script board.ld.
 */
#include "board.h"

extern uint32_t data_load, data_start, data_end, bss_start, bss_end, stack_low, stack_top;

int main(void);
void reset(void);
void hang(void);

#define PAINT 0x5AA5C33Cu

void *memset(void *to, int value, size_t count)
{
    uint8_t *at = to;
    while (count > 0u) {
        *at = (uint8_t)value;
        at++;
        count--;
    }
    return to;
}

void *memcpy(void *to, const void *from, size_t count)
{
    uint8_t *at = to;
    const uint8_t *source = from;
    while (count > 0u) {
        *at = *source;
        at++;
        source++;
        count--;
    }
    return to;
}

void reset(void)
{
    const uint32_t *from = &data_load;
    uint32_t *to;
    for (to = &data_start; to < &data_end; to++) {
        *to = *from;
        from++;
    }
    for (to = &bss_start; to < &bss_end; to++) {
        *to = 0u;
    }
    for (to = &stack_low; to < (uint32_t *)__builtin_frame_address(0) - 16; to++) {
        *to = PAINT;
    }
    (void)main();
    hang();
}

void hang(void)
{
    for (;;) {
    }
}

uint32_t stack_used(void)
{
    const uint32_t *at = &stack_low;
    while (at < &stack_top && *at == PAINT) {
        at++;
    }
    return (uint32_t)(&stack_top - at) * 4u;
}

typedef void (*handler)(void);

const union {
    handler code;
    const uint32_t *stack;
} vectors[] __attribute__((section(".vectors"), used)) = {
    {.stack = &stack_top}, {reset}, {hang}, {hang}, {hang}, {hang}, {hang}, {hang},
    {hang},                {hang},  {hang}, {hang}, {hang}, {hang}, {hang}, {hang},
    {uart_heard}, /* interrupt 0: UART0 has received */
};
