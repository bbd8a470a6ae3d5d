//! The flash interface against RM0090 chapter 3.

use super::*;

const WORD: u32 = 2 << cr::PSIZE;
const MS: Nanos = 1_000_000;

/// An erase of the first sector by words.
const ERASE: u32 = cr::SER | cr::STRT | 0x10 << cr::SNB | WORD;

fn unlock(flash: &mut Flash) {
    flash.write_register(KEYR, KEY1, 0);
    flash.write_register(KEYR, KEY2, 0);
}

fn unlocked() -> Flash {
    let mut flash = Flash::default();
    unlock(&mut flash);
    flash
}

fn programmed(flash: &mut Flash, offset: usize, value: u32, now: Nanos) -> Nanos {
    flash.write_register(CR, cr::PG | WORD, now);
    flash.write(offset, 4, value.into(), now);
    now + PROGRAM_TIME
}

fn status(flash: &mut Flash, now: Nanos) -> u32 {
    flash.read_register(SR, now).unwrap()
}

#[test]
fn two_keys_unlock_and_a_wrong_one_locks_for_good() {
    let mut flash = Flash::default();
    flash.write_register(CR, cr::PG, 0);
    assert_eq!(flash.read_register(CR, 0), Some(cr::LOCK));
    unlock(&mut flash);
    assert_eq!(flash.read_register(CR, 0), Some(0));
    flash.write_register(CR, cr::LOCK, 0);
    flash.write_register(KEYR, 7, 0);
    unlock(&mut flash);
    assert_eq!(flash.read_register(CR, 0), Some(cr::LOCK));
    flash.reset(0, 0);
    unlock(&mut flash);
    assert_eq!(flash.read_register(CR, 0), Some(0));
}

#[test]
fn programming_takes_its_time_and_clears_bits_only() {
    let mut flash = unlocked();
    let done = programmed(&mut flash, 8, 0xFFFF_1234, 100);
    assert_eq!(status(&mut flash, done - 1), sr::BSY);
    assert_eq!(status(&mut flash, done), 0);
    assert_eq!(flash.read(8, 4, done), 0xFFFF_1234);
    let done = programmed(&mut flash, 8, 0x0F0F_FFFF, done);
    assert_eq!(flash.read(8, 4, done), 0x0F0F_1234);
    assert_eq!((flash.wear(), flash.take_complaints()), ((2, 0), vec![]));
}

#[test]
fn the_width_has_to_be_that_of_psize_and_pg_has_to_be_set() {
    let mut flash = unlocked();
    flash.write_register(CR, cr::PG | WORD, 0);
    flash.write(0, 1, 0, 0);
    assert_eq!(status(&mut flash, 0), sr::PGPERR);
    flash.write_register(SR, sr::PGPERR, 0);
    for control in [WORD, WORD | cr::PG | cr::SER] {
        flash.write_register(SR, sr::PGSERR, 0);
        flash.write_register(CR, control, 0);
        flash.write(0, 4, 0, 0);
        assert_eq!(status(&mut flash, 0), sr::PGSERR, "{control:#x}");
    }
    assert_eq!(flash.content(4), [ERASED; 4]);
}

#[test]
fn a_sector_is_erased_in_the_time_of_its_size_and_parallelism() {
    let small = |snb: u32| (snb, [400, 300, 250]);
    for (snb, times) in [small(0x10), small(0x13), (0x14, [1200, 700, 550]), (0x15, [2000, 1300, 1000])] {
        for (psize, time) in (0..).zip(times) {
            let mut flash = unlocked();
            let start = programmed(&mut flash, 0, 0, 0);
            flash.write_register(CR, cr::SER | cr::STRT | snb << cr::SNB | psize << cr::PSIZE, start);
            assert_eq!(flash.due(), Some(start + time * MS), "{snb:#x} {psize}");
            assert_eq!(status(&mut flash, start + time * MS - 1), sr::BSY);
            assert_eq!(status(&mut flash, start + time * MS), 0);
            let expected = if snb == 0x10 { ERASED } else { 0 };
            assert_eq!(flash.content(4), [expected; 4]);
        }
    }
}

