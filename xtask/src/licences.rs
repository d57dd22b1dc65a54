//! `deny.toml` without an install: bans and sources against the lock file, licences against `cargo metadata`.
//!
//! cargo-deny reads the same file and sees more: the texts of licences, all features, all platforms.

use std::fs;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde_json::Value;
use toml::Table;

use crate::spdx;
use crate::workspace::{list, metadata, root};

/// Everything in the dependency tree that `deny.toml` does not allow; empty when all is well.
pub fn check() -> Result<Vec<String>> {
    let deny = read_toml("deny.toml")?;
    let lock = read_toml("Cargo.lock")?;
    let host = host_platform()?;
    // Packages for other platforms need not be in the local cache, so their manifests cannot be read.
    let packages = metadata(&["--filter-platform", &host])?;
    let mut findings = licences(&deny, &packages)?;
    findings.extend(bans(&deny, &lock)?);
    findings.extend(sources(&deny, &lock)?);
    Ok(findings)
}

/// Packages that cannot be used under the licences of `licenses.allow`.
fn licences(deny: &Table, packages: &Value) -> Result<Vec<String>> {
    let allowed = strings(deny, "licenses", "allow")?;
    let mut findings = Vec::new();
    for package in list(packages, "packages") {
        let (name, version) = (as_str(package, "name"), as_str(package, "version"));
        let Some(licence) = package["license"].as_str() else {
            findings.push(format!("{name} {version}: states no licence"));
            continue;
        };
        if !spdx::is_met(licence, &allowed).with_context(|| format!("{name} {version}: `license`"))? {
            findings.push(format!("{name} {version}: licence `{licence}` is not allowed by deny.toml"));
        }
    }
    Ok(findings)
}

/// Packages of the lock file that `bans.deny` names, unless all that depend on them are its `wrappers`.
fn bans(deny: &Table, lock: &Table) -> Result<Vec<String>> {
    let banned = deny.get("bans").and_then(|bans| bans.get("deny")).and_then(toml::Value::as_array);
    let banned = banned.context("deny.toml: `bans.deny` is not an array")?;
    let mut findings = Vec::new();
    for ban in banned {
        let text = |key: &str| {
            ban.get(key)
                .and_then(toml::Value::as_str)
                .with_context(|| format!("deny.toml: `bans.deny`: no `{key}`"))
        };
        let (name, reason) = (text("crate")?, text("reason")?);
        if !locked(lock)?.iter().any(|package| name_of(package) == name) {
            continue;
        }
        let wrappers: Vec<&str> = ban
            .get("wrappers")
            .and_then(toml::Value::as_array)
            .map_or_else(Vec::new, |wrappers| wrappers.iter().filter_map(toml::Value::as_str).collect());
        if wrappers.is_empty() {
            findings.push(format!("{name}: banned, {reason}"));
        }
        for user in locked(lock)?.iter().filter(|package| depends_on(package, name)) {
            if !wrappers.contains(&name_of(user)) {
                findings.push(format!("{}: depends on {name}, which is banned: {reason}", name_of(user)));
            }
        }
    }
    Ok(findings)
}

/// Packages of the lock file that come from elsewhere than `sources.allow-registry`. Our own have no source.
fn sources(deny: &Table, lock: &Table) -> Result<Vec<String>> {
    let registries = strings(deny, "sources", "allow-registry")?;
    let mut findings = Vec::new();
    for package in locked(lock)? {
        let Some(source) = package.get("source").and_then(toml::Value::as_str) else {
            continue;
        };
        let known =
            source.strip_prefix("registry+").is_some_and(|url| registries.iter().any(|ours| ours == url));
        if !known {
            findings
                .push(format!("{}: comes from {source}, which deny.toml does not allow", name_of(package)));
        }
    }
    Ok(findings)
}

fn read_toml(name: &str) -> Result<Table> {
    let path = root().join(name);
    let text =
        fs::read_to_string(&path).with_context(|| format!("{}: cannot read the file", path.display()))?;
    text.parse().with_context(|| format!("{}: not TOML", path.display()))
}

