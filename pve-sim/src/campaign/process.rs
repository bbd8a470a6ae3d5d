//! The processes that a campaign starts, each in a group of its own: simulators and controller programs.

use std::io;
use std::process::{Child, Command};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The process IDs of the groups that have not ended; `None` once this process ends.
static RUNNING: Mutex<Option<Vec<u32>>> = Mutex::new(Some(Vec::new()));

fn running() -> MutexGuard<'static, Option<Vec<u32>>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A process with its children. Ctrl-C in the terminal does not reach them. They end with [`Group::end`], with a drop, or
/// with [`end_all`].
#[derive(Debug)]
pub(super) struct Group(Child);

impl Group {
    /// Starts a process. Fails once [`end_all`] was called.
    pub(super) fn start(command: &mut Command) -> io::Result<Self> {
        apart(command);
        // The lock is held during the start, so that no process escapes `end_all`.
        let mut running = running();
        let running = running.as_mut().ok_or(io::ErrorKind::Interrupted)?;
        let child = command.spawn()?;
        running.push(child.id());
        Ok(Self(child))
    }

    /// Returns the process.
    pub(super) const fn child(&mut self) -> &mut Child {
        &mut self.0
    }

    /// Returns whether the process has ended. Its children may still run.
    pub(super) fn has_ended(&mut self) -> bool {
        has_ended(&mut self.0)
    }

    /// Ends the process with its children.
    pub(super) fn end(&mut self) {
        let id = self.0.id();
        if let Some(running) = running().as_mut().filter(|running| running.contains(&id)) {
            kill_group(id);
            running.retain(|known| *known != id);
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.end();
    }
}

/// Ends all groups, because this process ends. No further group starts.
pub(super) fn end_all() {
    running().take().into_iter().flatten().for_each(kill_group);
}

#[cfg(unix)]
fn apart(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;
    command.process_group(0);
}

/// Leaves the ended process a zombie: until [`Group::end`], its ID is that of its group and of no other process.
#[cfg(unix)]
fn has_ended(child: &mut Child) -> bool {
    use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    matches!(waitid(WaitId::Pid(Pid::from_child(child)), options), Ok(Some(_)))
}

#[cfg(unix)]
fn kill_group(id: u32) {
    use rustix::process::{Pid, Signal, kill_process_group};
    if let Some(group) = i32::try_from(id).ok().and_then(Pid::from_raw) {
        let _ = kill_process_group(group, Signal::KILL);
    }
}

#[cfg(windows)]
fn apart(command: &mut Command) {
    use std::os::windows::process::CommandExt as _;
    const CREATE_NEW_PROCESS_GROUP: u32 = 0x200;
    command.creation_flags(CREATE_NEW_PROCESS_GROUP);
}

/// The open handle of the process keeps its ID.
#[cfg(windows)]
fn has_ended(child: &mut Child) -> bool {
    child.try_wait().is_ok_and(|status| status.is_some())
}

/// Ends a process and the tree of its children. Children whose parent has ended are unknown to Windows, and go on.
#[cfg(windows)]
fn kill_group(id: u32) {
    use std::process::Stdio;
    let mut command = Command::new("taskkill");
    command.args(["/T", "/F", "/PID", &id.to_string()]);
    let _ = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
}
