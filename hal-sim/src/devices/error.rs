//! Errors in a set of devices and links.

/// The reason why devices cannot share a bus, or cannot be linked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DevicesError {
    /// Two devices have the same name.
    #[error("duplicate device name '{0}'; give each device its own")]
    DuplicateName(String),
    /// Two devices have the same node ID or the same address.
    #[error("{first} and {second} both have {id_name} 0x{id:02X}; give each its own")]
    Clash {
        /// The name of the first device.
        first: String,
        /// The name of the second device.
        second: String,
        /// The term for the number: node ID or address.
        id_name: &'static str,
        /// The node ID or address.
        id: u8,
    },
    /// A link refers to a device that is not on the bus.
    #[error("no {product} '{name}' on the bus; {}", remedy(known))]
    UnknownDevice {
        /// The expected product: valve or angle sensor.
        product: &'static str,
        /// The name that the link refers to.
        name: String,
        /// The names of the devices of the expected product.
        known: Vec<String>,
    },
    /// Two links have the same sensor.
    #[error("{0} is linked twice; a sensor follows one valve only")]
    LinkedTwice(String),
}

fn remedy(known: &[String]) -> String {
    if known.is_empty() { "add one".to_owned() } else { format!("accepted: {}", known.join(", ")) }
}
