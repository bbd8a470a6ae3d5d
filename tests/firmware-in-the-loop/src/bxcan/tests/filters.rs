//! 32.7.4: filter banks.

use super::*;

/// A bank of filters.
struct Bank {
    number: u32,
    wide: bool,
    list: bool,
    fifo: u32,
    registers: [u32; 2],
}

fn with(banks: &[Bank]) -> BxCan {
    let mut can = on_bus(0);
    can.write(FMR, can.read(FMR) | 1);
    let bits = |is: fn(&Bank) -> bool| banks.iter().map(|bank| u32::from(is(bank)) << bank.number).sum();
    can.write(FS1R, bits(|bank| bank.wide));
    can.write(FM1R, bits(|bank| bank.list));
    can.write(FFA1R, bits(|bank| bank.fifo == 1));
    can.write(FA1R, bits(|_| true));
    for bank in banks {
        can.write(F0R1 + 8 * bank.number, bank.registers[0]);
        can.write(F0R1 + 8 * bank.number + 4, bank.registers[1]);
    }
    can.write(FMR, can.read(FMR) & !1);
    can
}

/// FIFO and filter match index of a frame, if it gets through.
fn way(can: &mut BxCan, frame: Frame) -> Option<(u32, u32)> {
    receive(can, frame);
    let fifo = (0..2).find(|fifo| can.read(RF0R + 4 * fifo) & 3 != 0)?;
    let index = can.read(RI0R + 0x10 * fifo + 4) >> 8 & 0xFF;
    release(can, fifo);
    Some((fifo, index))
}

fn bank(number: u32, wide: bool, list: bool, fifo: u32, registers: [u32; 2]) -> Bank {
    Bank { number, wide, list, fifo, registers }
}

const fn narrow(id: u32) -> u32 {
    id << 5
}

