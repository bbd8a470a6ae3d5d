//! Detects devices whose bit rate differs from that of the bus. All interfaces use the same rule and message.
//!
//! Such a device cannot communicate, so a test that forbids a frame would pass without proving anything. [`RateWatch`]
//! reports such a device
//!
//! - at each power-up, as soon as virtual time has advanced;
//! - [`GRACE`] after a bit rate change of the bus or the device, because one of them must change first. The grace
//!   period is suspended while LSS switches the device's bit rate, from activate bit timing to the end of the second
//!   delay;
//! - immediately at the end of the run ([`RateWatch::find_all`]), or at the end of the period in which a frame or state
//!   is forbidden ([`RateWatch::find_at`]).

use protocol_core::controller::BitRate;
use protocol_core::device::Setup;
use protocol_core::time::{Duration, Instant, NEVER, after};
use serde::Serialize;
use utoipa::ToSchema;

use crate::devices::NamedDevice;
use crate::world::{NodeId, World};

/// The maximum time between the bit rate changes of the bus and a device.
pub const GRACE: Duration = Duration::from_secs(1);

const TICK: Duration = Duration::from_ticks(1);

/// A device whose bit rate differs, or differed, from that of the bus, so that the device cannot communicate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct NotHeard {
    /// The name of the device.
    pub device: String,
    /// The instant from which the rates differed, in microseconds of virtual time.
    pub t_us: u64,
    /// True once the rates agree again.
    pub is_over: bool,
    /// The cause and the remedy.
    pub reason: String,
}

/// A monitor that compares the devices' bit rates with the bus.
#[derive(Clone, Debug)]
pub struct RateWatch {
    devices: Vec<Watched>,
    /// The world's counter of rate changes at the last comparison; `None` before the first comparison.
    looked_at: Option<u64>,
    /// The time of the next comparison unless a bit rate changes first.
    due: Instant,
    /// The detected devices that have not been taken yet.
    found: Vec<NotHeard>,
}

#[derive(Clone, Debug)]
struct Watched {
    node: NodeId,
    device: NamedDevice,
    /// True if the memory was empty at the start, so that the setup determines the bit rate.
    is_new: bool,
    /// The bit rate to compare until the first power-up; `None` afterwards.
    first_rate: Option<BitRate>,
    was_powered: bool,
    spell: Option<Spell>,
    told: Option<NotHeard>,
}

/// A period during which the bit rates of device and bus differ.
#[derive(Clone, Copy, Debug)]
struct Spell {
    since: Instant,
    /// The end of the grace period; [`NEVER`] while LSS switches the bit rate.
    due: Instant,
    is_told: bool,
    rate: BitRate,
    bus: BitRate,
}

/// Creates a monitor without devices.
impl Default for RateWatch {
    fn default() -> Self {
        Self { devices: Vec::new(), looked_at: None, due: NEVER, found: Vec::new() }
    }
}

impl RateWatch {
    /// Starts monitoring a device that has not been powered on yet.
    pub fn watch(&mut self, node: NodeId, device: &NamedDevice, world: &World) {
        self.devices.push(Watched {
            node,
            device: device.clone(),
            is_new: world.memory(node).peek_image().is_new(),
            first_rate: Some(world.device_rate(node)),
            was_powered: false,
            spell: None,
            told: None,
        });
    }

    /// Stops monitoring a device.
    pub fn ignore(&mut self, node: NodeId) {
        self.devices.retain(|watched| watched.node != node);
    }

    /// Compares the current bit rates. Must be called after every event of the world and at the [due](Self::due) time.
    pub fn look(&mut self, world: &mut World) {
        let (now, changes) = (world.now(), world.rate_changes());
        if self.looked_at == Some(changes) && now < self.due {
            return;
        }
        self.looked_at = Some(changes);
        self.found.extend(self.devices.iter_mut().filter_map(|device| device.look(world)));
        let due = |device: &Watched| device.spell.filter(|spell| !spell.is_told).map(|spell| spell.due);
        self.due = self.devices.iter().filter_map(due).min().map_or(NEVER, |due| if due == NEVER { now } else { due });
    }

    /// Takes the devices detected since the last call. Each period of different bit rates is reported once.
    pub fn take_found(&mut self) -> Vec<NotHeard> {
        std::mem::take(&mut self.found)
    }

    /// Returns the time of the next scheduled comparison after `now`; [`NEVER`] if none is scheduled.
    #[must_use]
    pub fn due(&self, now: Instant) -> Instant {
        if self.due > now { self.due } else { NEVER }
    }

