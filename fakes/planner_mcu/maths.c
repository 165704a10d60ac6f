/* A table of sines; vectors are rotated for their direction; a root is found bit by bit.
 *
 * Source: J. E. Volder, The CORDIC trigonometric computing technique, 1959, for `direction`.
 */
#include "maths.h"

#define QUARTER 16384u
#define TABLE_STEP 256u /* between two entries */
#define ROTATIONS 14

static const uint16_t table[65] = { /* sine of k * 90 / 64 degrees, in 1/32 768 */
    0u, 804u, 1608u, 2411u, 3212u, 4011u, 4808u, 5602u, 6393u, 7180u,
    7962u, 8740u, 9512u, 10279u, 11039u, 11793u, 12540u, 13279u, 14010u, 14733u,
    15447u, 16151u, 16846u, 17531u, 18205u, 18868u, 19520u, 20160u, 20788u, 21403u,
    22006u, 22595u, 23170u, 23732u, 24279u, 24812u, 25330u, 25833u, 26320u, 26791u,
    27246u, 27684u, 28106u, 28511u, 28899u, 29269u, 29622u, 29957u, 30274u, 30572u,
    30853u, 31114u, 31357u, 31581u, 31786u, 31972u, 32138u, 32286u, 32413u, 32522u,
    32610u, 32679u, 32729u, 32758u, 32768u,
};

static const uint16_t steps[ROTATIONS] = { /* arc tangent of 2^-k */
    8192u, 4836u, 2555u, 1297u, 651u, 326u, 163u, 81u, 41u, 20u,
    10u, 5u, 3u, 1u,
};

int32_t sine(binary_angle angle)
{
    const uint32_t within = angle % QUARTER;
    const uint32_t quarter = angle / QUARTER;
    const uint32_t up = ((quarter & 1u) != 0u) ? (QUARTER - within) : within;
    const uint32_t at = up / TABLE_STEP;
    const uint32_t rest = up % TABLE_STEP;
    uint32_t value = table[at];
    if (rest > 0u) {
        value += (((uint32_t)table[at + 1u] - table[at]) * rest) / TABLE_STEP;
    }
    return (quarter >= 2u) ? -(int32_t)value : (int32_t)value;
}

int32_t cosine(binary_angle angle)
{
    return sine((binary_angle)(angle + QUARTER));
}

binary_angle direction(int32_t x, int32_t y)
{
    uint32_t angle = 0u;
    uint32_t k;
    while ((magnitude(x) > 200000000) || (magnitude(y) > 200000000)) {
        x /= 2;
        y /= 2;
    }
    if ((x == 0) && (y == 0)) {
        return 0u;
    }
    while ((magnitude(x) < 50000000) && (magnitude(y) < 50000000)) {
        x *= 2;
        y *= 2;
    }
    if (x < 0) {
        x = -x;
        y = -y;
        angle = 2u * QUARTER;
    }
    for (k = 0u; k < ROTATIONS; k++) {
        const int32_t by = (int32_t)1 << k;
        const int32_t dx = x / by;
        const int32_t dy = y / by;
        if (y > 0) {
            x += dy;
            y -= dx;
            angle += steps[k];
        } else {
            x -= dy;
            y += dx;
            angle -= steps[k];
        }
    }
    return (binary_angle)angle;
}

binary_angle bearing(struct point from, struct point to)
{
    return direction(to.x_mm - from.x_mm, to.y_mm - from.y_mm);
}

int32_t difference(binary_angle angle, binary_angle from)
{
    const uint32_t apart = (uint32_t)(binary_angle)(angle - from);
    return (apart >= 32768u) ? ((int32_t)apart - 65536) : (int32_t)apart;
}

int32_t root(int32_t square)
{
    uint32_t rest = (square > 0) ? (uint32_t)square : 0u;
    uint32_t bit = 1u << 30;
    uint32_t result = 0u;
    while (bit != 0u) {
        if (rest >= (result + bit)) {
            rest -= result + bit;
            result = (result >> 1) + bit;
        } else {
            result >>= 1;
        }
        bit >>= 2;
    }
    return (int32_t)result;
}

int32_t distance_mm(int32_t dx_mm, int32_t dy_mm)
{
    int32_t dx = magnitude(dx_mm);
    int32_t dy = magnitude(dy_mm);
    int32_t scale = 1;
    while ((dx > 32000) || (dy > 32000)) {
        dx /= 2;
        dy /= 2;
        scale *= 2;
    }
    return root((dx * dx) + (dy * dy)) * scale;
}

int32_t apart_mm(struct point a, struct point b)
{
    return distance_mm(a.x_mm - b.x_mm, a.y_mm - b.y_mm);
}

struct point between(struct point from, struct point to, int32_t part, int32_t of)
{
    from.x_mm += ((to.x_mm - from.x_mm) * part) / of;
    from.y_mm += ((to.y_mm - from.y_mm) * part) / of;
    return from;
}

binary_angle angle_from_link(int16_t angle)
{
    return (binary_angle)(((int32_t)angle * 10430) / 10000); /* 65 536 / (2 pi * 10 000) */
}

int32_t magnitude(int32_t number)
{
    return (number < 0) ? -number : number;
}

int32_t least(int32_t a, int32_t b)
{
    return (a < b) ? a : b;
}

int32_t most(int32_t a, int32_t b)
{
    return (a > b) ? a : b;
}

int32_t floor_div(int32_t number, int32_t by)
{
    return (number >= 0) ? (number / by) : -((by - 1 - number) / by);
}