#[test]
fn a_mask_of_32_bits_looks_at_the_bits_it_names() {
    // Standard frames 0x600..0x60F, data frames only.
    let mask = 0x7F0 << 21 | 1 << 2 | 1 << 1;
    let mut can = with(&[bank(0, true, false, 0, [0x600 << 21, mask])]);
    assert_eq!(way(&mut can, std(0x600, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, std(0x60F, &[1])), Some((0, 0)));
    assert_eq!(way(&mut can, std(0x610, &[])), None);
    assert_eq!(way(&mut can, Frame::remote(standard(0x600).into(), 0)), None);
    assert_eq!(way(&mut can, ext(0x600 << 18, &[])), None);
}

#[test]
fn a_mask_of_32_bits_sees_all_of_an_extended_identifier() {
    // PGN 0xEA00 to anybody, from anybody: PF in bits 16 to 23.
    let mask = 0xFF << (16 + 3) | 1 << 2;
    let mut can = with(&[bank(0, true, false, 1, [0xEA << (16 + 3) | 1 << 2, mask])]);
    assert_eq!(way(&mut can, ext(0x18EA_FF80, &[])), Some((1, 0)));
    assert_eq!(way(&mut can, ext(0x0CEA_0001, &[])), Some((1, 0)));
    assert_eq!(way(&mut can, ext(0x18EB_FF80, &[])), None);
    assert_eq!(way(&mut can, std(0x0EA, &[])), None);
}

#[test]
fn a_list_of_32_bits_is_two_identifiers() {
    let mut can = with(&[bank(0, true, true, 0, [0x123 << 21, 0x1234_5678 << 3 | 4])]);
    assert_eq!(way(&mut can, std(0x123, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, ext(0x1234_5678, &[])), Some((0, 1)));
    assert_eq!(way(&mut can, std(0x122, &[])), None);
    assert_eq!(way(&mut can, ext(0x1234_5679, &[])), None);
    assert_eq!(way(&mut can, Frame::remote(standard(0x123).into(), 0)), None, "RTR belongs to it");
}

#[test]
fn a_bank_of_16_bits_has_two_masks() {
    // The identifier is the lower half of a register, its mask the upper one.
    let exact = narrow(0x7FF) | 1 << 4 | 1 << 3;
    let group = narrow(0x780) | 1 << 3;
    let mut can = with(&[bank(0, false, false, 0, [exact << 16 | narrow(0x080), group << 16 | narrow(0x600)])]);
    assert_eq!(way(&mut can, std(0x080, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, Frame::remote(standard(0x080).into(), 0)), None);
    assert_eq!(way(&mut can, std(0x67F, &[])), Some((0, 1)));
    assert_eq!(way(&mut can, Frame::remote(standard(0x67F).into(), 0)), Some((0, 1)), "its mask leaves RTR open");
    assert_eq!(way(&mut can, std(0x580, &[])), None);
    assert_eq!(way(&mut can, ext(0x67F << 18, &[])), None);
}

#[test]
fn a_list_of_16_bits_is_four_identifiers_lower_half_first() {
    let mut can = with(&[bank(0, false, true, 0, [narrow(2) << 16 | narrow(1), narrow(4) << 16 | narrow(3)])]);
    for id in 1..=4 {
        assert_eq!(way(&mut can, std(id, &[])), Some((0, u32::from(id) - 1)));
    }
    assert_eq!(way(&mut can, std(5, &[])), None);
}

#[test]
fn a_filter_of_16_bits_sees_the_upper_three_bits_of_the_extension() {
    let filter = narrow(0x155) | 1 << 3 | 0b101;
    let mut can = with(&[bank(0, false, true, 0, [filter, 0])]);
    assert_eq!(way(&mut can, ext(0x155 << 18 | 0b101 << 15, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, ext(0x155 << 18 | 0b101 << 15 | 0x7FFF, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, ext(0x155 << 18 | 0b100 << 15, &[])), None);
}

#[test]
fn filters_are_numbered_for_each_fifo_active_or_not() {
    // The example of the manual's figure "Example of filter numbering", its first banks.
    let mut can = with(&[
        bank(0, true, true, 0, [0x10 << 21, 0x11 << 21]),
        bank(1, true, false, 1, [0x20 << 21, u32::MAX]),
        bank(2, false, true, 1, [narrow(0x31) << 16 | narrow(0x30), narrow(0x33) << 16 | narrow(0x32)]),
        bank(3, false, false, 0, [0xFFFF << 16 | narrow(0x40), 0xFFFF << 16 | narrow(0x41)]),
        bank(4, true, true, 0, [0x50 << 21, 0x51 << 21]),
        bank(5, true, false, 1, [0x60 << 21, u32::MAX]),
    ]);
    can.write(FA1R, can.read(FA1R) & !(1 << 3));
    for (id, expected) in [
        (0x10, Some((0, 0))),
        (0x11, Some((0, 1))),
        (0x40, None),
        (0x50, Some((0, 4))),
        (0x51, Some((0, 5))),
        (0x20, Some((1, 0))),
        (0x30, Some((1, 1))),
        (0x33, Some((1, 4))),
        (0x60, Some((1, 5))),
    ] {
        assert_eq!(way(&mut can, std(id, &[])), expected, "{id:#x}");
    }
}

#[test]
fn the_wider_filter_goes_first_then_the_list_then_the_lower_number() {
    let all = [0, 0];
    let narrow_list = bank(0, false, true, 0, [narrow(0x100), narrow(0x100)]);
    let narrow_mask = bank(1, false, false, 0, all);
    let wide_mask = bank(2, true, false, 1, all);
    let wide_list = bank(3, true, true, 1, [0x100 << 21, 0x100 << 21]);
    let mut can = with(&[narrow_list, narrow_mask, wide_mask, wide_list]);
    assert_eq!(way(&mut can, std(0x100, &[])), Some((1, 1)), "32 bits, list");
    can.write(FA1R, 0b0111);
    assert_eq!(way(&mut can, std(0x100, &[])), Some((1, 0)), "32 bits, mask");
    can.write(FA1R, 0b0011);
    assert_eq!(way(&mut can, std(0x100, &[])), Some((0, 0)), "16 bits, list, the first of two");
    can.write(FA1R, 0b0010);
    assert_eq!(way(&mut can, std(0x100, &[])), Some((0, 4)), "16 bits, mask, the first of two");
    can.write(FA1R, 0);
    assert_eq!(way(&mut can, std(0x100, &[])), None, "without a filter nothing passes");
}

#[test]
fn the_banks_from_can2sb_on_are_not_those_of_can1() {
    let everything = |number| bank(number, true, false, 0, [0, 0]);
    let mut can = with(&[everything(14)]);
    assert_eq!(can.read(FMR) >> 8 & 0x3F, 14);
    assert_eq!(way(&mut can, std(1, &[])), None);
    can.write(FMR, 28 << 8);
    assert!(way(&mut can, std(1, &[])).is_some());
}

#[test]
fn while_filters_are_initialized_nothing_is_received() {
    let mut can = on_bus(0);
    can.write(FMR, can.read(FMR) | 1);
    assert_eq!(way(&mut can, std(1, &[])), None);
}

#[test]
fn mode_scale_and_assignment_are_written_in_filter_initialization_only() {
    let mut can = with(&[bank(0, true, false, 0, [1 << 21, u32::MAX])]);
    for register in [FM1R, FS1R, FFA1R] {
        let before = can.read(register);
        can.write(register, !before);
        assert_eq!(can.read(register), before, "{register:#05x}");
    }
    can.write(F0R1, 7);
    assert_eq!(can.read(F0R1), 1 << 21, "an active bank");
    can.write(F0R1 + 8, 7);
    assert_eq!(can.read(F0R1 + 8), 7, "a bank that is not active");
}

#[test]
fn a_bank_is_changed_while_the_others_go_on() {
    let exact = |number, id: u32| bank(number, true, false, 0, [id << 21, u32::MAX << 21]);
    let mut can = with(&[exact(0, 0x100), exact(1, 0x200)]);
    let set_up = can.filter_gaps();
    can.write(FA1R, 0b10);
    assert_eq!(way(&mut can, std(0x100, &[])), None, "inactive");
    assert_eq!(way(&mut can, std(0x200, &[])), Some((0, 1)), "the other one goes on, under its number");
    can.write(F0R1, 0x300 << 21);
    assert_eq!(way(&mut can, std(0x300, &[])), None, "not yet");
    can.write(FA1R, 0b11);
    assert_eq!(way(&mut can, std(0x300, &[])), Some((0, 0)));
    assert_eq!(way(&mut can, std(0x100, &[])), None);
    assert_eq!(can.filter_gaps(), set_up, "what it let through before, it does no longer");
}

#[test]
fn a_bank_that_is_off_for_nothing_is_a_gap() {
    let mut can = with(&[bank(0, true, false, 0, [1 << 21, u32::MAX])]);
    let set_up = can.filter_gaps();
    can.write(FA1R, 0);
    can.write(F0R1, 1 << 21);
    can.write(FA1R, 1);
    assert_eq!(can.filter_gaps(), set_up + 1);
    can.write(FMR, can.read(FMR) | 1);
    assert_eq!(can.filter_gaps(), set_up + 2, "so is an initialization of all");
    can.write(FMR, can.read(FMR) & !1);
    assert_eq!(can.filter_gaps(), set_up + 2);
}

#[test]
fn all_28_banks_can_be_those_of_can1() {
    let exact = |number, id: u32| bank(number, true, false, 0, [id << 21, u32::MAX << 21]);
    let mut can = with(&[exact(0, 0x100), exact(13, 0x200), exact(14, 0x300), exact(27, 0x400)]);
    let numbers = [0x100, 0x200, 0x300, 0x400].map(|id| way(&mut can, std(id, &[])).map(|(_, index)| index));
    assert_eq!(numbers[1..], [numbers[1], None, None], "14 are for CAN2");
    can.write(FMR, 28 << 8);
    for id in [0x100, 0x200, 0x300, 0x400] {
        assert!(way(&mut can, std(id, &[])).is_some(), "{id:#x}");
    }
    can.write(FMR, 0);
    assert_eq!(way(&mut can, std(0x100, &[])), None, "0: all are for CAN2");
}

#[test]
fn a_filter_without_rtr_in_its_mask_lets_remote_frames_through() {
    let remote = Frame::remote(standard(0x100).into(), 0);
    let mut can = with(&[bank(0, true, false, 0, [0x100 << 21, 0x7FF << 21 | ir::IDE])]);
    assert!(way(&mut can, remote).is_some());
    let mut can = with(&[bank(0, true, false, 0, [0x100 << 21, 0x7FF << 21 | ir::IDE | ir::RTR])]);
    assert_eq!(way(&mut can, remote), None);
}
