/* stm32h743: board.h and can.h on an STM32H743 at 480 MHz with a 25 MHz crystal, by its registers. FDCAN1 on PD0 and PD1 (AF9), the
 * operator's switch from PC13 to 3.3 V. Sources: ST RM0433 rev 8 (PWR 6, RCC 8, GPIO 11, FLASH 4, IWDG 46), Arm DDI0403 (SysTick,
 * caches, DWT). Compile-checked and emulated as far as QEMU has the parts; never run on a board. */
#include "board.h"
#include "can.h"
#include "fdcan.h"

#define CORE_HZ 480000000u
#define FDCAN_HZ 80000000u
#define SLOT_CYCLES (CORE_HZ / 1000000u * (BOARD_SLOT_NS / 1000u))
/* Clocks and supplies settle within microseconds to a few ms; this many reads take longer. */
#define PATIENCE 2000000u

#define REG(address) (*(volatile uint32_t *)(address))
#define PWR_CSR1 REG(0x58024804u)
#define PWR_CR3 REG(0x5802480Cu)
#define PWR_D3CR REG(0x58024818u)
#define SYSCFG_PWRCR REG(0x5800042Cu)
#define FLASH_ACR REG(0x52002000u)
#define RCC_CR REG(0x58024400u)
#define RCC_CFGR REG(0x58024410u)
#define RCC_D1CFGR REG(0x58024418u)
#define RCC_D2CFGR REG(0x5802441Cu)
#define RCC_D3CFGR REG(0x58024420u)
#define RCC_PLLCKSELR REG(0x58024428u)
#define RCC_PLLCFGR REG(0x5802442Cu)
#define RCC_PLL1DIVR REG(0x58024430u)
#define RCC_D2CCIP1R REG(0x58024450u)
#define RCC_AHB4ENR REG(0x580244E0u)
#define RCC_APB1HENR REG(0x580244ECu)
#define RCC_APB4ENR REG(0x580244F4u)
#define GPIOC_MODER REG(0x58020800u)
#define GPIOC_PUPDR REG(0x5802080Cu)
#define GPIOC_IDR REG(0x58020810u)
#define GPIOD_MODER REG(0x58020C00u)
#define GPIOD_OSPEEDR REG(0x58020C08u)
#define GPIOD_AFRL REG(0x58020C20u)
#define IWDG_KR REG(0x58004800u)
#define IWDG_PR REG(0x58004804u)
#define IWDG_RLR REG(0x58004808u)
#define SYSTICK_CTRL REG(0xE000E010u)
#define SYSTICK_LOAD REG(0xE000E014u)
#define SYSTICK_NOW REG(0xE000E018u)
#define SCB_CCR REG(0xE000ED14u)
#define SCB_CCSIDR REG(0xE000ED80u)
#define SCB_CSSELR REG(0xE000ED84u)
#define SCB_ICIALLU REG(0xE000EF50u)
#define SCB_DCISW REG(0xE000EF60u)
#define DEMCR REG(0xE000EDFCu)
#define DWT_CTRL REG(0xE0001000u)
#define DWT_CYCCNT REG(0xE0001004u)
#define DWT_LAR REG(0xE0001FB0u)

static fdcan bus = {(volatile uint32_t *)0x4000A000u, (volatile uint32_t *)0x4000AC00u, 0u};
static uint32_t cycles_before, cycles_over;
static uint64_t whole_ns;

static int wait_bits(volatile uint32_t *at, uint32_t mask, uint32_t wanted) {
    for (uint32_t i = 0; i < PATIENCE; i++) {
        if ((*at & mask) == wanted) {
            return 0;
        }
    }
    return -1;
}

/* The voltage that 480 MHz needs: LDO, scale 1, then overdrive. */
static int raise_voltage(void) {
    PWR_CR3 = (PWR_CR3 & ~7u) | 1u << 1;
    int wrong = wait_bits(&PWR_CSR1, 1u << 13, 1u << 13);
    PWR_D3CR = 3u << 14;
    wrong |= wait_bits(&PWR_D3CR, 1u << 13, 1u << 13);
    RCC_APB4ENR |= 1u << 1;
    SYSCFG_PWRCR |= 1u;
    return wrong | wait_bits(&PWR_D3CR, 1u << 13, 1u << 13);
}

/* 25 MHz / 5 x 192 = 960 MHz; core 480, buses 240 and 120, FDCAN 960 / 12 = 80. */
static int start_clocks(void) {
    RCC_CR |= 1u << 16;
    int wrong = wait_bits(&RCC_CR, 1u << 17, 1u << 17);
    RCC_PLLCKSELR = 5u << 4 | 2u;
    RCC_PLLCFGR = 1u << 17 | 1u << 16 | 2u << 2; /* P and Q out; input 4 to 8 MHz, wide oscillator */
    RCC_PLL1DIVR = (12u - 1u) << 16 | (2u - 1u) << 9 | (192u - 1u);
    RCC_CR |= 1u << 24;
    wrong |= wait_bits(&RCC_CR, 1u << 25, 1u << 25);
    FLASH_ACR = 2u << 4 | 4u; /* 240 MHz at the highest voltage: 4 wait states */
    wrong |= wait_bits(&FLASH_ACR, 0xfu, 4u);
    RCC_D1CFGR = 4u << 4 | 8u;
    RCC_D2CFGR = 4u << 8 | 4u << 4;
    RCC_D3CFGR = 4u << 4;
    RCC_CFGR = 3u;
    return wrong | wait_bits(&RCC_CFGR, 7u << 3, 3u << 3);
}

