#include "drive_choices.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

uint8_t take_byte(bytes_t *bytes) {
    if (!bytes->left) return 0;
    bytes->left--;
    return *bytes->at++;
}

uint32_t take_number(bytes_t *bytes, uint32_t below) {
    uint32_t number = 0;
    for (int i = 0; i < 4; i++) number = number << 8 | take_byte(bytes);
    return below ? number % below : 0;
}

double take_value(bytes_t *bytes) {
    static const double ODD[] = {0.0,    -0.0,   1.0,    -1.0, 0.5,      2.0,      3.0,
                                 1e-300, 1e-9,   1e3,    -1e3, 1e9,      -1e9,     1e16,
                                 1e300,  -1e300, 5e-324, NAN,  INFINITY, -INFINITY};
    const uint8_t choice = take_byte(bytes);
    uint64_t bits = 0;
    double value;
    if (choice < 128) return (choice - 64) / 64.0;
    if (choice < 192) return ODD[choice % (sizeof ODD / sizeof *ODD)];
    if (choice < 240) return (choice - 216) * 10.0 + take_byte(bytes) / 256.0;
    for (int i = 0; i < 8; i++) bits = bits << 8 | take_byte(bytes);
    memcpy(&value, &bits, sizeof value);
    return value;
}

void promise(int holds, const char *words) {
    if (holds) return;
    fprintf(stderr, "broken promise: %s\n", words);
    abort();
}

double *room(size_t n) {
    double *memory = malloc(n ? n * sizeof(double) : 1);
    if (!memory) exit(0);
    return memory;
}
