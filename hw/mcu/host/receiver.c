/* The header as a program: a receiver of the planner link on a host, for `mapod link-test`.
 *
 *   receiver stdio            frames on standard input and output, as on a serial line
 *   receiver tcp PORT         one client after the other, as on a serial line
 *   receiver udp PORT         a frame a datagram; answers go to whoever sent last
 *   ... KEYFILE               with tags: 32 bytes, or 64 hex digits
 * Listens on the machine itself only. PORT 0: any; the first line on standard error tells which.
 * It ends when its input ends (stdio), else never.
 * Exit status 2: wrong arguments, or the port is not to be had.
 */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define MAPOD_LINK_AUTH
#ifndef MAPOD_LINK_LEFT_SESSIONS
#define MAPOD_LINK_LEFT_SESSIONS 4096u /* an exam is full of new runs */
#endif
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#define MOST_CELLS (401u * 401u)
#define POLL_US 5000

static struct mapod_link receiver;
static struct mapod_talk talk;
static struct mapod_zone zone;
static uint8_t cells[MAPOD_CELL_BYTES(401, 401)];
static uint8_t key[32];

static uint32_t now_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000u + (uint64_t)now.tv_nsec / 1000000u);
}

static void note(int outcome)
{
    if (outcome == MAPOD_DIGEST) {
        (void)mapod_link_check_digest(&receiver);
    } else if (outcome == MAPOD_STOP_ZONE) {
        (void)mapod_zone_from(&receiver, &zone);
    }
}

static bool read_key(const char *path)
{
    uint8_t text[66] = {0};
    FILE *const file = fopen(path, "rb");
    size_t size, i;
    if (file == NULL) {
        return false;
    }
    size = fread(text, 1, sizeof text, file);
    (void)fclose(file);
    if (size == sizeof key) {
        memcpy(key, text, sizeof key);
        return true;
    }
    for (i = 0; i < sizeof key; i++) {
        char digits[3] = {(char)text[2 * i], (char)text[2 * i + 1], 0};
        char *end = digits;
        key[i] = (uint8_t)strtoul(digits, &end, 16);
        if (end != digits + 2) {
            return false;
        }
    }
    return true;
}

/* A socket bound to this machine; tells its port. Below 0: it is not to be had. */
static int open_socket(int type, uint16_t port)
{
    struct sockaddr_in at = {0};
    socklen_t size = sizeof at;
    const int on = 1;
    const int fd = socket(AF_INET, type, 0);
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    at.sin_port = htons(port);
    (void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (fd < 0 || bind(fd, (struct sockaddr *)&at, sizeof at) != 0 ||
        (type == SOCK_STREAM && listen(fd, 1) != 0)) {
        return -1;
    }
    (void)getsockname(fd, (struct sockaddr *)&at, &size);
    (void)fprintf(stderr, "port %u\n", ntohs(at.sin_port));
    return fd;
}

/* True if there is something to read within a few milliseconds. */
static bool waits(int fd)
{
    struct timeval time = {0, POLL_US};
    fd_set set;
    FD_ZERO(&set);
    FD_SET(fd, &set);
    return select(fd + 1, &set, NULL, NULL, &time) > 0;
}

/* A serial line on two descriptors, until the other end closes it. */
static void serve_line(int in, int out)
{
    uint8_t bytes[4096];
    uint8_t frame[MAPOD_OUT_MAX];
    for (;;) {
        uint32_t size;
        if (waits(in)) {
            const ssize_t count = read(in, bytes, sizeof bytes);
            ssize_t i;
            if (count <= 0) {
                return;
            }
            for (i = 0; i < count; i++) {
                note(mapod_link_byte(&receiver, now_ms(), bytes[i]));
            }
        }
        size = mapod_talk_poll(&talk, &receiver, now_ms(), frame);
        if (size > 0u) {
            size = mapod_talk_serial(frame, size);
            if (write(out, frame, size) != (ssize_t)size) {
                return;
            }
        }
    }
}

static void serve_datagrams(int fd)
{
    uint8_t datagram[2048];
    uint8_t frame[MAPOD_OUT_MAX];
    struct sockaddr_in from = {0};
    for (;;) {
        uint32_t size;
        while (waits(fd)) {
            socklen_t length = sizeof from;
            const ssize_t count =
                recvfrom(fd, datagram, sizeof datagram, 0, (struct sockaddr *)&from, &length);
            if (count >= 0) {
                note(mapod_link_datagram(&receiver, now_ms(), datagram, (uint32_t)count));
            }
            size = mapod_talk_poll(&talk, &receiver, now_ms(), frame);
            if (size > 0u) {
                (void)sendto(fd, frame, size, 0, (struct sockaddr *)&from, sizeof from);
            }
        }
        size = mapod_talk_poll(&talk, &receiver, now_ms(), frame);
        if (size > 0u && from.sin_port != 0) {
            (void)sendto(fd, frame, size, 0, (struct sockaddr *)&from, sizeof from);
        }
    }
}

int main(int count, char **words)
{
    const char *const way = count > 1 ? words[1] : "";
    const bool stdio = strcmp(way, "stdio") == 0;
    const bool udp = strcmp(way, "udp") == 0;
    const int key_at = stdio ? 2 : 3;
    const uint32_t nonce = (uint32_t)getpid() * 2654435761u ^ now_ms() ^ 1u;
    int fd;
    if (!(stdio || udp || strcmp(way, "tcp") == 0) || count < key_at || count > key_at + 1) {
        (void)fprintf(stderr, "use: receiver stdio | tcp PORT | udp PORT [KEYFILE]\n");
        return 2;
    }
    mapod_link_init(&receiver, cells, MOST_CELLS);
    mapod_talk_init(&talk, nonce, false);
    if (count > key_at) {
        if (!read_key(words[key_at])) {
            (void)fprintf(stderr, "%s: no key of 32 bytes or 64 hex digits\n", words[key_at]);
            return 2;
        }
        mapod_link_set_key(&receiver, key, nonce);
    }
    if (stdio) {
        serve_line(STDIN_FILENO, STDOUT_FILENO);
        return 0;
    }
    fd = open_socket(udp ? SOCK_DGRAM : SOCK_STREAM, (uint16_t)strtoul(words[2], NULL, 10));
    if (fd < 0) {
        perror(words[2]);
        return 2;
    }
    while (!udp) {
        const int client = accept(fd, NULL, NULL);
        if (client >= 0) {
            serve_line(client, client);
            (void)close(client);
        }
    }
    serve_datagrams(fd);
    return 0;
}
