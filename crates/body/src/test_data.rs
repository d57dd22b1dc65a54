//! Where tests find the research data, which are not part of the repository.

use std::path::PathBuf;

/// The folder named by `UMBRA_DATA`, else `shared/data` beside the repository; `None`, after a line that says so, where
/// there is none.
///
/// # Panics
/// When there is none although `UMBRA_REQUIRE_DATA` is 1.
pub(crate) fn folder() -> Option<PathBuf> {
    let default = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("UMBRA_DATA").map_or_else(default, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(
        std::env::var_os("UMBRA_REQUIRE_DATA").is_none_or(|value| value != "1"),
        "{}: no data folder, and UMBRA_REQUIRE_DATA is 1",
        folder.display()
    );
    println!("SKIPPED: no data folder");
    None
}
