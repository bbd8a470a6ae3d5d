//! The peripherals and tasks of the board.
//!
//! | priority | task or interrupt |
//! | --- | --- |
//! | [`CAN_PRIORITY`] | CAN interrupts, which move received frames to a queue and load the next frame into a mailbox |
//! | [`CLOCK_PRIORITY`] | interrupt of the clock, for timers |
//! | [`DEVICE_PRIORITY`] | device task, with its own executor |
//! | [`SERIAL_PRIORITY`] | UART interrupt of the console, which detects damaged characters before their use |
//! | [`SERVICE_PRIORITY`] | console, LED and button tasks, with their own executor; interrupts of DMA and flash |
//! | thread | memory task, which blocks while the flash is busy |

mod button;
mod can;
mod clock;
mod console;
mod device;
mod flash;
mod led;
mod link;
mod local_controls;
#[cfg_attr(feature = "nucleo-f429zi", path = "nucleo_f429zi.rs")]
#[cfg_attr(feature = "nucleo-f446re", path = "nucleo_f446re.rs")]
mod nucleo;
mod reset;
mod serial;
mod storage;
mod wake_up;
mod watchdog;

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::gpio::Input;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::pac::Interrupt;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;

use local_controls::LocalControls;
use watchdog::Watchdog;

const CAN_PRIORITY: Priority = Priority::P4;
const CLOCK_PRIORITY: Priority = Priority::P6;
const DEVICE_PRIORITY: Priority = Priority::P8;
const SERIAL_PRIORITY: Priority = Priority::P10;
const SERVICE_PRIORITY: Priority = Priority::P12;

/// The executor of the device task. It runs in the interrupt of an unused peripheral.
static DEVICE: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
fn UART5() {
    // SAFETY: this is the handler of the interrupt with which the executor is started.
    unsafe { DEVICE.on_interrupt() }
}

/// The executor of the console, LED and button tasks. It runs in the interrupt of an unused peripheral, and preempts
/// the memory task, which blocks while the flash is busy.
static SERVICES: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
fn UART4() {
    // SAFETY: as above.
    unsafe { SERVICES.on_interrupt() }
}

/// The peripherals that all NUCLEO boards have.
struct Nucleo {
    can: can::Can1,
    sectors: flash::Sectors,
    console: Option<serial::Port>,
    button: Input<'static>,
    leds: nucleo::Leds,
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    // The channels and signals between the device task and the tasks of memory, console, button and LEDs.
    static REQUESTS: storage::Requests = Channel::new();
    static RESULTS: storage::Results = Channel::new();
    static LINES: console::Lines = Signal::new();
    static ANSWERS: console::Answers = Signal::new();
    static PRESSES: button::Presses = Signal::new();
    static LIGHTS: led::Lights = led::Lights::new();

    let watchdog = Watchdog::start();
    let cause = reset::cause();
    let board = embassy_stm32::init(clock::config());
    clock::finish();
    for (line, priority) in [
        (Interrupt::TIM5, CLOCK_PRIORITY),
        (Interrupt::UART5, DEVICE_PRIORITY),
        (nucleo::SERIAL, SERIAL_PRIORITY),
        (nucleo::RECEIVE, SERVICE_PRIORITY),
        (nucleo::TRANSMIT, SERVICE_PRIORITY),
        (Interrupt::UART4, SERVICE_PRIORITY),
        (Interrupt::FLASH, SERVICE_PRIORITY),
    ] {
        line.set_priority(priority);
    }

    let Nucleo { can, sectors, console, button, leds } = nucleo::open(board);
    let memory = storage::Client::new(REQUESTS.sender(), RESULTS.receiver());
    let controls = LocalControls::new(&LINES, &ANSWERS, &PRESSES);

    // Each task is spawned once, so spawning cannot fail.
    if let Ok(task) = device::run(can, watchdog, cause, memory, controls, &LIGHTS) {
        DEVICE.start(Interrupt::UART5).spawn(task);
    }
    if let Ok(task) = storage::run(sectors, REQUESTS.receiver(), RESULTS.sender()) {
        spawner.spawn(task);
    }
    let services = SERVICES.start(Interrupt::UART4);
    if let Some(Ok(task)) = console.map(|console| console::run(console, &LINES, &ANSWERS)) {
        services.spawn(task);
    }
    if let Ok(task) = led::run(leds, &LIGHTS) {
        services.spawn(task);
    }
    if let Ok(task) = button::run(button, &PRESSES) {
        services.spawn(task);
    }
}