static void start_caches(void) {
    SCB_ICIALLU = 0u;
    SCB_CSSELR = 0u;
    __asm volatile("dsb\n isb" ::: "memory");
    const uint32_t sets = SCB_CCSIDR >> 13 & 0x7fffu, ways = SCB_CCSIDR >> 3 & 0x3ffu;
    for (uint32_t set = 0; set <= sets; set++) {
        for (uint32_t way = 0; way <= ways; way++) {
            SCB_DCISW = way << 30 | set << 5;
        }
    }
    __asm volatile("dsb" ::: "memory");
    SCB_CCR |= 1u << 17 | 1u << 16;
    __asm volatile("dsb\n isb" ::: "memory");
}

static void start_pins(void) {
    RCC_AHB4ENR |= 1u << 3 | 1u << 2;
    (void)RCC_AHB4ENR; /* the clock is there after this read */
    GPIOD_AFRL = (GPIOD_AFRL & ~0xffu) | 0x99u;
    GPIOD_OSPEEDR |= 0xfu;
    GPIOD_MODER = (GPIOD_MODER & ~0xfu) | 0xau;
    GPIOC_MODER &= ~(3u << 26);
    GPIOC_PUPDR = (GPIOC_PUPDR & ~(3u << 26)) | 2u << 26; /* a broken wire reads off */
}

int board_start(void) {
    start_caches();
    if (raise_voltage() != 0 || start_clocks() != 0) {
        return -1;
    }
    start_pins();
    DEMCR |= 1u << 24;
    DWT_LAR = 0xC5ACCE55u;
    DWT_CYCCNT = 0u;
    DWT_CTRL |= 1u;
    IWDG_KR = 0xCCCCu; /* 32 kHz / 4: 80 counts are 10 ms. Ten periods without a tick, and the processor starts anew. */
    IWDG_KR = 0x5555u;
    IWDG_PR = 0u;
    IWDG_RLR = 80u;
    return 0;
}

void board_begin(void) {
    SYSTICK_LOAD = SLOT_CYCLES - 1u;
    SYSTICK_NOW = 0u;
    SYSTICK_CTRL = 7u;
}

cr_servo_config board_settings(void) {
    cr_servo_config config = cr_servo_config_default();
    config.late_max_ticks = BOARD_LATE_MAX_TICKS;
    return config;
}

/* No wfi: in sleep the cycle counter, which is the time of the period, stands still where no debugger keeps its clock on. */
void board_sleep(const volatile uint32_t *slots, uint32_t seen) {
    while (*slots == seen) {
        /* the interrupt ends this */
    }
}

uint64_t board_now_ns(void) {
    const uint32_t now = DWT_CYCCNT, passed = now - cycles_before + cycles_over;
    cycles_before = now;
    cycles_over = passed % 12u; /* 12 cycles are 25 ns */
    whole_ns += (uint64_t)(passed / 12u) * 25u;
    return whole_ns + cycles_over * 25u / 12u;
}

uint32_t board_commands(uint32_t mode) {
    static uint32_t was_on = 1u; /* on at power-up is no start: it has to go off first */
    const uint32_t on = GPIOC_IDR >> 13 & 1u, went_on = on & ~was_on;
    was_on = on;
    if (!on) {
        return CR_COMMAND_STOP;
    }
    return !went_on ? 0u : mode == CR_MODE_FAULT ? CR_COMMAND_CLEAR : CR_COMMAND_START;
}

/* Nobody keeps them here: the ring of record.c would do, which the main loop could empty. */
void board_keep(const cr_record *record) {
    (void)record;
    IWDG_KR = 0xAAAAu;
}

_Noreturn void board_stop(uint32_t why) {
    (void)why;
    __asm volatile("cpsid i" ::: "memory");
    can_stop();
    for (;;) {
        /* The watchdog ends this: the controller starts anew and waits for the switch to go off and on. */
    }
}

int can_start(void) {
    RCC_D2CCIP1R = (RCC_D2CCIP1R & ~(3u << 28)) | 1u << 28; /* clock from PLL1 Q */
    RCC_APB1HENR |= 1u << 8;
    (void)RCC_APB1HENR;
    return fdcan_start(&bus, FDCAN_HZ, CAN_BITRATE);
}

int can_send(const cr_frame *frame) { return fdcan_send(&bus, frame); }
int can_receive(cr_frame *frame) { return fdcan_receive(&bus, frame); }
int can_was_off(void) { return fdcan_was_off(&bus); }
uint32_t can_lost(void) { return bus.lost; }
void can_stop(void) { fdcan_stop(&bus); }
