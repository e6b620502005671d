/* Runs the published step over a recorded drive on a Cortex-M4 and counts instructions and bytes of stack.
 *
 * Made for QEMU (mps2-an386, -icount shift=0), where an instruction takes one nanosecond and SysTick counts every
 * fortieth. Reads drive.bin, frame after frame: the left and the right patch, the left and the right row. Writes an
 * `onboard_output` for each frame to outputs.bin and the map to map.bin, through semihosting. */
#include <stdio.h>
#include <string.h>

#include "onboard.h"

#define SYST_CSR (*(volatile uint32_t *)0xe000e010)
#define SYST_RVR (*(volatile uint32_t *)0xe000e014)
#define SYST_CVR (*(volatile uint32_t *)0xe000e018)
#define CPACR (*(volatile uint32_t *)0xe000ed88)
#define INSTRUCTIONS_A_TICK 40u /* 1 GHz of instructions, a clock of 25 MHz */
#define STACK_BYTES 8192u
#define PAINT 0xa5u

extern uint32_t stack_top;
extern void _start(void);
void reset(void);

void reset(void) {
    CPACR |= 0xfu << 20; /* floating point */
    __asm volatile("dsb\nisb");
    _start();
}

static void fault(void) {
    for (;;) __asm volatile("bkpt 0");
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
};

static onboard_state state;
static onboard_output output;
static uint8_t pixels[2][ONBOARD_PATCH_PIXELS], rows[2][ROW_COLUMNS];
static float cells[64 * 64];
static onboard_map map = {-1.0f, -1.6f, 64, 64, cells};

/* Instructions since the last call; a tick counts down. */
static uint32_t instructions(void) {
    static uint32_t before;
    uint32_t now = SYST_CVR, passed = (before - now) & 0xffffff;
    before = now;
    return passed * INSTRUCTIONS_A_TICK;
}

/* The stack below the caller: painted before a step, looked through after it. */
static uint8_t *stack_bottom(void) { return (uint8_t *)((uintptr_t)__builtin_frame_address(0) - STACK_BYTES); }

static void paint_stack(void) { memset(stack_bottom(), PAINT, STACK_BYTES - 64); }

static uint32_t stack_used(void) {
    const uint8_t *low = stack_bottom();
    uint32_t k = 0;
    while (k < STACK_BYTES && low[k] == PAINT) k++;
    return STACK_BYTES - k;
}

int main(void) {
    const onboard_view views[2] = {{pixels[0], PATCH_COLUMNS, rows[0]}, {pixels[1], PATCH_COLUMNS, rows[1]}};
    FILE *drive = fopen("drive.bin", "rb"), *out = fopen("outputs.bin", "wb");
    if (!drive || !out) return 2;
    uint32_t frames = 0, most = 0, most_map = 0, stack = 0;
    uint64_t total = 0, total_map = 0;
    SYST_RVR = 0xffffff;
    SYST_CVR = 0;
    SYST_CSR = 5;
    while (fread(pixels, sizeof pixels, 1, drive) == 1 && fread(rows, sizeof rows, 1, drive) == 1) {
        paint_stack();
        instructions();
        onboard_step(&state, views, &output);
        uint32_t step = instructions();
        onboard_map_add(&map, &output);
        uint32_t mapped = instructions(), used = stack_used();
        most = step > most ? step : most;
        most_map = mapped > most_map ? mapped : most_map;
        stack = used > stack ? used : stack;
        total += step, total_map += mapped, frames++;
        if (fwrite(&output, sizeof output, 1, out) != 1) return 2;
    }
    fclose(drive);
    fclose(out);
    FILE *file = fopen("map.bin", "wb");
    if (!file || !frames || fwrite(cells, sizeof cells, 1, file) != 1) return 2;
    fclose(file);
    printf("{\"frames\": %lu, \"step\": %lu, \"step_most\": %lu, \"map\": %lu, \"map_most\": %lu, \"stack\": %lu, "
           "\"state\": %u, \"input\": %u}\n",
           (unsigned long)frames, (unsigned long)(total / frames), (unsigned long)most,
           (unsigned long)(total_map / frames), (unsigned long)most_map, (unsigned long)stack,
           (unsigned)(sizeof state + sizeof output), (unsigned)(sizeof pixels + sizeof rows));
    return 0;
}