#[test]
fn the_end_and_errors_interrupt_when_that_is_enabled() {
    let mut flash = unlocked();
    flash.write_register(CR, cr::PG | WORD | cr::EOPIE, 0);
    flash.write(0, 4, 0, 0);
    flash.settle(PROGRAM_TIME - 1);
    assert!(!flash.interrupt());
    flash.settle(PROGRAM_TIME);
    assert!(flash.interrupt());
    flash.write_register(CR, cr::PG | WORD, PROGRAM_TIME);
    assert!(!flash.interrupt(), "disabled again");
    assert_eq!(status(&mut flash, PROGRAM_TIME), sr::EOP, "the flag stands");
    flash.write_register(CR, cr::PG | WORD | cr::EOPIE, PROGRAM_TIME);
    flash.write_register(SR, sr::EOP, PROGRAM_TIME);
    assert!(!flash.interrupt());
    flash.set_fails(true);
    flash.write_register(CR, cr::PG | WORD | cr::ERRIE, PROGRAM_TIME);
    flash.write(0, 4, 0, PROGRAM_TIME);
    assert_eq!(status(&mut flash, PROGRAM_TIME), sr::WRPERR | sr::OPERR);
    assert!(flash.interrupt());
}

#[test]
fn an_erase_tells_of_its_end_by_interrupt_and_keeps_its_settings() {
    let control = ERASE & !cr::STRT | cr::EOPIE | cr::ERRIE;
    let mut flash = unlocked();
    flash.write_register(CR, control, 0);
    flash.write_register(CR, control | cr::STRT, 0);
    flash.settle(250 * MS - 1);
    assert!(!flash.interrupt());
    assert_eq!(flash.read_register(CR, 250 * MS - 1), Some(control | cr::STRT), "STRT stands until the end");
    flash.settle(250 * MS);
    assert!(flash.interrupt());
    assert_eq!((status(&mut flash, 250 * MS), flash.read_register(CR, 250 * MS)), (sr::EOP, Some(control)));
    flash.write_register(SR, sr::EOP | sr::OPERR, 250 * MS);
    assert!(!flash.interrupt());
    assert_eq!((flash.due(), flash.wear()), (None, (0, 1)));
}

#[test]
fn an_erase_that_fails_tells_so_by_interrupt_at_once() {
    let mut flash = unlocked();
    flash.set_fails(true);
    flash.write_register(CR, ERASE | cr::EOPIE | cr::ERRIE, 0);
    assert_eq!((status(&mut flash, 0), flash.due()), (sr::WRPERR | sr::OPERR, None));
    assert!(flash.interrupt());
    flash.write_register(SR, sr::OPERR, 0);
    assert!(!flash.interrupt());
    assert_eq!(status(&mut flash, 0), sr::WRPERR, "each flag is cleared by itself");
    flash.set_fails(false);
    flash.write_register(CR, ERASE | cr::EOPIE | cr::ERRIE, 0);
    assert_eq!(flash.due(), Some(250 * MS), "it works again");
}

#[test]
fn the_journal_tells_when_what_began_since_the_power_came() {
    let mut flash = unlocked();
    let done = programmed(&mut flash, 0, 0, 100);
    flash.write_register(CR, cr::SER | cr::STRT | 0x11 << cr::SNB | WORD, done);
    let times: Vec<_> = flash.journal().iter().map(|entry| (entry.is_erase(), entry.from, entry.until)).collect();
    assert_eq!(times, [(false, 100, done), (true, done, done + 250 * MS)]);
    flash.reset(done, 0);
    assert_eq!(flash.journal(), []);
}

#[test]
fn what_would_stall_the_processor_is_complained_of() {
    let mut flash = unlocked();
    flash.write_register(CR, ERASE, 0);
    assert_eq!(status(&mut flash, 1000), sr::BSY);
    assert_eq!(flash.read_register(CR, 1000), Some(ERASE));
    assert_eq!(flash.take_complaints(), Vec::<String>::new(), "the registers may be read");
    flash.read(SECTOR_SIZE, 4, 1000);
    flash.write(0, 4, 0, 2000);
    flash.write_register(CR, 0, 3000);
    assert_eq!(flash.take_complaints().len(), 3);
    flash.settle(250 * MS);
    flash.read(0, 4, 250 * MS);
    assert_eq!(flash.take_complaints(), Vec::<String>::new());
}

#[test]
fn bank_1_is_not_to_be_erased() {
    for control in [cr::SER | 0 << cr::SNB, cr::SER | 0xB << cr::SNB, cr::MER, cr::MER1, cr::SER | 0x1C << cr::SNB] {
        let mut flash = unlocked();
        flash.write_register(CR, control | cr::STRT, 0);
        assert_eq!(flash.take_complaints().len(), 1, "{control:#x}");
        assert_eq!(flash.due(), None);
    }
}

