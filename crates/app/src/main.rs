//! The program `umbra`.

use std::io::Write as _;

fn main() -> anyhow::Result<()> {
    writeln!(std::io::stdout(), "umbra {}", env!("CARGO_PKG_VERSION"))?;
    Ok(())
}
