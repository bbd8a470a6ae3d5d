//! The settings of the board, such as its kind of device. The memory holds them beside the records of the device.

use protocol_core::device::{Kind, Setup, pve};

/// The length of the encoded settings, in bytes.
pub const LEN: usize = 7;

/// The version of the encoding.
const VERSION: u8 = 1;

const BLANK: u8 = 1;
const FRESH: u8 = 2;
const CHOSEN: u8 = 4;
const SERIAL: u8 = 8;

/// The settings of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The kind of device.
    pub kind: Kind,
    /// True if a device with a new memory has no node ID. A device on ISOBUS always has an address.
    pub blank: bool,
    /// Whether the memory still holds the records of the previous device, which must be removed.
    pub fresh: bool,
    /// True if the console has chosen the kind. Otherwise the board takes the kind of the image, even after an update.
    pub chosen: bool,
    /// The serial number for a new memory; `None` for the default that all boards share.
    pub serial: Option<u32>,
}

impl Settings {
    /// The settings of a new board, with the kind of the image.
    pub const DEFAULT: Self = Self { kind: DEFAULT_KIND, blank: false, fresh: false, chosen: false, serial: None };

    /// Returns the settings at a start. If the kinds of image and board differ, the board becomes a new device, unless
    /// the console has chosen its kind.
    #[must_use]
    pub fn at_start(stored: Option<Self>) -> Self {
        match stored {
            None => Self::DEFAULT,
            Some(stored) if stored.chosen || stored.kind == DEFAULT_KIND => stored,
            Some(_) => Self { fresh: true, ..Self::DEFAULT },
        }
    }

    /// Returns the settings for a new device of this kind, chosen at the console.
    #[must_use]
    pub const fn new(kind: Kind, serial: Option<u32>) -> Self {
        Self { kind, blank: false, fresh: true, chosen: true, serial }
    }

    /// Returns the settings for a new device of the same kind without a node ID; `None` for a kind that always has an
    /// address. The serial number stays unless another one is given.
    #[must_use]
    pub fn blank(self, serial: Option<u32>) -> Option<Self> {
        self.kind.can_be_blank().then(|| Self { blank: true, fresh: true, serial: serial.or(self.serial), ..self })
    }

    /// Returns the device setup for a new memory.
    #[must_use]
    pub fn setup(&self) -> Setup {
        let setup = Setup { serial: self.serial, ..Setup::new(self.kind) };
        if self.blank { Setup { node_id: None, ..setup } } else { setup }
    }

    /// Encodes the settings.
    #[must_use]
    pub fn encode(&self) -> [u8; LEN] {
        let flag = |set: bool, bit: u8| if set { bit } else { 0 };
        let flags = flag(self.blank, BLANK)
            | flag(self.fresh, FRESH)
            | flag(self.chosen, CHOSEN)
            | flag(self.serial.is_some(), SERIAL);
        let [a, b, c, d] = self.serial.unwrap_or(0).to_le_bytes();
        [VERSION, self.kind.number() - FIRST, flags, a, b, c, d]
    }

    /// Decodes settings; `None` if they are invalid or have another version.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let &[VERSION, kind, flags, a, b, c, d] = bytes else { return None };
        let kind = Kind::from_number(kind.checked_add(FIRST)?)?;
        let is_set = |bit: u8| flags & bit != 0;
        let serial = is_set(SERIAL).then_some(u32::from_le_bytes([a, b, c, d]));
        let settings = Self { kind, blank: is_set(BLANK), fresh: is_set(FRESH), chosen: is_set(CHOSEN), serial };
        (!is_set(!(BLANK | FRESH | CHOSEN | SERIAL))).then_some(settings)
    }
}

/// The difference between the [number](Kind::number) of a kind, which counts from 1, and the stored number, which
/// counts from 0.
const FIRST: u8 = 1;

/// The kind of the image, from `PVE_KIND` at build time.
const DEFAULT_KIND: Kind = match option_env!("PVE_KIND") {
    None => Kind::Pve(pve::Kind::PveaCanopen),
    Some(name) => named(name),
};