fn strings(deny: &Table, table: &str, key: &str) -> Result<Vec<String>> {
    let values = deny.get(table).and_then(|table| table.get(key)).and_then(toml::Value::as_array);
    let values = values.with_context(|| format!("deny.toml: `{table}.{key}` is not an array"))?;
    Ok(values.iter().filter_map(toml::Value::as_str).map(str::to_owned).collect())
}

fn locked(lock: &Table) -> Result<&[toml::Value]> {
    let packages = lock.get("package").and_then(toml::Value::as_array);
    packages.map(Vec::as_slice).context("Cargo.lock: no `package`")
}

fn name_of(package: &toml::Value) -> &str {
    package.get("name").and_then(toml::Value::as_str).unwrap_or_default()
}

/// Cargo.lock writes a dependency as `name`, or `name version` where several versions are locked.
fn depends_on(package: &toml::Value, name: &str) -> bool {
    let dependencies = package.get("dependencies").and_then(toml::Value::as_array);
    dependencies.is_some_and(|all| {
        all.iter().filter_map(toml::Value::as_str).any(|one| one.split(' ').next() == Some(name))
    })
}

fn as_str<'a>(package: &'a Value, key: &str) -> &'a str {
    package[key].as_str().unwrap_or_default()
}

fn host_platform() -> Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output =
        Command::new(rustc).args(["--print", "host-tuple"]).output().context("cannot start rustc")?;
    ensure!(output.status.success(), "rustc: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(String::from_utf8(output.stdout).context("rustc: not UTF-8")?.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn deny() -> Table {
        read_toml("deny.toml").expect("deny.toml can be read")
    }

    fn lock(text: &str) -> Table {
        text.parse().expect("the lock file of the test is TOML")
    }

    #[test]
    fn the_workspace_depends_on_nothing_denied() {
        let findings = check().expect("the workspace can be read");
        assert!(findings.is_empty(), "{}", findings.join("\n"));
    }

    #[test]
    fn a_licence_outside_the_list_is_found() {
        let packages = json!({ "packages": [
            { "name": "free", "version": "1.0.0", "license": "MIT OR GPL-3.0-only" },
            { "name": "viral", "version": "2.0.0", "license": "GPL-3.0-only" },
            { "name": "silent", "version": "3.0.0", "license": null },
        ]});
        assert_eq!(
            licences(&deny(), &packages).expect("the licences can be read"),
            [
                "viral 2.0.0: licence `GPL-3.0-only` is not allowed by deny.toml",
                "silent 3.0.0: states no licence",
            ]
        );
    }

    #[test]
    fn a_banned_package_and_its_user_are_found() {
        let lock = lock(
            "[[package]]\nname = \"app\"\ndependencies = [\"reqwest 0.12.1\", \"mcap\"]\n\
             [[package]]\nname = \"body\"\ndependencies = [\"mcap\"]\n\
             [[package]]\nname = \"mcap\"\n[[package]]\nname = \"reqwest\"\n",
        );
        assert_eq!(
            bans(&deny(), &lock).expect("the bans can be read"),
            [
                "reqwest: banned, no network code: measurements of people stay on the machine",
                "app: depends on reqwest, which is banned: no network code: measurements of people stay on the machine",
                "body: depends on mcap, which is banned: only the application writes run folders",
            ]
        );
    }

    #[test]
    fn a_foreign_source_is_found() {
        let lock = lock(
            "[[package]]\nname = \"ours\"\n\
             [[package]]\nname = \"usual\"\nsource = \"registry+https://github.com/rust-lang/crates.io-index\"\n\
             [[package]]\nname = \"fork\"\nsource = \"git+https://example.org/fork#abc\"\n",
        );
        assert_eq!(
            sources(&deny(), &lock).expect("the sources can be read"),
            ["fork: comes from git+https://example.org/fork#abc, which deny.toml does not allow"]
        );
    }
}
