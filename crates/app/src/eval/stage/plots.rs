//! The plots of the evaluation, as SVG and PNG.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};

use super::{MAIN_CAMERA, Method, StageReport};
use crate::draw::{Chart, Marks, Series};
use crate::eval::joint_error::mean;

/// Frames over which a predictor's error is averaged, or the curves would hide each other.
const SMOOTHED_OVER: usize = 21;

/// Writes the plots that the report has something for.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn write(out: &Path, report: &StageReport) -> anyhow::Result<()> {
    let charts = [
        ("coverage", coverage(report)),
        ("updates", updates(report, false)),
        ("updates-few-frames", updates(report, true)),
        ("multimodality", multimodality(report)),
    ];
    for (name, chart) in charts.into_iter().filter(|(_, chart)| !chart.series.is_empty()) {
        let path = out.join(format!("{name}.svg"));
        fs::write(&path, chart.to_svg()).with_context(|| format!("{}: cannot write", path.display()))?;
        let (path, frame) = (out.join(format!("{name}.png")), chart.to_frame());
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(&frame.pixels, frame.width, frame.height, ExtendedColorType::Rgb8)
            .with_context(|| format!("{}: cannot encode the picture", path.display()))?;
        fs::write(&path, png).with_context(|| format!("{}: cannot write", path.display()))?;
    }
    Ok(())
}

/// Coverage per frame of each tracker, mean over the rows of the main camera and over seeds.
fn coverage(report: &StageReport) -> Chart {
    let mut methods: Vec<Method> = Vec::new();
    for row in report.rows.iter().filter(|row| row.coverage.is_some()) {
        if !methods.contains(&row.method) {
            methods.push(row.method);
        }
    }
    let series = methods.into_iter().map(|method| {
        let rows = report.rows.iter().filter(|row| row.method == method && row.camera == MAIN_CAMERA);
        let shares: Vec<Vec<f64>> = rows
            .flat_map(|row| &row.seeds)
            .map(|seed| seed.coverage.iter().map(|frame| frame.proposed.share()).collect())
            .collect();
        Series { name: method.name().to_uppercase(), values: mean_by_frame(&shares) }
    });
    Chart {
        title: "coverage: share of the poses known to go with the mask that a tracker's particles hit".into(),
        x_label: "frame".into(),
        first_x: 0,
        marks: Marks::Lines,
        series: series.collect(),
    }
}

/// Error over time of the trackers' predictors, or of those that were trained on few frames; mean over sequences.
fn updates(report: &StageReport, short_of_frames: bool) -> Chart {
    let rows = || report.updates.iter().filter(|row| row.is_short_of_frames == short_of_frames);
    let mut particles: Vec<u32> = rows().map(|row| row.particles).collect();
    particles.sort_unstable();
    particles.dedup();
    let series = particles.into_iter().map(|n| {
        let errors: Vec<Vec<f64>> =
            rows().filter(|row| row.particles == n).map(|row| row.frames_deg.clone()).collect();
        let name = match n {
            0 => "no updates".to_owned(),
            1 => "1 particle".to_owned(),
            _ => format!("{n} particles"),
        };
        Series { name, values: smoothed(&mean_by_frame(&errors)) }
    });
    Chart {
        title: format!(
            "joint angle error of predictors that learn while tracking, degrees, mean over {SMOOTHED_OVER} frames"
        ),
        x_label: "frame".into(),
        first_x: 0,
        marks: Marks::Lines,
        series: series.collect(),
    }
}

/// Weight of the clusters of masks by the number of poses that go with them.
fn multimodality(report: &StageReport) -> Chart {
    let series = Series { name: String::new(), values: report.multimodality.clone() };
    Chart {
        title: "multimodality of the training examples: weight of the masks that go with n clusters of poses"
            .into(),
        x_label: "n".into(),
        first_x: 1,
        marks: Marks::Bars,
        series: if report.multimodality.is_empty() { Vec::new() } else { vec![series] },
    }
}

/// Mean of each frame over the runs that have it.
fn mean_by_frame(runs: &[Vec<f64>]) -> Vec<f64> {
    let n_frames = runs.iter().map(Vec::len).max().unwrap_or(0);
    (0..n_frames).map(|frame| mean(runs.iter().filter_map(|run| run.get(frame)).copied())).collect()
}

/// The mean about each frame, over fewer frames at both ends.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let about = |frame: usize| {
        let reach = (SMOOTHED_OVER / 2).min(frame).min(values.len() - 1 - frame);
        mean(values[frame - reach..=frame + reach].iter().copied())
    };
    (0..values.len()).map(about).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_a_run_lacks_do_not_count() {
        assert_eq!(mean_by_frame(&[vec![1.0, 2.0, 3.0], vec![3.0]]), [2.0, 2.0, 3.0]);
        assert!(mean_by_frame(&[]).is_empty());
    }

    #[test]
    fn smoothing_keeps_a_line() {
        let line: Vec<f64> = (0..60).map(f64::from).collect();
        assert!(smoothed(&line).iter().zip(&line).all(|(a, b)| (a - b).abs() < 1e-12));
        let mut spike = vec![0.0; 60];
        spike[30] = SMOOTHED_OVER as f64;
        assert_eq!(smoothed(&spike)[25], 1.0);
    }
}
