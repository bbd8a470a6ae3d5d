//! Where the images lie (`memory.x`): one file lays out all of them, and the linker takes it for every board.

use firmware_in_the_loop::board::{NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::machine::Machine;
use firmware_in_the_loop::part::Connections;

/// Where the processor finds its vectors.
const VECTORS: u64 = 0x0800_0000;
/// The length of the vector table: the core's 16 vectors, then one for each interrupt up to the last of the part (RM0090
/// table 63, RM0390 table 38).
const VECTORS_F429: u64 = 4 * (16 + 91);

#[track_caller]
fn check(image: &'static Image, code: u64, flash_end: u64, ram_end: u64) {
    let address = |name| image.symbols().address(name).unwrap_or_else(|| panic!("{name} is missing"));
    assert_eq!(address("__vector_table"), VECTORS);
    assert_eq!(address("_stext"), code, "the beginning of the code");
    assert_eq!(address("__stext"), code, "the linker has followed");
    assert_eq!(address("_flash_end"), flash_end, "the end of the flash");
    assert_eq!(address("_ram_end"), ram_end, "the end of the RAM");
    let machine = Machine::power_on(image, Connections::default());
    let word = machine.read(VECTORS..VECTORS + 4).try_into().expect("four bytes");
    assert_eq!(u64::from(u32::from_le_bytes(word)), ram_end, "the top of the stack");
}

/// DS9405: 2 MiB of flash, of which bank 2 is the memory; 192 KiB of RAM besides the core-coupled one.
#[test]
fn the_image_for_the_f429zi_lies_in_bank_1() {
    check(Image::of(&NUCLEO_F429ZI), VECTORS + VECTORS_F429, 0x0810_0000, 0x2003_0000);
}

/// DS10693: 512 KiB of flash, of which sectors 1 and 2 are the memory; 128 KiB of RAM.
#[test]
fn the_image_for_the_f446re_leaves_sectors_1_and_2_out() {
    check(Image::of(&NUCLEO_F446RE), 0x0800_C000, 0x0808_0000, 0x2002_0000);
}

#[test]
fn the_smallest_image_lies_as_the_one_for_the_f429zi() {
    for profile in ["firmware", "firmware-minimal"] {
        // Its table has one interrupt.
        check(Image::example(profile, "minimal"), VECTORS + 4 * 17, 0x0810_0000, 0x2003_0000);
    }
}
