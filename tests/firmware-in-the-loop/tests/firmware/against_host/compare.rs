//! Comparison of a recorded episode with the host: ties, and the fewest steps that still end in a difference.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use firmware_in_the_loop::boards::Noticed;
use firmware_in_the_loop::rig::Device;
use hal_sim::WireEvent;

use super::host::{Delay, Delays, Difference, Host, REACTION, Trigger};
use super::recorder::{Event, Recorder, Run};
use super::traffic::Step;

/// The number of triggers before a difference whose delays are varied, one at a time.
const VARIED: usize = 32;
/// The number of these that are late while another one is varied.
const LATE: usize = 4;
/// The time after which a difference is not shrunk further.
const SHRINKING: Duration = Duration::from_secs(60);

/// The result of a comparison.
pub enum Verdict {
    /// The number of frames, all the same, and of ties.
    Same(u64, u64),
    /// The run in which image and host differ first.
    Differs(usize, Difference),
}

/// Compares the runs of an episode.
pub fn compare(device: &Device, runs: &[Run]) -> Verdict {
    let (mut frames, mut ties) = (0, 0);
    for (number, run) in runs.iter().enumerate() {
        let mut delays = Delays::new();
        loop {
            match Host::new(device, run, &delays).play() {
                Ok(compared) => {
                    frames += compared;
                    ties += delays.len() as u64;
                    break;
                }
                Err(difference) => match untie(device, run, &delays, &difference) {
                    Some(untied) => delays = untied,
                    None => return Verdict::Differs(number, difference),
                },
            }
        }
    }
    Verdict::Same(frames, ties)
}

/// Returns delays with which image and host agree beyond a difference: other ones of one trigger before it, of all of
/// them, or of one while one of the last few is late.
fn untie(device: &Device, run: &Run, delays: &Delays, difference: &Difference) -> Option<Delays> {
    let triggers: Vec<Trigger> = difference.triggers.iter().rev().take(VARIED).copied().collect();
    let agrees = |delays: &Delays| match Host::new(device, run, delays).play() {
        Ok(_) => true,
        Err(next) => next.event > difference.event,
    };
    let vary_each = |delays: &Delays| {
        triggers.iter().find_map(|trigger| variants(std::slice::from_ref(trigger), delays).find(agrees))
    };
    vary_each(delays).or_else(|| variants(&triggers, delays).find(agrees)).or_else(|| {
        triggers.iter().take(LATE).find_map(|trigger| {
            let mut late = delays.clone();
            late.insert(*trigger, Delay { act: REACTION, ..trigger.usual() });
            vary_each(&late)
        })
    })
}

/// Returns the delays with each other act for these triggers, then with each other clock: the clock stays in heartbeats
/// and event timers, where a wrong one would show too late.
fn variants(triggers: &[Trigger], delays: &Delays) -> impl Iterator<Item = Delays> {
    let vary = move |change: &dyn Fn(Delay) -> Delay| {
        let mut varied = delays.clone();
        for trigger in triggers {
            varied.insert(*trigger, change(delays.get(trigger).copied().unwrap_or(trigger.usual())));
        }
        varied
    };
    let acts = (0..=REACTION).map(move |act| vary(&|Delay { clock, .. }| Delay { clock: clock.min(act), act }));
    let clocks = (0..=REACTION).map(move |clock| vary(&|Delay { act, .. }| Delay { clock, act: act.max(clock) }));
    acts.chain(clocks)
}

/// Looks for fewer steps that still end in a difference of the same kind; returns its listing.
pub fn shrink(device: &Device, recorder: &mut Recorder, mut steps: Vec<Step>, found: String) -> String {
    // The first words, behind the time: "the image sends", "the host sends", …
    let kind = |listing: &str| listing.lines().last().and_then(|what| what.get(11..27)).unwrap_or_default().to_owned();
    let (wanted, end) = (kind(&found), Instant::now() + SHRINKING);
    let mut fewest = found;
    let mut size = steps.len() / 2;
    while size > 0 {
        let mut at = steps.len();
        while at > 0 && Instant::now() < end {
            at = at.saturating_sub(size);
            let mut fewer = steps.clone();
            fewer.drain(at..steps.len().min(at + size));
            let runs = recorder.play(&fewer);
            if let Verdict::Differs(run, difference) = compare(device, &runs)
                && let listing = listing(&runs[run], &difference)
                && kind(&listing) == wanted
            {
                (steps, fewest) = (fewer, listing);
            }
        }
        size /= 2;
    }
    fewest
}

/// Returns the run up to a difference, as the manuals write frames: → to the image, ← from it.
pub fn listing(run: &Run, difference: &Difference) -> String {
    let line = |at: u64, what: &str| format!("{:6}.{:03} {what}", at / 1000, at % 1000);
    let mut text = String::new();
    for (at, event) in run.events.iter().take(difference.event + 1) {
        let what = match event {
            Event::Typed(change) => format!("  {change}"),
            Event::Mode(mode) => format!("  {mode:?}"),
            Event::Called(call) => format!("  {call:?}"),
            Event::Noticed(Noticed::Sends(frame)) => format!("← {frame}"),
            Event::Noticed(Noticed::Wire(WireEvent::Received(frame))) => format!("→ {frame}"),
            Event::Noticed(Noticed::OnBus(Some(rate))) => format!("  {rate} bit/s"),
            Event::Noticed(Noticed::OnBus(None)) => "  off the bus".to_owned(),
            Event::Noticed(Noticed::Wire(_)) => continue,
        };
        let _ = writeln!(text, "{}", line(*at, &what));
    }
    text + &line(difference.at, &difference.what)
}
