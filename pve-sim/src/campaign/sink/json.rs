//! Results as one JSON document: the manifest, and each row with its cells.

use std::io::{self, Write};

use super::Sink;
use crate::campaign::manifest::Manifest;
use crate::campaign::results::Row;

pub(super) struct Json<W> {
    out: W,
    is_first: bool,
}

impl<W: Write> Json<W> {
    pub(super) fn new(mut out: W, manifest: &Manifest) -> io::Result<Self> {
        write!(out, "{{\"manifest\":{},\"rows\":[", serde_json::to_string(manifest)?)?;
        Ok(Self { out, is_first: true })
    }
}

impl<W: Write> Sink for Json<W> {
    fn row(&mut self, row: &Row) -> io::Result<()> {
        let mut value = serde_json::to_value(&row.head)?;
        value["cells"] = serde_json::to_value(&row.cells)?;
        let comma = if std::mem::take(&mut self.is_first) { "" } else { "," };
        write!(self.out, "{comma}\n{value}")
    }

    fn end(&mut self) -> io::Result<()> {
        writeln!(self.out, "\n]}}")?;
        self.out.flush()
    }
}
