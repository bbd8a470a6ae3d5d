//! The URL of a kernel interface, and an example command for joining.

use crate::gateway::{Parse, Scheme};

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme = Scheme { prefix: "socketcan:", form: "socketcan:IFACE", parse: PARSE };

#[cfg(not(target_os = "linux"))]
const PARSE: Parse = Parse::OnlyOn("Linux");
#[cfg(target_os = "linux")]
const PARSE: Parse = Parse::With(linux::parse);

#[cfg(target_os = "linux")]
mod linux {
    use std::sync::Arc;
    use std::{fmt, io};

    use rustix::io::Errno;
    use tokio::sync::Semaphore;

    use crate::gateway::member::Member;
    use crate::gateway::socketcan::interface::Interface;
    use crate::gateway::{Access, Address, Gateway, OpenError, Opening};
    use crate::inbox::WorldSender;

    /// The maximum length of a Linux interface name, in characters.
    const NAME_MAX: usize = 15;

    /// The name of an interface; opening checks whether the interface exists.
    #[derive(Clone, Debug)]
    struct InterfaceName(String);

    pub(super) fn parse(name: &str) -> Result<Arc<dyn Address>, String> {
        let allowed = |c: char| c.is_ascii_graphic() && c != '/' && c != ':';
        if name.is_empty() || name.len() > NAME_MAX || !name.chars().all(allowed) {
            return Err(format!(
                "'{name}' is not a valid interface name; accepted: 1–{NAME_MAX} characters, as in vcan0"
            ));
        }
        Ok(Arc::new(InterfaceName(name.to_owned())))
    }

    impl fmt::Display for InterfaceName {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "socketcan:{}", self.0)
        }
    }

    impl Address for InterfaceName {
        fn name(&self) -> &str {
            &self.0
        }

        fn is_real_time(&self) -> bool {
            true
        }

        fn is_shared(&self) -> bool {
            true
        }

        fn may_be_real(&self) -> bool {
            true
        }

        fn open(&self, _: Access) -> Opening<'_> {
            Box::pin(async move {
                let interface = Interface::open(&self.0).map_err(|error| refusal(&self.0, &error))?;
                Ok(Box::new(Joined { name: self.clone(), interface }) as Box<dyn Gateway>)
            })
        }
    }

    /// Returns the reason why an interface cannot be opened; for an unknown interface, with a remedy.
    fn refusal(name: &str, error: &io::Error) -> OpenError {
        let is_missing = Errno::from_io_error(error) == Some(Errno::NODEV);
        let way_out = format!("; 'ip link' lists the interfaces, 'ip link add {name} up type vcan' adds a virtual one");
        OpenError::new(format!("{error}{}", if is_missing { &way_out } else { "" }))
    }

    /// An open interface.
    struct Joined {
        name: InterfaceName,
        interface: Interface,
    }

    impl Gateway for Joined {
        fn url(&self) -> String {
            self.name.to_string()
        }

        fn hint(&self) -> String {
            let InterfaceName(name) = &self.name;
            format!(
                "Join the bus with any SocketCAN tool:\n  candump {name}\n  \
                 can.Bus(interface=\"socketcan\", channel=\"{name}\")"
            )
        }

        fn start(self: Box<Self>, world: WorldSender, _: Arc<Semaphore>) {
            tokio::spawn(self.interface.run(world));
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn an_interface_that_is_not_there_names_the_way_out() {
            let told = |errno: Errno| refusal("can0", &errno.into()).to_string();
            let missing = told(Errno::NODEV);
            assert!(missing.starts_with("No such device"), "{missing}");
            let way_out = "; 'ip link' lists the interfaces, 'ip link add can0 up type vcan' adds a virtual one";
            assert!(missing.ends_with(way_out), "{missing}");
            assert!(!told(Errno::ACCESS).contains("ip link"));
        }
    }
}
