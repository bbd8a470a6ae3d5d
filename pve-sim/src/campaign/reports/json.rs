//! Results as one JSON document: the manifest, and each row with its cells.

use std::io::{self, Write};

use crate::campaign::manifest::Manifest;
use crate::campaign::results::Row;

pub(super) fn write(out: &mut dyn Write, manifest: &Manifest, rows: &mut dyn Iterator<Item = Row>) -> io::Result<()> {
    write!(out, "{{\"manifest\":{},\"rows\":[", serde_json::to_string(manifest)?)?;
    for (place, row) in rows.enumerate() {
        let comma = if place > 0 { "," } else { "" };
        write!(out, "{comma}\n{}", serde_json::to_string(&row)?)?;
    }
    writeln!(out, "\n]}}")
}
