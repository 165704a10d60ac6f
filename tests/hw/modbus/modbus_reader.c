/* Reads the register image with libmodbus: tcp PORT or rtu PATH BAUD, then UNIT.
 * Prints the status registers, the coarse map, and one window read in pieces. */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int fail(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, modbus_strerror(errno));
    return 1;
}

static void print(const uint16_t *registers, int count)
{
    int k;

    for (k = 0; k < count; k++)
        printf("%u ", registers[k]);
    printf("\n");
}

int main(int argc, char **argv)
{
    static uint16_t registers[65536];
    int is_tcp = argc > 2 && strcmp(argv[1], "tcp") == 0;
    int first, size, count;
    modbus_t *bus = is_tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2]))
                           : modbus_new_rtu(argv[2], atoi(argv[3]), 'N', 8, 1);

    modbus_set_slave(bus, atoi(argv[argc - 1]));
    modbus_set_response_timeout(bus, 60, 0);
    modbus_set_byte_timeout(bus, 60, 0);
    if (modbus_connect(bus) < 0)
        return fail("connect");
    if (modbus_read_registers(bus, 0, 80, registers) != 80)
        return fail("status");
    print(registers, 80);
    if (modbus_read_input_registers(bus, 100, 71, registers) != 71)
        return fail("coarse");
    print(registers, 71);
    if (modbus_read_registers(bus, 1000, 10, registers) != 10)
        return fail("head");
    count = 10 + registers[7] * registers[8] + 1;
    for (first = 10; first < count; first += size) {
        size = count - first < 125 ? count - first : 125;
        if (modbus_read_registers(bus, 1000 + first, size, registers + first) != size)
            return fail("window");
    }
    print(registers, count);
    if (modbus_write_register(bus, 1, 3) != -1 || errno != EMBXILADD)
        return fail("write");
    if (modbus_read_registers(bus, 60000, 1, registers) != -1 || errno != EMBXILADD)
        return fail("address");
    modbus_close(bus);
    modbus_free(bus);
    return 0;
}
