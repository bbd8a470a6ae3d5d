/* Preloaded into user-mode Linux on x86-64: lets it run on processors with more register state than it knows.
 *
 * Linux 6.1 as user-mode Linux keeps 832 bytes of extended state, which is x87, SSE and AVX. The host takes the state of a
 * processor as a whole only: on one with AVX-512 or AMX it refuses those bytes with EFAULT, and the guest's first process
 * ends in a panic. So a write of part of the state becomes a write of all of it, with the rest as it is.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

/* Where the state has the bits that tell which of its parts are there. */
#define HEADER 512
/* The bits of x87, SSE and AVX. */
#define KNOWN UINT64_C(7)
/* More than any processor has: AMX alone takes 8 KiB. */
#define STATE_MAX 65536

long ptrace(enum __ptrace_request request, ...) {
  va_list arguments;
  va_start(arguments, request);
  pid_t pid = va_arg(arguments, pid_t);
  void *address = va_arg(arguments, void *);
  void *data = va_arg(arguments, void *);
  va_end(arguments);

  long (*real)(enum __ptrace_request, ...) = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
  long result = real(request, pid, address, data);
  if (result == 0 || errno != EFAULT || request != PTRACE_SETREGSET || (uintptr_t)address != NT_X86_XSTATE)
    return result;

  static _Alignas(64) unsigned char state[STATE_MAX];
  struct iovec whole = {state, sizeof state}, *part = data;
  if (real(PTRACE_GETREGSET, pid, address, &whole) != 0 || whole.iov_len < part->iov_len ||
      part->iov_len < HEADER + sizeof(uint64_t)) {
    errno = EFAULT;
    return -1;
  }
  uint64_t other, known;
  memcpy(&other, state + HEADER, sizeof other);
  memcpy(state, part->iov_base, part->iov_len);
  memcpy(&known, state + HEADER, sizeof known);
  known = (known & KNOWN) | (other & ~KNOWN);
  memcpy(state + HEADER, &known, sizeof known);
  return real(PTRACE_SETREGSET, pid, address, &whole);
}
