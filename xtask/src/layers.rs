//! Which crate of the workspace may import which. A new arrow is a new entry here, made on purpose.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::Value;

use crate::sources;
use crate::workspace::{list, metadata};

/// Each crate with those of ours that it may import, lowest first.
const LAYERS: &[(&str, &[&str])] = &[
    ("pf-core", &[]),
    ("bme", &[]),
    ("body", &[]),
    ("render-gpu", &[]),
    ("silhouette", &[]),
    ("biosig", &["body", "bme"]),
    ("app", &["pf-core", "bme", "body", "render-gpu", "silhouette", "biosig"]),
    ("xtask", &[]),
];

/// Everything that breaks the layers or the rules on sources; empty when all is well.
pub fn check() -> Result<Vec<String>> {
    let workspace = metadata(&["--no-deps"])?;
    let mut findings = arrows(&workspace);
    for package in list(&workspace, "packages") {
        findings.extend(manifest(package)?);
    }
    findings.extend(sources::check()?);
    Ok(findings)
}

/// Imports that [`LAYERS`] does not allow, of dependencies of any kind, those of tests included.
fn arrows(workspace: &Value) -> Vec<String> {
    let mut findings = Vec::new();
    for package in list(workspace, "packages") {
        let name = package["name"].as_str().unwrap_or_default();
        let Some((_, allowed)) = LAYERS.iter().find(|(layer, _)| *layer == name) else {
            findings.push(format!("{name}: not in the table of layers"));
            continue;
        };
        let ours = list(package, "dependencies").iter().filter(|dependency| dependency["path"].is_string());
        for dependency in ours.filter_map(|dependency| dependency["name"].as_str()) {
            // A crate's tests may depend on the crate itself, to turn on a feature.
            if dependency != name && !allowed.contains(&dependency) {
                findings.push(format!("{name}: imports {dependency}, but may import only {allowed:?}"));
            }
        }
    }
    findings
}

/// What every manifest of ours must say: the workspace's lints and licence, and that it is not for a registry.
fn manifest(package: &Value) -> Result<Vec<String>> {
    let path = Path::new(package["manifest_path"].as_str().context("cargo metadata: no `manifest_path`")?);
    let text =
        fs::read_to_string(path).with_context(|| format!("{}: cannot read the file", path.display()))?;
    let manifest: toml::Table = text.parse().with_context(|| format!("{}: not TOML", path.display()))?;
    let inherits = |table: Option<&toml::Value>| {
        table.and_then(|table| table.get("workspace")).and_then(toml::Value::as_bool) == Some(true)
    };
    let in_package = |key: &str| manifest.get("package").and_then(|package| package.get(key));
    let keys = [
        ("lints", manifest.get("lints")),
        ("package.version", in_package("version")),
        ("package.edition", in_package("edition")),
        ("package.rust-version", in_package("rust-version")),
        ("package.license", in_package("license")),
        ("package.publish", in_package("publish")),
    ];
    let missing = keys.into_iter().filter(|(_, value)| !inherits(*value));
    Ok(missing.map(|(key, _)| format!("{}: `{key}` is not the workspace's", path.display())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_workspace_keeps_its_layers() {
        let findings = check().expect("the workspace can be read");
        assert!(findings.is_empty(), "{}", findings.join("\n"));
    }

    #[test]
    fn a_forbidden_arrow_is_found() {
        let workspace = json!({ "packages": [
            { "name": "biosig", "dependencies": [{ "name": "body", "path": "/crates/body" }, { "name": "serde" }] },
            { "name": "body", "dependencies": [{ "name": "body", "path": "/crates/body", "kind": "dev" }] },
            { "name": "pf-core", "dependencies": [{ "name": "body", "path": "/crates/body", "kind": "dev" }] },
            { "name": "pets", "dependencies": [] },
        ]});
        assert_eq!(
            arrows(&workspace),
            ["pf-core: imports body, but may import only []", "pets: not in the table of layers"]
        );
    }

    #[test]
    fn the_table_lists_lower_crates_first() {
        for (index, (name, allowed)) in LAYERS.iter().enumerate() {
            for import in *allowed {
                let below = LAYERS[..index].iter().any(|(lower, _)| lower == import);
                assert!(below, "{name} imports {import}, which does not stand below it");
            }
        }
    }
}
