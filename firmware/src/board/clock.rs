//! The clock tree, the flash accelerator and the supply detector. The ST-LINK supplies 8 MHz; the core runs at 160 MHz.
//! CAN runs at 40 MHz, which yields every bit rate exactly.

use embassy_stm32::Config;
use embassy_stm32::pac::{FLASH, PWR};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;

/// The threshold of the supply detector: 2.93 V falling, 3.03 V rising (DS9405 table 22; DS10693 has the same).
const SUPPLY_LIMIT: u8 = 6;

/// Returns the clock configuration.
pub(super) fn config() -> Config {
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    rcc.pll_src = PllSource::HSE;
    rcc.pll =
        Some(Pll { prediv: PllPreDiv::DIV4, mul: PllMul::MUL160, divp: Some(PllPDiv::DIV2), divq: None, divr: None });
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV4;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.sys = Sysclk::PLL1_P;
    config
}

/// Configures the flash accelerator and the supply detector, which `embassy_stm32::init` does not configure.
pub(super) fn finish() {
    FLASH.acr().modify(|acr| {
        acr.set_prften(true);
        acr.set_icen(true);
        acr.set_dcen(true);
    });
    // Programming by words requires 2.7 V (DS9405, DS10693). Below 2.9 V nothing is written.
    PWR.cr1().modify(|control| {
        control.set_pls(SUPPLY_LIMIT);
        control.set_pvde(true);
    });
}

/// Returns whether the supply suffices to write the flash.
pub(super) fn supply_is_good() -> bool {
    !PWR.csr1().read().pvdo()
}
