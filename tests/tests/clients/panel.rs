//! The panel in a browser: playwright-core with the system's Chromium, against simulators that the scripts start.
//!
//! `./test` installs both, playwright-core into `target/node`; the scripts are in `tests/clients/panel/`, one subject
//! each. One of them is a foreign page, which attacks the ports of the bus.

use std::process::Command;
use std::sync::Mutex;

use crate::programs::output;
use crate::simulator::{PVE_SIM, modules, root};

/// One browser at a time: each takes a processor and half a gigabyte.
static BROWSER: Mutex<()> = Mutex::new(());

/// Runs a script, and shows what it printed.
fn look(script: &str) {
    let _alone = BROWSER.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut node = Command::new("node");
    node.arg(root().join("tests/clients/panel").join(script)).args([PVE_SIM.as_path(), &modules()]);
    let run = output(&mut node);
    let said = [run.stdout, run.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(run.status.success(), "{script}: {}\n{said}", run.status);
    print!("{said}");
}

calls! {
    a_supply_of_8_volts_is_seen: look("fault.mjs");
    every_control_of_the_panel_is_driven_by_the_keyboard: look("controls.mjs");
    colours_sliders_and_the_filter_serve_the_eye: look("sight.mjs");
    a_device_at_another_bit_rate_is_named_with_the_remedy: look("rates.mjs");
    the_panel_outlives_the_simulator: look("away.mjs");
    the_panel_shows_what_its_events_left_out: look("events.mjs");
    a_control_with_the_focus_shows_the_value_of_the_device: look("values.mjs");
    twenty_valves_leave_the_browser_time: look("pace.mjs");
    a_web_page_sends_nothing_to_the_bus: look("foreign.mjs");
    the_page_of_a_campaign_is_read_filtered_and_printed: look("campaign.mjs");
}
