//! SocketCAN: `pve-sim` on an interface of a real kernel, beside that kernel's own tools.
//!
//! `tests/user-mode-linux/with-can` brings the kernel; the scripts start `pve-sim` in it.

use std::process::Command;
use std::time::Duration;

use crate::programs::{LIFE, output};
use crate::simulator::{PVE_SIM, python, root};

/// The kernel ends before the test gives it up: it has something to say, too.
const KERNEL_LIFE: Duration = LIFE.saturating_sub(Duration::from_secs(30));

/// Runs a subject of a script on the kernel, and shows all there is to see when it fails.
pub(crate) fn on_a_kernel(script: &str, subject: &str) {
    let mut command = Command::new(root().join("tests/user-mode-linux/with-can"));
    command
        .arg(python())
        .arg(root().join("tests/clients").join(script))
        .arg(subject)
        .env("PVE_SIM", &*PVE_SIM)
        .env("WITH_CAN_SECONDS", KERNEL_LIFE.as_secs().to_string())
        .current_dir(root());
    let run = output(&mut command);
    let (out, err) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{script} {subject}: {}\n{out}{err}", run.status);
}

calls! {
    can_utils_join: on_a_kernel("socketcan.py", "tools");
    python_canopen_is_the_master: on_a_kernel("socketcan.py", "master");
    the_kernels_j1939_stack_is_the_tractor: on_a_kernel("socketcan.py", "j1939");
    an_interface_that_goes_down_or_away_comes_back: on_a_kernel("socketcan.py", "down");
    a_full_queue_loses_nothing: on_a_kernel("socketcan.py", "full");
}
