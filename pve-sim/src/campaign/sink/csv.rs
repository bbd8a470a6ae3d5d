//! Results as comma-separated values (RFC 4180), with one line for each cell.

use std::io::{self, Write};

use super::Sink;
use crate::campaign::manifest::Manifest;
use crate::campaign::results::{Cell, Row};

/// The columns; docs/campaigns.md gives their meanings.
const COLUMNS: &str = "row,cell,refined,fault,reference,seed,at_us,verdict,passed,detected_us,safe_us,reaction_us,struck,\
                       version,commit,plan,plan_hash,machine";

pub(super) struct Csv<W> {
    out: W,
    /// The values of the last columns, which are the same in each line.
    common: String,
}

impl<W: Write> Csv<W> {
    pub(super) fn new(mut out: W, manifest: &Manifest) -> io::Result<Self> {
        write!(out, "{COLUMNS}\r\n")?;
        let Manifest { version, commit, plan, plan_hash, machine, .. } = manifest;
        let common = [version, commit.as_deref().unwrap_or_default(), plan, plan_hash, machine].map(field).join(",");
        Ok(Self { out, common })
    }
}

/// Quotes a field if it needs quotes.
fn field(text: &str) -> String {
    if text.contains(['"', ',', '\r', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

impl<W: Write> Sink for Csv<W> {
    fn row(&mut self, row: &Row) -> io::Result<()> {
        let head = &row.head;
        let fault = [head.fault.as_str(), head.reference.as_deref().unwrap_or_default()].map(field).join(",");
        let number = |number: Option<u64>| number.map_or_else(String::new, |number| number.to_string());
        for cell in &row.cells {
            let Cell { at_us, verdict, detected_us, safe_us, struck, .. } = *cell;
            let (refined, passed) = (cell.number.is_none(), verdict.passed());
            let times = [detected_us, safe_us, detected_us.max(safe_us)].map(number).join(",");
            let cell = number(cell.number);
            write!(
                self.out,
                "{},{cell},{refined},{fault},{},{at_us},{verdict},{passed},{times},{struck},{}\r\n",
                head.row, head.seed, self.common
            )?;
        }
        Ok(())
    }

    fn end(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
