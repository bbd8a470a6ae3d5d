//! The DBC of an ISOBUS product: its messages at each possible address.

use std::fmt::Write as _;

use protocol_core::device::Protocol;
use protocol_core::wire::j1939_id::Address;

use super::layout::{Message, Role, Signal, commanded_address, messages};
use super::product::Product;
use crate::Kind;

/// The flag of a 29-bit identifier in a DBC.
const EXTENDED: u32 = 1 << 31;

/// The node that sends commands.
const MASTER: &str = "Master";

/// The DBC placeholder for an unnamed node.
const ANYBODY: &str = "Vector__XXX";

/// Generates the DBC of a product, in ASCII; `None` for a kind without ISOBUS.
#[must_use]
pub fn dbc(kind: Kind) -> Option<String> {
    if kind.protocol() != Protocol::Isobus {
        return None;
    }
    let mut database = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut database, kind);
    Some(database)
}

fn write(out: &mut String, kind: Kind) -> std::fmt::Result {
    let Product { vendor, name, .. } = Product::of(kind);
    let addresses: Vec<u8> = kind.node_ids().collect();
    let nodes: Vec<String> = addresses.iter().map(|address| node(*address)).collect();
    let mut all = vec![(commanded_address(), ANYBODY.to_owned())];
    for address in addresses {
        all.extend(messages(Address::new(address)).into_iter().map(|message| (message, node(address))));
    }

    writeln!(out, "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: {MASTER} {}\n", nodes.join(" "))?;
    for (message, valve) in &all {
        write_message(out, message, valve)?;
    }
    writeln!(out, "CM_ \"{vendor} {name} on ISOBUS, written by pve-sim\";")?;
    for (message, _) in &all {
        writeln!(out, "CM_ BO_ {} \"{}\";", id(message), message.comment)?;
    }
    writeln!(out, "BA_DEF_ \"BusType\" STRING ;\nBA_DEF_ \"ProtocolType\" STRING ;")?;
    writeln!(out, "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\",\"reserved\",\"J1939PG\";")?;
    writeln!(out, "BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;")?;
    writeln!(out, "BA_DEF_DEF_ \"BusType\" \"CAN\";\nBA_DEF_DEF_ \"ProtocolType\" \"J1939\";")?;
    writeln!(out, "BA_DEF_DEF_ \"VFrameFormat\" \"J1939PG\";\nBA_DEF_DEF_ \"GenMsgCycleTime\" 0;")?;
    writeln!(out, "BA_ \"BusType\" \"CAN\";\nBA_ \"ProtocolType\" \"J1939\";")?;
    for (message, _) in &all {
        writeln!(out, "BA_ \"VFrameFormat\" BO_ {} 3;", id(message))?;
        if let Some(cycle) = message.cycle_ms {
            writeln!(out, "BA_ \"GenMsgCycleTime\" BO_ {} {cycle};", id(message))?;
        }
    }
    for (message, _) in &all {
        for Signal { name, values, .. } in message.signals.iter().filter(|signal| !signal.values.is_empty()) {
            write!(out, "VAL_ {} {name}", id(message))?;
            for (value, text) in values {
                write!(out, " {value} \"{text}\"")?;
            }
            writeln!(out, " ;")?;
        }
    }
    Ok(())
}

fn node(address: u8) -> String {
    format!("Valve_{address:02X}")
}

fn id(message: &Message) -> u32 {
    EXTENDED | message.id.raw()
}

fn write_message(out: &mut String, message: &Message, valve: &str) -> std::fmt::Result {
    let Message { name, len, from_valve, signals, .. } = message;
    let (sender, receiver) = if *from_valve { (valve, MASTER) } else { (MASTER, valve) };
    writeln!(out, "BO_ {} {name}: {len} {sender}", id(message))?;
    for Signal { name, role, bits: (first, len), factor, offset, range, unit, .. } in signals {
        let multiplexed = match role {
            Role::Plain => String::new(),
            Role::Selector => "M ".to_owned(),
            Role::Selected(value) => format!("m{value} "),
        };
        let (min, max) = (range.start(), range.end());
        writeln!(
            out,
            " SG_ {name} {multiplexed}: {first}|{len}@1+ ({factor},{offset}) [{min}|{max}] \"{unit}\" {receiver}"
        )?;
    }
    writeln!(out)
}

#[cfg(test)]
#[path = "dbc_tests.rs"]
mod tests;