    /// Detects the devices with a different bit rate at the end of the run, without a grace period.
    pub fn find_all(&mut self) {
        self.found.extend(self.devices.iter_mut().filter_map(|device| device.find_if(|_| true)));
    }

    /// Detects the devices whose bit rate has differed since `instant` or earlier, without waiting for the end of the
    /// grace period. Called at the end of a period in which a frame or state is forbidden. A device whose bit rate is
    /// being switched by LSS is silent by design and is not reported.
    pub fn find_at(&mut self, instant: Instant) {
        let was_deaf = |spell: &Spell| spell.due != NEVER && spell.since <= instant;
        self.found.extend(self.devices.iter_mut().filter_map(|device| device.find_if(was_deaf)));
    }

    /// Returns the devices that have a different bit rate now or were detected before, each once.
    #[must_use]
    pub fn all(&self) -> Vec<NotHeard> {
        let state = |device: &Watched| match &device.spell {
            Some(spell) => Some(device.not_heard(spell)),
            None => device.told.clone(),
        };
        self.devices.iter().filter_map(state).collect()
    }
}

impl Watched {
    fn look(&mut self, world: &mut World) -> Option<NotHeard> {
        let now = world.now();
        let is_powered = world.is_powered(self.node);
        let starts = is_powered && !self.was_powered || self.first_rate.is_some();
        self.was_powered = is_powered;
        if is_powered {
            self.first_rate = None;
        }
        let rate = if is_powered { Some(world.device_rate(self.node)) } else { self.first_rate };
        let bus = world.bit_rate();
        let Some(rate) = rate.filter(|rate| *rate != bus) else {
            // The comparison at the end of the grace period may have been skipped.
            let told = self.find_if(|spell| now >= spell.due);
            self.spell = None;
            if let Some(told) = &mut self.told {
                told.is_over = true;
            }
            return told.map(|told| NotHeard { is_over: true, ..told });
        };
        let is_switching = world.is_switching_bit_rate(self.node);
        let due = after(now, if starts { TICK } else { GRACE });
        let spell = self.spell.get_or_insert(Spell { since: now, due, is_told: false, rate, bus });
        (spell.rate, spell.bus) = (rate, bus);
        if is_switching {
            spell.due = NEVER;
        } else if spell.due == NEVER {
            spell.due = after(now, GRACE);
        }
        self.find_if(|spell| now >= spell.due)
    }

    /// Reports the current period of the device if `is_wanted` accepts the period. Each period is reported once.
    fn find_if(&mut self, is_wanted: impl Fn(&Spell) -> bool) -> Option<NotHeard> {
        let spell = self.spell.as_mut().filter(|spell| !spell.is_told && is_wanted(spell))?;
        spell.is_told = true;
        let spell = *spell;
        self.told = Some(self.not_heard(&spell));
        self.told.clone()
    }

    fn not_heard(&self, spell: &Spell) -> NotHeard {
        let reason = reason(&self.device, self.is_new, spell.rate, spell.bus);
        NotHeard { device: self.device.name.clone(), t_us: spell.since.as_micros(), is_over: false, reason }
    }
}

/// Returns the message about a device, with the remedy. The setup determines the bit rate only for a new memory.
fn reason(device: &NamedDevice, is_new: bool, rate: BitRate, bus: BitRate) -> String {
    let kilobits = |rate: BitRate| rate.bits_per_second() / 1000;
    let other_device = (is_new && device.setup.bit_rate == Some(rate) && device.setup.kind.bit_rates().contains(&bus))
        .then(|| format!("{},bit-rate={}k, or ", written(device), kilobits(bus)));
    format!(
        "{} runs at {} kbit/s and the bus at {} kbit/s: it cannot communicate and will disturb the bus; use {}a bus at {}k",
        device.name,
        kilobits(rate),
        kilobits(bus),
        other_device.unwrap_or_default(),
        kilobits(rate)
    )
}

/// Formats a device in the syntax of `--device`, without serial number and bit rate.
fn written(NamedDevice { name, setup: Setup { kind, node_id, .. }, .. }: &NamedDevice) -> String {
    let mut text = kind.name().to_owned();
    match *node_id {
        Some(id) if id == kind.default_node_id() => {}
        Some(id) => text.push_str(&format!("@0x{id:02X}")),
        None => text.push_str(",blank"),
    }
    if name != kind.name() {
        text.push_str(&format!(",name={name}"));
    }
    text
}
