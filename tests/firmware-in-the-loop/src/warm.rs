//! A processor that keeps the compiled code of the image over a reset.
//!
//! The emulator compiles the image while it runs, and drops the code at a reset. The compilation then takes as long as
//! some seconds of virtual time, although the image in flash is the same. Here a reset loads the initial state of the
//! processor and drops nothing. A write to the image drops the code of the written part.
//!
//! The processor stalls while a flash operation [holds it](crate::flash::Flash::holds): it executes nothing, and time
//! goes on to the next event.
//!
//! It also shows the registers of the core itself, which only the model of the processor can read: [`CoreView`].

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

/// The registers of the core itself (interrupt controller, system control) that a test watches. The model of the
/// processor reads them after each run.
#[derive(Clone, Debug, Default)]
pub struct CoreView(Arc<Mutex<Registers>>);

#[derive(Debug, Default)]
struct Registers {
    watched: BTreeMap<u64, u32>,
    written: Vec<(u64, u32)>,
}

impl CoreView {
    /// Writes the register at an address before the next run of the processor.
    pub fn write(&self, address: u64, value: u32) {
        self.lock().written.push((address, value));
    }

    /// Watches the register at an address, from the next run of the processor on.
    pub fn watch(&self, address: u64) {
        self.lock().watched.insert(address, 0);
    }

    /// Returns the value of a [watched](Self::watch) register.
    #[must_use]
    pub fn get(&self, address: u64) -> Option<u32> {
        self.lock().watched.get(&address).copied()
    }

    fn lock(&self) -> MutexGuard<'_, Registers> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Creates processors that stay warm, and that a flash can stall.
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
    /// The initial state of the processor. Its end is the number of instructions, which is 0 and one byte.
    made: Vec<u8>,
    view: CoreView,
    flash: SharedFlash,
}

impl Warm {
    /// Returns the initial state with the present number of instructions.
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

/// Forwards methods of a trait to a field.
macro_rules! hand_on {
    ($field:ident, & $($name:ident($self:ident $(, $argument:ident: $type:ty)*) $(-> $result:ty)?;)*) => {
        $(fn $name(&$self $(, $argument: $type)*) $(-> $result)? {
            $self.$field.$name($($argument),*)
        })*
    };
    ($field:ident, &mut $($name:ident($self:ident $(, $argument:ident: $type:ty)*) $(-> $result:ty)?;)*) => {
        $(fn $name(&mut $self $(, $argument: $type)*) $(-> $result)? {
            $self.$field.$name($($argument),*)
        })*
    };
}

/// The bus of a processor that stalls when an access has begun an operation of the flash.
struct Held<'a> {
    bus: &'a mut dyn CoreBus,
    flash: &'a SharedFlash,
}

impl CoreBus for Held<'_> {
    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        let on = self.bus.carry_on(instructions, event);
        on.filter(|_| !self.flash.holds(self.bus.time(instructions)))
    }

    hand_on! { bus, &
        time(self, instructions: u64) -> VirtualNanos;
    }

    hand_on! { bus, &mut
        access(self, access: Access, from_code: bool) -> Option<u64>;
        queued(self) -> Vec<Queued>;
        acknowledge(self, line: InterruptLine, instructions: u64) -> Option<u64>;
        read_checked(self, access: Access, report: bool) -> Option<Checked>;
        write_checked(self, access: Access) -> Option<bool>;
        stops_before(self, access: &Access) -> bool;
        send_trace(self, bytes: &[u8]);
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

    #[allow(unsafe_code, reason = "the trait's, handed on as it comes")]
    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller gives the same promise.
        unsafe { self.inner.map(start, length, host, writable) };
    }

    hand_on! { inner, &
        retired(self) -> u64;
        maps(self, start: u64, length: u64) -> bool;
        page_size(self) -> u64;
        next_event(self) -> Option<VirtualNanos>;
        waiting(self) -> bool;
        pc(self) -> u64;
        gdb_register(self, number: usize) -> Option<Vec<u8>>;
        target_xml(self) -> &'static str;
        data_model(self) -> DataModel;
        byte_order(self, address: u64) -> Endian;
        save(self) -> Vec<u8>;
        bit_alias(self, address: u64, width: Width) -> Option<BitAlias>;
        own_ranges(self) -> Vec<Range<u64>>;
        host_call(self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall>;
    }

    hand_on! { inner, &mut
        ask(self, queued: Queued);
        boot(self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>);
        take_reset_request(self) -> bool;
        on_event(self, now: VirtualNanos);
        add_breakpoint(self, address: u64) -> bool;
        remove_breakpoint(self, address: u64);
        pass_breakpoint(self, address: u64);
        attach_debugger(self, attached: bool);
        hold_interrupts(self, held: bool);
        set_gdb_register(self, number: usize, bytes: &[u8]) -> bool;
        debugger_access(self, write: Option<u64>, address: u64, width: Width, now: VirtualNanos) -> Option<u64>;
        take_debugger_trace(self) -> Vec<u8>;
        load(self, bytes: &[u8]) -> Result<(), Error>;
        monitor_command(self, command: &str) -> Option<String>;
        debugger_halted(self, why: HaltReason) -> bool;
        check_reads(self, every: bool);
        check_words(self, words: &[u64]);
        answer_host_call(self, answer: Option<u64>);
    }
}
