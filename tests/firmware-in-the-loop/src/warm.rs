//! A processor that keeps, over a reset, what the emulator has compiled of the image.
//!
//! The emulator compiles the image while it runs, and drops all of that at a reset, which then takes as long as some
//! seconds of virtual time. The image in flash is the same afterwards; who writes to it has the emulator forget that
//! part by itself. So here a reset loads the state that the processor was made with, and nothing is dropped.
//!
//! The processor stands while a flash operation [holds it](crate::flash::Flash::holds): it runs nothing, and time goes
//! on to whatever happens next.
//!
//! It also shows the registers of the core itself, which only a debugger's processor model can read: [`CoreView`].

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::emulator::{
    Access, BitAlias, Checked, CoreBus, DataModel, Error, Exit, HaltReason, HostCall, InterruptLine, Processor,
    ProcessorConstructor, Queued,
};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

use crate::part::SharedFlash;

/// Registers of the core itself (interrupt controller, system control) that somebody wants to see. They are read by the
/// processor's own model, whenever it has run.
#[derive(Clone, Debug, Default)]
pub struct CoreView(Arc<Mutex<Registers>>);

#[derive(Debug, Default)]
struct Registers {
    watched: BTreeMap<u64, u32>,
    written: Vec<(u64, u32)>,
}

impl CoreView {
    /// Writes the register at an address before the processor runs next.
    pub fn write(&self, address: u64, value: u32) {
        self.lock().written.push((address, value));
    }

    /// Wants to see the register at an address, as it is when the processor has run next.
    pub fn watch(&self, address: u64) {
        self.lock().watched.insert(address, 0);
    }

    /// What a register held that is [watched](Self::watch).
    #[must_use]
    pub fn get(&self, address: u64) -> Option<u32> {
        self.lock().watched.get(&address).copied()
    }

    fn lock(&self) -> MutexGuard<'_, Registers> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Makes processors that stay warm, and that a flash holds.
pub(crate) fn kept(cold: ProcessorConstructor, view: CoreView, flash: SharedFlash) -> ProcessorConstructor {
    Arc::new(move |endian| {
        let inner = cold(endian)?;
        let made = inner.save();
        Ok(Box::new(Warm { inner, made, view: view.clone(), flash: flash.clone() }))
    })
}

#[derive(Debug)]
struct Warm {
    inner: Box<dyn Processor>,
    /// The state that it was made with; at the end the number of instructions, which is 0 and one byte.
    made: Vec<u8>,
    view: CoreView,
    flash: SharedFlash,
}

impl Warm {
    /// The state that it was made with, but the instructions go on being counted.
    fn as_made(&self) -> Vec<u8> {
        let (_, state) = self.made.split_last().expect("a state is not empty");
        let mut state = state.to_vec();
        let mut left = self.inner.retired();
        while left >= 0x80 {
            state.push(left as u8 | 0x80);
            left >>= 7;
        }
        state.push(left as u8);
        state
    }
}

/// The bus, behind which the processor does not go on when an access has begun an operation that holds it.
struct Held<'a> {
    bus: &'a mut dyn CoreBus,
    flash: &'a SharedFlash,
}

impl CoreBus for Held<'_> {
    fn access(&mut self, access: Access, from_code: bool) -> Option<u64> {
        self.bus.access(access, from_code)
    }

    fn time(&self, instructions: u64) -> VirtualNanos {
        self.bus.time(instructions)
    }

    fn queued(&mut self) -> Vec<Queued> {
        self.bus.queued()
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        let on = self.bus.carry_on(instructions, event);
        on.filter(|_| !self.flash.holds(self.bus.time(instructions)))
    }

    fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64> {
        self.bus.acknowledge(line, instructions)
    }

    fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked> {
        self.bus.read_checked(access, report)
    }

    fn write_checked(&mut self, access: Access) -> Option<bool> {
        self.bus.write_checked(access)
    }

    fn stops_before(&mut self, access: &Access) -> bool {
        self.bus.stops_before(access)
    }

    fn send_trace(&mut self, bytes: &[u8]) {
        self.bus.send_trace(bytes);
    }
}

impl Processor for Warm {
    fn reset(&mut self) {
        let retired = self.inner.retired();
        if self.inner.load(&self.as_made()).is_err() || self.inner.retired() != retired {
            self.inner.reset();
        }
    }

    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        if self.flash.holds(bus.time(self.inner.retired())) {
            return (Exit::Waiting, 0);
        }
        for (address, value) in self.view.lock().written.drain(..) {
            self.inner.debugger_access(Some(value.into()), address, Width::W32, VirtualNanos(0));
        }
        let ran = self.inner.run(budget, &mut Held { bus, flash: &self.flash });
        for (address, value) in &mut self.view.lock().watched {
            let seen = self.inner.debugger_access(None, *address, Width::W32, VirtualNanos(0));
            *value = seen.unwrap_or_default() as u32;
        }
        ran
    }

    fn retired(&self) -> u64 {
        self.inner.retired()
    }

    fn ask(&mut self, queued: Queued) {
        self.inner.ask(queued);
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.inner.maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.inner.page_size()
    }

    #[allow(unsafe_code, reason = "the trait's, handed on as it comes")]
    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller's promise is the one that is asked for.
        unsafe { self.inner.map(start, length, host, writable) };
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.inner.boot(table, read);
    }

    fn take_reset_request(&mut self) -> bool {
        self.inner.take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.inner.next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.inner.on_event(now);
    }

    fn waiting(&self) -> bool {
        self.inner.waiting()
    }

    fn pc(&self) -> u64 {
        self.inner.pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.inner.add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.inner.remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.inner.pass_breakpoint(address);
    }

    fn attach_debugger(&mut self, attached: bool) {
        self.inner.attach_debugger(attached);
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.inner.hold_interrupts(held);
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.inner.gdb_register(number)
    }

    fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.inner.set_gdb_register(number, bytes)
    }

    fn debugger_access(&mut self, write: Option<u64>, address: u64, width: Width, now: VirtualNanos) -> Option<u64> {
        self.inner.debugger_access(write, address, width, now)
    }

    fn take_debugger_trace(&mut self) -> Vec<u8> {
        self.inner.take_debugger_trace()
    }

    fn target_xml(&self) -> &'static str {
        self.inner.target_xml()
    }

    fn data_model(&self) -> DataModel {
        self.inner.data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.inner.byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.inner.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.inner.load(bytes)
    }

    fn monitor_command(&mut self, command: &str) -> Option<String> {
        self.inner.monitor_command(command)
    }

    fn debugger_halted(&mut self, why: HaltReason) -> bool {
        self.inner.debugger_halted(why)
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias> {
        self.inner.bit_alias(address, width)
    }

    fn own_ranges(&self) -> Vec<Range<u64>> {
        self.inner.own_ranges()
    }

    fn check_reads(&mut self, every: bool) {
        self.inner.check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.inner.check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.inner.host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.inner.answer_host_call(answer);
    }
}
