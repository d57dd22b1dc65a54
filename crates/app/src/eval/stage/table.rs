//! The report as Markdown.

use std::fmt::Write as _;

use super::score::TrackErrors;
use super::{MAIN_CAMERA, Method, OTHER_VIEW, RecoveryRow, StageReport, StageRow};
use crate::eval::joint_error::mean;

/// The report as a table in Markdown.
pub fn table(report: &StageReport) -> String {
    let mut text = String::from(
        "| sequence | camera | masks | tracker | root mm (sd) | absolute mm | aligned mm | Euler ° | geodesic ° | lost | > 150 mm |\n\
         |---|---|---|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for row in &report.rows {
        let m = &row.mean;
        let _ = writeln!(
            text,
            "| {} {} | {} | {} | {} | {:.1} ({:.1}) | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} |",
            row.subject,
            row.activity,
            row.camera,
            row.masks,
            row.method.name(),
            m.root_mm,
            row.spread.root_mm,
            m.abs_mm,
            m.aligned_mm,
            m.euler_deg,
            m.geodesic_deg,
            m.lost,
            m.far_off
        );
    }
    let mut groups: Vec<(Method, &str)> = Vec::new();
    for row in &report.rows {
        if !groups.contains(&(row.method, &row.masks)) {
            groups.push((row.method, &row.masks));
        }
    }
    for (method, masks) in groups {
        let of = |figure: fn(&TrackErrors) -> f64| {
            let is_main =
                |row: &&StageRow| row.camera != OTHER_VIEW.2 && row.method == method && row.masks == masks;
            mean(report.rows.iter().filter(is_main).map(|row| figure(&row.mean)))
        };
        let _ = writeln!(
            text,
            "| mean of {MAIN_CAMERA} | | {masks} | {} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} |",
            method.name(),
            of(|e| e.root_mm),
            of(|e| e.abs_mm),
            of(|e| e.aligned_mm),
            of(|e| e.euler_deg),
            of(|e| e.geodesic_deg),
            of(|e| e.lost),
            of(|e| e.far_off)
        );
    }
    if !report.recovery.is_empty() {
        text += "\n| pose replaced by | tracker | trials | back within 10 frames |\n|---|---|---:|---:|\n";
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
    }
    let residual = mean(report.fit_residual_mm.iter().map(|(_, mm)| *mm));
    let _ = writeln!(
        text,
        "\nFit of the skeleton to the true joints: {residual:.2} mm left (mean over sequences)."
    );
    text
}
