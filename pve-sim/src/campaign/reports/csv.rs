//! Results as comma-separated values (RFC 4180), with one line for each cell.

use std::io::{self, Write};

use crate::campaign::manifest::Manifest;
use crate::campaign::results::{Cell, Row};

/// The columns; docs/campaigns.md gives their meanings.
const COLUMNS: &str = "row,cell,refined,fault,reference,seed,at_us,verdict,passed,detected_us,safe_us,reaction_us,struck,\
                       version,commit,plan,plan_hash,machine";

pub(super) fn write(out: &mut dyn Write, manifest: &Manifest, rows: &mut dyn Iterator<Item = Row>) -> io::Result<()> {
    let Manifest { version, commit, plan, plan_hash, machine, .. } = manifest;
    // The values of the last columns, which are the same in each line.
    let common = [version, commit.as_deref().unwrap_or_default(), plan, plan_hash, machine].map(field).join(",");
    let number = |number: Option<u64>| number.map_or_else(String::new, |number| number.to_string());
    write!(out, "{COLUMNS}\r\n")?;
    for Row { row, fault, reference, seed, cells, .. } in rows {
        let fault = [fault.as_str(), reference.as_deref().unwrap_or_default()].map(field).join(",");
        for Cell { number: cell, at_us, verdict, detected_us, safe_us, struck } in cells {
            let (refined, passed) = (cell.is_none(), verdict.passed());
            let times = [detected_us, safe_us, detected_us.max(safe_us)].map(number).join(",");
            let cell = number(cell);
            write!(
                out,
                "{row},{cell},{refined},{fault},{seed},{at_us},{verdict},{passed},{times},{struck},{common}\r\n"
            )?;
        }
    }
    Ok(())
}

/// Quotes a field if it needs quotes.
fn field(text: &str) -> String {
    if text.contains(['"', ',', '\r', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
