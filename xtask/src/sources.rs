//! Rules on source files that the compiler and clippy cannot check: what a layer may touch, sizes, first lines, papers.
//!
//! Files are read as tokens, so that comments and strings may say what code must not. Code of tests is free.

use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use proc_macro2::{Delimiter, TokenStream, TokenTree};

use crate::workspace::root;

/// Lines of a file, its tests not counted.
const MAX_FILE_LINES: usize = 600;
/// A `lib.rs` holds documentation, `mod` lines and re-exports.
const MAX_LIB_LINES: usize = 120;

/// Words that code must not use, outside the places that may.
struct Rule {
    /// `word` is an identifier, `word!` a macro.
    words: &'static [&'static str],
    /// Beginnings of paths, from the root of the workspace.
    except_in: &'static [&'static str],
    reason: &'static str,
}

const APP: &str = "crates/app/";
const XTASK: &str = "xtask/";

const RULES: &[Rule] = &[
    Rule {
        words: &["print!", "println!", "eprint!", "eprintln!", "stdin", "stdout", "stderr"],
        except_in: &[APP, XTASK],
        reason: "only `app` talks to a terminal",
    },
    Rule {
        words: &["env", "Command"],
        except_in: &[APP, XTASK],
        reason: "only `app` reads the environment and starts programs",
    },
    Rule {
        words: &["Instant", "SystemTime"],
        except_in: &[APP, XTASK],
        reason: "only `app` reads the clock",
    },
    Rule {
        words: &["fs", "File", "OpenOptions"],
        except_in: &[APP, XTASK, "crates/body/src/io.rs", "crates/body/src/io/"],
        reason: "only `app` and `body::io` open files",
    },
    Rule {
        words: &["TcpStream", "TcpListener", "UdpSocket", "ToSocketAddrs"],
        except_in: &[],
        reason: "measurements of people stay on the machine: there is no network code",
    },
];

/// Every place that breaks a rule; empty when all is well.
pub fn check() -> Result<Vec<String>> {
    let papers = read(&root().join("docs/papers.md"))?;
    let mut files = Vec::new();
    rust_files(&root().join("crates"), &mut files)?;
    rust_files(&root().join("xtask"), &mut files)?;
    files.sort();

    let mut findings = Vec::new();
    for file in files {
        let path = file.strip_prefix(root()).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        findings.extend(check_file(&path, &read(&file)?, &papers)?);
    }
    Ok(findings)
}

/// Checks one file, `path` being relative to the root of the workspace.
fn check_file(path: &str, text: &str, papers: &str) -> Result<Vec<String>> {
    let mut findings = Vec::new();
    // The name `tests.rs` says it.
    if !text.starts_with("//! ") && !path.ends_with("/tests.rs") {
        findings.push(format!("{path}:1: the first line does not say what the file is for (`//! ...`)"));
    }
    // The examples in the tests below cite papers that no one wrote.
    let citations = if path.starts_with(XTASK) { Vec::new() } else { citations(text) };
    for (line, key) in citations {
        if !papers.contains(&format!("| `[{key}]` |")) {
            findings.push(format!("{path}:{line}: `[{key}]` has no row in docs/papers.md"));
        }
    }
    if is_test_file(path) {
        return Ok(findings);
    }

    let tokens: TokenStream = text.parse().map_err(|error| anyhow!("{path}: not Rust: {error}"))?;
    let mut code = Code::default();
    code.read(tokens);
    let test_lines: usize = code.test_items.iter().map(|lines| lines.end() - lines.start() + 1).sum();
    let lines = text.lines().count() - test_lines;
    let max_lines = if path.ends_with("src/lib.rs") { MAX_LIB_LINES } else { MAX_FILE_LINES };
    if lines > max_lines {
        findings.push(format!("{path}: {lines} lines without tests, more than {max_lines}"));
    }
    for (line, word) in code.words {
        let broken = |rule: &&Rule| {
            rule.words.contains(&word.as_str()) && !rule.except_in.iter().any(|place| path.starts_with(place))
        };
        if let Some(rule) = RULES.iter().find(broken) {
            findings.push(format!("{path}:{line}: `{word}`: {}", rule.reason));
        }
    }
    Ok(findings)
}

/// Whole files of tests, benchmarks and examples, known by their folder or by a name such as `tests.rs`, `test_data.rs`.
fn is_test_file(path: &str) -> bool {
    let is_test_name = |name: &str| {
        ["tests", "benches", "examples"].contains(&name)
            || name.ends_with("tests.rs")
            || name.starts_with("test_")
    };
    path.split('/').any(is_test_name)
}

/// A file as the rules see it: its words, and where its tests are.
#[derive(Default)]
struct Code {
    /// Identifiers outside tests with their lines; names of macros end in `!`.
    words: Vec<(usize, String)>,
    /// Lines of each item under `#[cfg(test)]`.
    test_items: Vec<RangeInclusive<usize>>,
}

impl Code {
    fn read(&mut self, tokens: TokenStream) {
        let mut tokens = tokens.into_iter().peekable();
        while let Some(token) = tokens.next() {
            let line = token.span().start().line;
            match token {
                TokenTree::Punct(punct)
                    if punct.as_char() == '#' && tokens.peek().is_some_and(is_cfg_test) =>
                {
                    // The item ends with its braces, or with a semicolon when it has none.
                    let end = tokens.find(|token| is_braces(token) || token.to_string() == ";");
                    let last_line = end.map_or(line, |end| end.span().end().line);
                    self.test_items.push(line..=last_line);
                }
                TokenTree::Ident(ident) => {
                    let is_macro =
                        matches!(tokens.peek(), Some(TokenTree::Punct(next)) if next.as_char() == '!');
                    self.words.push((line, if is_macro { format!("{ident}!") } else { ident.to_string() }));
                }
                TokenTree::Group(group) => self.read(group.stream()),
                TokenTree::Punct(_) | TokenTree::Literal(_) => {}
            }
        }
    }
}