#[test]
fn a_cut_tears_only_what_is_under_way() {
    let mut torn = 0;
    for seed in 0..50 {
        let mut flash = unlocked();
        let done = programmed(&mut flash, 0, 0x5555_5555, 0);
        programmed(&mut flash, 4, 0, done);
        flash.reset(done + PROGRAM_TIME / 2, seed);
        assert_eq!(flash.content(4), [0x55; 4]);
        torn += u32::from(flash.content(8)[4..] != [0; 4] && flash.content(8)[4..] != [ERASED; 4]);
        assert_eq!(flash.content(12)[8..], [ERASED; 4]);
    }
    assert!(torn > 40, "{torn} of 50 words are neither old nor new");
    let mut flash = unlocked();
    let done = programmed(&mut flash, 0, 0x5555_5555, 0);
    flash.reset(done, 0);
    assert_eq!(flash.content(4), [0x55; 4], "it was complete");
}

#[test]
fn a_cut_erase_leaves_a_mixture() {
    let mut flash = Flash::of(Layout::TWO_BANKS, &[0; SECTOR_SIZE]);
    unlock(&mut flash);
    flash.write_register(CR, ERASE, 0);
    flash.reset(100 * MS, 3);
    let erased = flash.content(SECTOR_SIZE).iter().filter(|byte| **byte == ERASED).count();
    assert!((1..SECTOR_SIZE).contains(&erased), "{erased}");
    assert_eq!(flash.read_register(CR, 0), Some(cr::LOCK));
}

#[test]
fn the_data_cache_has_to_be_off_while_bank_2_changes_and_reset_before_it_is_on_again() {
    let mut flash = unlocked();
    flash.write_register(ACR, acr::DCEN, 0);
    let done = programmed(&mut flash, 0, 0, 0);
    assert_eq!(flash.take_complaints().len(), 1, "it is on");
    flash.write_register(ACR, 0, done);
    let done = programmed(&mut flash, 4, 0, done);
    assert_eq!(flash.read(4, 4, done), 0, "nothing is cached");
    assert_eq!(flash.take_complaints(), Vec::<String>::new());
    flash.write_register(ACR, acr::DCEN, done);
    flash.read(4, 4, done);
    assert_eq!(flash.take_complaints().len(), 1, "it was not reset");
    flash.write_register(ACR, acr::DCEN | acr::DCRST, done);
    assert_eq!(flash.take_complaints().len(), 1, "it is reset while it is on");
    for access in [0, acr::DCRST, 0, acr::DCEN] {
        flash.write_register(ACR, access, done);
    }
    flash.read(4, 4, done);
    assert_eq!(flash.take_complaints(), Vec::<String>::new());
}

#[test]
fn with_one_bank_an_operation_holds_the_processor_to_its_end() {
    let mut flash = Flash::of(Layout::ONE_BANK, &[0; SECTOR_SIZE]);
    unlock(&mut flash);
    flash.write_register(ACR, acr::DCEN, 0);
    let done = programmed(&mut flash, SECTOR_SIZE, 0, 0);
    assert!(flash.holds(0) && flash.holds(done - 1) && !flash.holds(done));
    // Sector 1 is the first of the memory, sector 2 the second and last one.
    flash.write_register(CR, cr::SER | cr::STRT | 1 << cr::SNB | WORD, done);
    assert!(flash.holds(done + 250 * MS - 1) && !flash.holds(done + 250 * MS));
    assert_eq!(flash.content(4), [0; 4], "it is not done yet");
    flash.settle(done + 250 * MS);
    assert_eq!(flash.content(4), [ERASED; 4]);
    assert_eq!(flash.take_complaints(), Vec::<String>::new(), "one bank may be changed with the data cache on");
    for sector in [0, 3] {
        flash.write_register(CR, cr::SER | cr::STRT | sector << cr::SNB | WORD, done + 250 * MS);
        assert_eq!(flash.take_complaints().len(), 1, "sector {sector} is the image's");
    }
}

#[test]
fn a_slow_flash_takes_the_longest_times_of_the_data_sheet() {
    let mut flash = unlocked();
    flash.set_slow(true);
    flash.write_register(CR, cr::PG | WORD, 0);
    flash.write(0, 4, 0, 0);
    assert_eq!(flash.due(), Some(100_000));
    flash.settle(100_000);
    flash.write_register(CR, ERASE, 100_000);
    assert_eq!(flash.due(), Some(100_000 + 500 * MS));
}
