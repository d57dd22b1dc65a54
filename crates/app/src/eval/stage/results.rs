//! Tables of a Markdown file that the evaluation writes anew, between two lines that mark each.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::ValueEnum as _;

use super::table::{recovery_table, rows_table, updates_table};
use super::{StageEval, StageReport};
use crate::config::Motion;

/// A Markdown file with tables of results.
#[derive(Clone, Debug)]
pub struct ResultsFile {
    /// The file.
    pub path: PathBuf,
    /// The command that stands above its tables.
    pub command: String,
    /// Which of the run's tables go there: kinds of masks, `recovery`, `updates`; all when empty.
    pub tables: Vec<String>,
}

/// The line before a table and the one after it.
fn markers(table: &str) -> [String; 2] {
    [format!("<!-- table: {table} -->"), format!("<!-- end of table: {table} -->")]
}

/// Name of the table of one kind of results, as `stage sequence observed`, or `stage sequence latent observed` of latent poses.
fn table_name(eval: &StageEval, what: &str) -> String {
    let train = eval.train.to_possible_value();
    let poses = if eval.config.motion == Motion::Latent { " latent" } else { "" };
    format!("stage {}{poses} {what}", train.as_ref().map_or("", |train| train.get_name()))
}

/// The tables that an evaluation puts into the file: the kinds of masks, and the studies that were asked for.
fn asked_for<'a>(results: &'a ResultsFile, eval: &'a StageEval) -> anyhow::Result<Vec<&'a str>> {
    let studies = [("recovery", eval.recovery), ("updates", eval.updates)];
    let made = studies.into_iter().filter(|(_, is_made)| *is_made).map(|(what, _)| what);
    let made: Vec<&str> = eval.masks.iter().map(String::as_str).chain(made).collect();
    if results.tables.is_empty() {
        return Ok(made);
    }
    match results.tables.iter().find(|table| !made.contains(&table.as_str())) {
        Some(unknown) => {
            bail!("`tables` has {unknown}, expected some of {}, which this run makes", made.join(", "))
        }
        None => Ok(results.tables.iter().map(String::as_str).collect()),
    }
}

/// Makes sure that the file has a place for every table, before hours are spent on them.
///
/// # Errors
/// When the file cannot be read or a marker is missing.
pub(super) fn check(results: &ResultsFile, eval: &StageEval) -> anyhow::Result<()> {
    let text = read(&results.path)?;
    asked_for(results, eval)?
        .into_iter()
        .try_for_each(|what| replaced(&results.path, &text, &table_name(eval, what), "").map(|_| ()))
}

/// Replaces the tables that the report has by new ones.
///
/// # Errors
/// As [`check`], and when the file cannot be written.
pub(super) fn write(results: &ResultsFile, eval: &StageEval, report: &StageReport) -> anyhow::Result<()> {
    let mut text = read(&results.path)?;
    for what in asked_for(results, eval)? {
        let table = match what {
            "recovery" => recovery_table(report),
            "updates" => updates_table(report),
            kind => rows_table(report, kind),
        };
        let content = format!("```sh\n{}\n```\n\n{table}", results.command);
        text = replaced(&results.path, &text, &table_name(eval, what), &content)?;
    }
    fs::write(&results.path, text).with_context(|| format!("{}: cannot write", results.path.display()))
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("{}: cannot read", path.display()))
}

/// `text`, read from `path`, with `content` between the markers of `table`.
fn replaced(path: &Path, text: &str, table: &str, content: &str) -> anyhow::Result<String> {
    let [first, last] = markers(table);
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let start = lines.iter().position(|line| line.trim_end() == first);
    let end =
        start.and_then(|start| Some(start + lines[start..].iter().position(|line| line.trim_end() == last)?));
    match (start, end) {
        (Some(start), Some(end)) => {
            Ok([&lines[..=start].concat(), "\n", content.trim_end(), "\n\n", &lines[end..].concat()].concat())
        }
        (None, _) => bail!(
            "{}: has no line `{first}`, expected one before the table and `{last}` after it",
            path.display()
        ),
        (_, None) => bail!("{}: has no line `{last}` after `{first}`, expected one", path.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# Results\n\nBefore.\n\n<!-- table: stage none clean -->\nold\n\nolder\n\
                        <!-- end of table: stage none clean -->\n\nAfter.\n";

    #[test]
    fn only_what_is_between_the_markers_changes() {
        let path = Path::new("results.md");
        let once = replaced(path, TEXT, "stage none clean", "| a |\n").unwrap();
        assert_eq!(
            once,
            "# Results\n\nBefore.\n\n<!-- table: stage none clean -->\n\n| a |\n\n\
             <!-- end of table: stage none clean -->\n\nAfter.\n"
        );
        assert_eq!(replaced(path, &once, "stage none clean", "| a |\n").unwrap(), once, "twice is once");
    }

    #[test]
    fn missing_markers_are_named() {
        let message = |text: &str, table: &str| {
            replaced(Path::new("results.md"), text, table, "").unwrap_err().to_string()
        };
        assert_eq!(
            message(TEXT, "stage none observed"),
            "results.md: has no line `<!-- table: stage none observed -->`, expected one before the table and \
             `<!-- end of table: stage none observed -->` after it"
        );
        let cut = TEXT.split("<!-- end").next().unwrap();
        assert_eq!(
            message(cut, "stage none clean"),
            "results.md: has no line `<!-- end of table: stage none clean -->` after `<!-- table: stage none clean -->`, \
             expected one"
        );
    }
}
