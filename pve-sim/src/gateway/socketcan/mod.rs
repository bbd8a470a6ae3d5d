//! SocketCAN: a Linux kernel interface as a client of the bus.
//!
//! Frames on the interface, from other programs or from a real bus behind an adapter, enter the world like the frames
//! of any client; all other frames in the world are sent to the interface. The kernel does not echo them back.
//!
//! ```text
//! interface  the socket, and the frames through it
//! health     retries while an interface accepts no frames, and messages to the user. No I/O
//! ```

mod health;
mod interface;

use std::io;

use super::{Gateway, Member as _};
use interface::Interface;

/// Opens the gateway to an interface.
pub(super) fn open(name: &str) -> io::Result<Gateway> {
    let interface = Interface::open(name).map_err(|error| with_remedy(error, name))?;
    let hint = format!(
        "Join the bus with any SocketCAN tool:\n  candump {name}\n  \
         can.Bus(interface=\"socketcan\", channel=\"{name}\")"
    );
    Ok(Gateway::new(format!("socketcan:{name}"), hint, |world, _| interface.run(world)))
}

/// Adds the remedy to the error of a missing interface.
fn with_remedy(error: io::Error, name: &str) -> io::Error {
    if !health::is_gone(&error) {
        return error;
    }
    io::Error::other(format!(
        "{error}; 'ip link' lists the interfaces, and 'ip link add {name} up type vcan' adds a virtual one"
    ))
}

#[cfg(test)]
mod tests {
    use rustix::io::Errno;

    use super::*;

    #[test]
    fn an_interface_that_is_not_there_names_the_way_out() {
        let told = |errno: Errno| with_remedy(errno.into(), "can0").to_string();
        let missing = told(Errno::NODEV);
        assert!(missing.starts_with("No such device"), "{missing}");
        let way_out = "; 'ip link' lists the interfaces, and 'ip link add can0 up type vcan' adds a virtual one";
        assert!(missing.ends_with(way_out), "{missing}");
        assert!(!told(Errno::ACCESS).contains("ip link"));
    }
}
