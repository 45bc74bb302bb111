/* Vector table and reset of a Cortex-M under QEMU: switch the floating-point unit on, then newlib's start. */
extern void _start(void);
extern unsigned __stack;

void reset(void);
void trap(void);

void reset(void)
{
  *(volatile unsigned *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to coprocessors 10 and 11 */
  __asm__ volatile("dsb\n\tisb");
  _start();
  for (;;)
    ;
}

void trap(void)
{
  for (;;)
    ;
}

struct vectors {
  unsigned *stack;
  void (*handlers[15])(void);
};

__attribute__((section(".vectors"), used)) static const struct vectors table = {
    &__stack,
    {reset, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap},
};
