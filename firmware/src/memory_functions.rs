//! The functions that the compiler calls to copy, move and fill memory, in 160 bytes of flash.
//!
//! The functions of the compiler are optimised for long copies on every processor, and take 3.6 KiB. They are weak
//! symbols, which these functions replace. Most copies here are of frames: these functions save 50 instructions on an
//! SDO upload, from interrupt to sleep. The processor reads and writes words at any address of its memory (ARMv7-M,
//! A3.2.1).
//!
//! The functions conform to the run-time ABI of ARM (RTABI 4.3.4): they return nothing and change only r0–r3 and r12.

core::arch::global_asm!(
    "
    .macro function name
        .global \\name
        .type \\name, %function
        .thumb_func
        \\name:
    .endm

    @ r0: to, r1: from, r2: length; the two may overlap.
    .section .text.__aeabi_memmove, \"ax\", %progbits
    function __aeabi_memmove
    function __aeabi_memmove4
    function __aeabi_memmove8
        sub     r3, r0, r1
        cmp     r3, r2
        bhs     __aeabi_memcpy
        @ The target overlaps the end of the source: copy backwards.
        add     r1, r2
        add     r0, r2
        b       2f
    1:  ldr     r3, [r1, #-4]!
        str     r3, [r0, #-4]!
    2:  subs    r2, #4
        bhs     1b
        adds    r2, #4
        b       4f
    3:  ldrb    r3, [r1, #-1]!
        strb    r3, [r0, #-1]!
    4:  subs    r2, #1
        bhs     3b
        bx      lr

    @ r0: to, r1: from, r2: length; forwards.
    .section .text.__aeabi_memcpy, \"ax\", %progbits
    function __aeabi_memcpy
    function __aeabi_memcpy4
    function __aeabi_memcpy8
        b       2f
    1:  ldr     r3, [r1], #4
        str     r3, [r0], #4
        ldr     r3, [r1], #4
        str     r3, [r0], #4
    2:  subs    r2, #8
        bhs     1b
        @ The last three bits of the length are left.
        lsls    r2, #30
        itt     cs
        ldrcs   r3, [r1], #4
        strcs   r3, [r0], #4
        lsls    r2, #1
        itt     cs
        ldrhcs  r3, [r1], #2
        strhcs  r3, [r0], #2
        itt     mi
        ldrbmi  r3, [r1]
        strbmi  r3, [r0]
        bx      lr

    @ r0: to, r1: length, r2: the byte.
    .section .text.__aeabi_memset, \"ax\", %progbits
    function __aeabi_memclr
    function __aeabi_memclr4
    function __aeabi_memclr8
        movs    r2, #0
    function __aeabi_memset
    function __aeabi_memset4
    function __aeabi_memset8
        uxtb    r2, r2
        orr     r2, r2, r2, lsl #8
        orr     r2, r2, r2, lsl #16
        b       2f
    1:  str     r2, [r0], #4
    2:  subs    r1, #4
        bhs     1b
        adds    r1, #4
        b       4f
    3:  strb    r2, [r0], #1
    4:  subs    r1, #1
        bhs     3b
        bx      lr

    .purgem function
    "
);
