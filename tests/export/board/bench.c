/* Calls one function CALLS times, or measures how deep it writes into the stack. Compiled with PREFIX, FUNCTION, CALLS. */
#include <stdio.h>

#include "kinematics.h"
#include "vectors.h"

#define JOIN2(a, b) a##_##b
#define JOIN(a, b) JOIN2(a, b)
#define NAME(x) JOIN(PREFIX, x)

enum { nothing, forward, jacobian, compensate };

static NAME(real) out[42], residual;

__attribute__((noinline)) static void call(int function, int k)
{
  const NAME(real) *q = vector_q[k % VECTORS];
  if (function == forward)
    NAME(forward)(q, out);
  else if (function == jacobian)
    NAME(jacobian)(q, out);
  else if (function == compensate)
    (void)NAME(compensate)(q, out, &residual);
}

#define DEPTH 16384

/* Bytes below the caller's stack pointer that a call leaves changed. */
__attribute__((noinline)) static unsigned long depth(int function)
{
  volatile unsigned char *sp, *p;
  unsigned long deepest = 0;
  int k;
  __asm__ volatile("mov %0, sp" : "=r"(sp));
  for (k = 0; k < VECTORS; ++k) {
    for (p = sp - DEPTH; p < sp; ++p)
      *p = 0xA5;
    call(function, k);
    for (p = sp - DEPTH; *p == 0xA5 && p < sp; ++p)
      ;
    if ((unsigned long)(sp - p) > deepest)
      deepest = (unsigned long)(sp - p);
  }
  return deepest;
}

int main(void)
{
  volatile int calls = CALLS;
  int k;
  if (calls < 0) {
    printf("stack %lu\n", depth(FUNCTION));
    return 0;
  }
  for (k = 0; k < calls; ++k)
    call(FUNCTION, k);
  return 0;
}
