/* Runs a test on a simulated board, prints what its serial port sends, and ends as it does.
 *
 *     on_board TEST.elf [FILE [MCU]]
 *
 * FILE takes what the board sent, and nothing of what the simulator says. MCU is atmega1284p, which has more memory than
 * ours, or another that simavr knows. */
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>
#include <stdio.h>
#include <string.h>

#define GPIOR0 0x3e /* in memory: its address 0x1e in the space of registers, and 0x20 */
#define LONGEST 4000000000u /* cycles: 250 s of the board */

static FILE *sent;

static void print(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    putchar((int)value);
    if (sent) putc((int)value, sent);
}

int main(int argc, char **argv) {
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    if (argc < 2 || argc > 4 || elf_read_firmware(argv[1], &firmware) != 0) return 2;
    if (argc >= 3 && !(sent = fopen(argv[2], "w"))) return perror(argv[2]), 2;
    avr_t *avr = avr_make_mcu_by_name(argc == 4 ? argv[3] : "atmega1284p");
    if (!avr || avr_init(avr) != 0) return 2;
    avr->frequency = 16000000;
    avr_load_firmware(avr, &firmware);
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)AVR_UART_FLAG_STDIO;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), print, NULL);
    int state = cpu_Running;
    while (state != cpu_Done && state != cpu_Crashed && avr->cycle < LONGEST && !avr->data[GPIOR0]) state = avr_run(avr);
    if (sent && fclose(sent)) return perror(argv[2]), 2;
    return avr->data[GPIOR0] == 2 ? 0 : 1;
}
