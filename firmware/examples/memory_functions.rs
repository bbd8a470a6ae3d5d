//! Copies and fills memory on the processor, in all alignments and overlaps, and compares each result with the expected
//! bytes.
//!
//! `tests/firmware-in-the-loop/run --test firmware memory_functions` observes which of the last two functions is
//! reached.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod image {
    use core::hint::black_box;
    use core::panic::PanicInfo;

    use cortex_m_rt::entry;
    // These functions are tested.
    use firmware as _;
    // The start-up code needs the interrupt table.
    use stm32_metapac as _;

    /// The number of start positions: all alignments to a double word, and overlaps forwards and backwards.
    const PLACES: usize = 12;
    /// The maximum length: two double words, a word, and one to three bytes.
    const LONGEST: usize = 23;
    const ROOM: usize = PLACES + LONGEST + 1;
    const FILLING: u8 = 0xA5;

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        wrong()
    }

    fn untouched(place: usize) -> u8 {
        place as u8
    }

    /// Returns whether `length` bytes at `to` are changed as expected, and all others untouched.
    fn is_right(bytes: &[u8], to: usize, length: usize, change: impl Fn(usize) -> u8) -> bool {
        let is_changed = |place: usize| (to..to + length).contains(&place);
        let expected = |place| if is_changed(place) { change(place - to) } else { untouched(place) };
        bytes.iter().enumerate().all(|(place, byte)| *byte == expected(place))
    }

    #[repr(align(8))]
    struct Room([u8; ROOM]);

    fn room() -> Room {
        Room(core::array::from_fn(untouched))
    }

    /// Returns whether a copy, an overlapping copy and two fills yield the expected bytes.
    fn all_are_right(from: usize, to: usize, length: usize) -> bool {
        let (source, mut target) = (room(), room());
        target.0[to..to + length].copy_from_slice(&source.0[from..from + length]);
        let mut moved = room();
        moved.0.copy_within(from..from + length, to);
        let mut filled = room();
        filled.0[to..to + length].fill(black_box(FILLING));
        let mut cleared = room();
        cleared.0[to..to + length].fill(0);
        is_right(&target.0, to, length, |place| untouched(from + place))
            && is_right(&moved.0, to, length, |place| untouched(from + place))
            && is_right(&filled.0, to, length, |_| FILLING)
            && is_right(&cleared.0, to, length, |_| 0)
    }

    #[entry]
    fn main() -> ! {
        for length in 0..=LONGEST {
            for (from, to) in (0..PLACES).flat_map(|from| (0..PLACES).map(move |to| (from, to))) {
                if !all_are_right(black_box(from), black_box(to), black_box(length)) {
                    wrong();
                }
            }
        }
        all_is_right()
    }

    #[inline(never)]
    #[unsafe(no_mangle)]
    fn all_is_right() -> ! {
        loop {
            cortex_m::asm::wfi();
        }
    }

    #[inline(never)]
    #[unsafe(no_mangle)]
    fn wrong() -> ! {
        loop {
            cortex_m::asm::nop();
        }
    }
}
