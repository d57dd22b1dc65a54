//! The report as Markdown.

use std::fmt::Write as _;

use super::score::TrackErrors;
use super::{MAIN_CAMERA, Method, OTHER_VIEW, RecoveryRow, StageReport, StageRow};
use crate::eval::joint_error::mean;

/// All tables of the report.
pub fn table(report: &StageReport) -> String {
    let mut kinds: Vec<&str> = Vec::new();
    for row in &report.rows {
        if !kinds.contains(&row.masks.as_str()) {
            kinds.push(&row.masks);
        }
    }
    let mut tables: Vec<String> = kinds.into_iter().map(|kind| rows_table(report, kind)).collect();
    if !report.recovery.is_empty() {
        tables.push(recovery_table(report));
    }
    if !report.updates.is_empty() {
        tables.push(updates_table(report));
    }
    tables.join("\n")
}

/// The trackers on one kind of masks.
pub(super) fn rows_table(report: &StageReport, masks: &str) -> String {
    let mut text = String::from(
        "| sequence | camera | masks | tracker | root mm (sd) | absolute mm | aligned mm | Euler ° | geodesic ° | lost | > 150 mm | coverage |\n\
         |---|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let rows = || report.rows.iter().filter(|row| row.masks == masks);
    for row in rows() {
        let _ = writeln!(
            text,
            "| {} {} | {} | {masks} | {} | {:.1} ({:.1}) {} {} |",
            row.subject,
            row.activity,
            row.camera,
            row.method.name(),
            row.mean.root_mm,
            row.spread.root_mm,
            cells(|figure| figure(&row.mean)),
            coverage_cell(row.coverage)
        );
    }
    let mut methods: Vec<Method> = Vec::new();
    for row in rows() {
        if !methods.contains(&row.method) {
            methods.push(row.method);
        }
    }
    for method in methods {
        let main = || rows().filter(|row| row.camera != OTHER_VIEW.2 && row.method == method);
        let of = |figure: fn(&TrackErrors) -> f64| mean(main().map(|row| figure(&row.mean)));
        let covered: Vec<f64> = main().filter_map(|row: &StageRow| row.coverage).collect();
        let _ = writeln!(
            text,
            "| mean of {MAIN_CAMERA} | | {masks} | {} | {:.1} {} {} |",
            method.name(),
            of(|e| e.root_mm),
            cells(of),
            coverage_cell((!covered.is_empty()).then(|| mean(covered.iter().copied())))
        );
    }
    let residual = mean(report.fit_residual_mm.iter().map(|(_, mm)| *mm));
    let _ = writeln!(
        text,
        "\nFit of the skeleton to the true joints: {residual:.2} mm left (mean over sequences)."
    );
    text
}

/// The cells between the root-relative error and the coverage.
fn cells(of: impl Fn(fn(&TrackErrors) -> f64) -> f64) -> String {
    let figures: [fn(&TrackErrors) -> f64; 6] =
        [|e| e.abs_mm, |e| e.aligned_mm, |e| e.euler_deg, |e| e.geodesic_deg, |e| e.lost, |e| e.far_off];
    figures.map(|figure| format!("| {:.1} ", of(figure))).concat() + "|"
}

fn coverage_cell(coverage: Option<f64>) -> String {
    coverage.map_or_else(String::new, |share| format!("{share:.2}"))
}

/// How often the trackers came back from wrong poses.
pub(super) fn recovery_table(report: &StageReport) -> String {
    let mut text = String::from(
        "| pose replaced by | tracker | trials | back within 10 frames |\n|---|---|---:|---:|\n",
    );
    let mut counts: Vec<(&str, Method, usize, usize)> = Vec::new();
    for RecoveryRow { wrong_pose, method, trials, recovered, .. } in &report.recovery {
        match counts.iter_mut().find(|(pose, other, ..)| pose == wrong_pose && other == method) {
            Some((_, _, all, back)) => (*all, *back) = (*all + trials, *back + recovered),
            None => counts.push((wrong_pose, *method, *trials, *recovered)),
        }
    }
    for (wrong_pose, method, trials, recovered) in counts {
        let _ = writeln!(text, "| {wrong_pose} | {} | {trials} | {recovered} |", method.name());
    }
    text
}

/// How predictors fare that learn while tracking.
pub(super) fn updates_table(report: &StageReport) -> String {
    let mut text = String::from(
        "| sequence | trained on | particles learned from | joints ° | heading ° | all angles ° | frames | bases added | deleted | log evidence |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for row in &report.updates {
        let _ = writeln!(
            text,
            "| {} {} | {} | {} | {:.2} | {:.1} | {:.2} | {} | {} | {} | {:+.1} |",
            row.subject,
            row.activity,
            row.trained_on,
            row.particles,
            row.joints_deg,
            row.heading_deg,
            row.angles_deg,
            row.learned.frames,
            row.learned.added,
            row.learned.deleted,
            row.learned.log_evidence_gain
        );
    }
    text
}