/// `[cfg(test)]`, `[cfg(any(test, ...))]` and the like.
fn is_cfg_test(token: &TokenTree) -> bool {
    let words = token.to_string().replace(|sign: char| !sign.is_alphanumeric(), " ");
    let mut words = words.split_whitespace();
    words.next() == Some("cfg") && words.any(|word| word == "test")
}

fn is_braces(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace)
}

/// Keys of papers such as `[Deutscher2005]` or `[Mori2006a]`, with their lines.
fn citations(text: &str) -> Vec<(usize, &str)> {
    let keys = |line| bracketed(line).filter(|key| is_paper_key(key));
    text.lines().zip(1..).flat_map(|(line, number)| keys(line).map(move |key| (number, key))).collect()
}

fn bracketed(line: &str) -> impl Iterator<Item = &str> {
    line.split('[').skip(1).filter_map(|rest| rest.split_once(']')).map(|(inside, _)| inside)
}

/// A name with a capital, four digits, and perhaps a letter.
fn is_paper_key(key: &str) -> bool {
    let stem = key.strip_suffix(|last: char| last.is_ascii_lowercase()).unwrap_or(key);
    let name = stem.trim_end_matches(|digit: char| digit.is_ascii_digit());
    stem.len() == name.len() + 4
        && name.starts_with(|first: char| first.is_ascii_uppercase())
        && name.chars().all(char::is_alphabetic)
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let cannot_read = || format!("{}: cannot read the folder", folder.display());
    for entry in fs::read_dir(folder).with_context(cannot_read)? {
        let path = entry.with_context(cannot_read)?.path();
        if path.is_dir() && !path.ends_with("target") {
            rust_files(&path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("{}: cannot read the file", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPERS: &str = "| key |\n|---|\n| `[Tipping2001]` | RVM |\n";

    fn found(path: &str, text: &str) -> Vec<String> {
        check_file(path, text, PAPERS).expect("the text is Rust")
    }

    #[test]
    fn a_file_without_a_purpose_is_found() {
        assert_eq!(
            found("crates/bme/src/rvm.rs", "use std::fmt;\n"),
            ["crates/bme/src/rvm.rs:1: the first line does not say what the file is for (`//! ...`)"]
        );
    }

    #[test]
    fn what_a_layer_must_not_touch_is_found_with_its_line() {
        let text =
            "//! Masks.\n\nfn f() {\n    println!(\"{}\", 1);\n    let t = std::time::Instant::now();\n}\n";
        assert_eq!(
            found("crates/silhouette/src/mask.rs", text),
            [
                "crates/silhouette/src/mask.rs:4: `println!`: only `app` talks to a terminal",
                "crates/silhouette/src/mask.rs:5: `Instant`: only `app` reads the clock",
            ]
        );
        assert!(found("crates/app/src/track.rs", text).is_empty());
    }

    #[test]
    fn only_the_readers_of_body_open_files() {
        let text = "//! Reads meshes.\nuse std::{fs, io};\n";
        assert!(found("crates/body/src/io/obj.rs", text).is_empty());
        assert_eq!(
            found("crates/body/src/mesh.rs", text),
            ["crates/body/src/mesh.rs:2: `fs`: only `app` and `body::io` open files"]
        );
    }

    #[test]
    fn comments_strings_and_tests_may_say_anything() {
        let text = "//! `std::fs` is not used.\n// println!\nconst A: &str = \"Instant\";\nconst B: &str = env!(\"X\");\n\
                    #[cfg(test)]\nmod tests {\n    use std::fs;\n}\n#[cfg(test)]\nmod oracle;\n";
        assert!(found("crates/bme/src/rvm.rs", text).is_empty());
        assert!(found("crates/bme/tests/laws.rs", "//! Laws.\nuse std::fs;\n").is_empty());
        let after_tests = format!("{text}use std::fs;\n");
        assert_eq!(found("crates/bme/src/rvm.rs", &after_tests).len(), 1);
    }

    #[test]
    fn long_files_are_found_but_tests_do_not_count() {
        let code = "//! Long.\n".to_owned() + &"const _: u8 = 0;\n".repeat(MAX_LIB_LINES);
        assert_eq!(
            found("crates/bme/src/lib.rs", &code),
            ["crates/bme/src/lib.rs: 121 lines without tests, more than 120"]
        );
        assert!(found("crates/bme/src/rvm.rs", &code).is_empty());
        let longer = code.repeat(5);
        assert_eq!(found("crates/bme/src/rvm.rs", &longer).len(), 1);
        let tested = format!("//! Short.\n#[cfg(test)]\nmod tests {{\n{longer}}}\n");
        assert!(found("crates/bme/src/rvm.rs", &tested).is_empty());
    }

    #[test]
    fn papers_that_are_not_listed_are_found() {
        let text = "//! `[Tipping2001]` eq. (3), `[Nobody1999]`, `[TippingFaul2003b]`.\nconst A: [u8; 2] = [1, 2];\n";
        assert_eq!(
            found("crates/bme/src/rvm.rs", text),
            [
                "crates/bme/src/rvm.rs:1: `[Nobody1999]` has no row in docs/papers.md",
                "crates/bme/src/rvm.rs:1: `[TippingFaul2003b]` has no row in docs/papers.md",
            ]
        );
    }
}