/// Returns the kind with this name, at build time.
const fn named(name: &str) -> Kind {
    let mut i = 0;
    while i < Kind::ALL.len() {
        if is_equal(Kind::ALL[i].name().as_bytes(), name.as_bytes()) {
            return Kind::ALL[i];
        }
        i += 1;
    }
    panic!("PVE_KIND must be one of pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus, hat1000 and hat3000");
}

const fn is_equal(left: &[u8], right: &[u8]) -> bool {
    let mut i = 0;
    while i < left.len() && i < right.len() && left[i] == right[i] {
        i += 1;
    }
    i == left.len() && i == right.len()
}

#[cfg(test)]
mod tests {
    use protocol_core::device::hat;

    use super::*;

    const CANOPEN: Kind = Kind::Pve(pve::Kind::PveoCanopen);
    const ISOBUS: Kind = Kind::Pve(pve::Kind::PveaIsobus);
    const SENSOR: Kind = Kind::Hat(hat::Kind::Hat3000);

    #[test]
    fn what_was_encoded_decodes() {
        for kind in Kind::ALL {
            assert_eq!(named(kind.name()), kind);
            for flags in 0..16 {
                let [blank, fresh, chosen, numbered] = [1, 2, 4, 8].map(|flag| flags & flag != 0);
                let settings = Settings { kind, blank, fresh, chosen, serial: numbered.then_some(0x1234_5678) };
                assert_eq!(Settings::decode(&settings.encode()), Some(settings));
            }
        }
    }

    #[test]
    fn kinds_are_stored_from_0_on() {
        let names = ["pvea-canopen", "pveo-canopen", "pvea-isobus", "pveo-isobus", "hat1000", "hat3000"];
        for (stored, name) in (0..).zip(names) {
            let bytes = Settings::new(named(name), None).encode();
            assert_eq!(bytes, [1, stored, 6, 0, 0, 0, 0], "{name}");
        }
    }

    #[test]
    fn what_is_none_does_not() {
        for bytes in [
            &[][..],
            &[1, 0, 0],
            &[2, 0, 0, 0, 0, 0, 0],
            &[1, 6, 0, 0, 0, 0, 0],
            &[1, 255, 0, 0, 0, 0, 0],
            &[1, 0, 16, 0, 0, 0, 0],
            &[0; 8],
        ] {
            assert_eq!(Settings::decode(bytes), None, "{bytes:?}");
        }
    }

    #[test]
    fn another_image_makes_a_new_device_unless_the_kind_was_chosen() {
        let other = Kind::ALL.into_iter().find(|kind| *kind != DEFAULT_KIND).unwrap();
        assert_eq!(Settings::at_start(None), Settings::DEFAULT);
        let chosen = Settings::new(CANOPEN, None);
        for stored in [Settings::DEFAULT, Settings::new(other, Some(7)), chosen.blank(None).unwrap()] {
            assert_eq!(Settings::at_start(Some(stored)), stored);
        }
        let of_another_image = Settings { kind: other, ..Settings::DEFAULT };
        for stored in [Some(of_another_image), of_another_image.blank(None)] {
            assert_eq!(Settings::at_start(stored), Settings { fresh: true, ..Settings::DEFAULT });
        }
    }

    #[test]
    fn a_blank_device_keeps_its_serial_number_unless_it_gets_another() {
        for (before, given, serial) in
            [(None, None, None), (None, Some(8), Some(8)), (Some(7), None, Some(7)), (Some(7), Some(8), Some(8))]
        {
            let blank = Settings::new(CANOPEN, before).blank(given).unwrap();
            assert_eq!(blank, Settings { blank: true, ..Settings::new(CANOPEN, serial) });
            assert_eq!(blank.blank(None), Some(blank));
        }
    }

    #[test]
    fn a_blank_device_has_no_node_id() {
        for kind in [CANOPEN, SENSOR] {
            assert_eq!(Settings::new(kind, None).blank(None).unwrap().setup().node_id, None);
        }
        assert_eq!(Settings::new(ISOBUS, None).blank(None), None);
        assert_eq!(Settings::new(ISOBUS, Some(7)).setup().serial, Some(7));
        assert_eq!(Settings::DEFAULT.setup(), Setup::new(Settings::DEFAULT.kind));
    }
}
