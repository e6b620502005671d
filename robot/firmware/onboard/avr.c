/* Avoidance alone on the ATmega328P of the car, whose 2 kB hold subfields of 16 x 12 pixels.
 *
 * An edge sweeps over the left or the right subfield at speeds by turns, drawn in the program; each step's speed in mm/s,
 * curvature in 1/km and mode are printed. On this computer the same program must print the same. */
#include <stdio.h>
#include <stdlib.h>

#include "../test/end.h"
#include "onboard.h"

#define STEPS 240

static onboard_state state;
static onboard_output output;
static uint8_t pixels[2][ONBOARD_PATCH_PIXELS];

/* Bars that are 8 columns wide, at a place in quarters of a pixel. */
static void draw(uint8_t *patch, uint16_t place) {
    for (uint8_t y = 0; y < PATCH_ROWS; y++)
        for (uint8_t x = 0; x < PATCH_COLUMNS; x++)
            *patch++ = (uint8_t)(((x * 4u + place) / 32u & 1u) ? 120 + 3 * y : 60 + 3 * y);
}

int main(void) {
    const onboard_view views[2] = {{pixels[0], PATCH_COLUMNS, 0}, {pixels[1], PATCH_COLUMNS, 0}};
    uint16_t places[2] = {0, 0}, most = 0;
    begin_output();
#ifdef __AVR__
    TCCR1B = _BV(CS11) | _BV(CS10); /* a count every 64 cycles */
#endif
    for (uint16_t n = 0; n < STEPS; n++) {
        bool turned = n / 60 & 1;
        places[turned] = (uint16_t)(places[turned] + 4);
        places[!turned] = (uint16_t)(places[!turned] + (n % 4 == 0));
        draw(pixels[0], places[0]);
        draw(pixels[1], places[1]);
#ifdef __AVR__
        TCNT1 = 0;
#endif
        onboard_step(&state, views, &output);
#ifdef __AVR__
        most = TCNT1 > most ? TCNT1 : most;
#endif
        printf("%d %d %d\n", (int)(output.speed * 1000), (int)(output.curvature * 1000), output.mode);
    }
    printf("%lu cycles, %u bytes\n", 64ul * most, (unsigned)(sizeof state + sizeof output + sizeof pixels));
    end(0);
    return 0;
}
