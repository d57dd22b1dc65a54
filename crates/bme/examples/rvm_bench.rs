//! Seconds, vectors and test error on fixed regression and classification tasks.
//!
//! `cargo run --release -p bme --example rvm_bench -- FOLDER [TASK...]`, where FOLDER holds one folder a task with
//! `x_train.npy`, `y_train.npy`, `x_test.npy` and `y_test.npy`, as `rvm_rivals.py` makes them for sinc and Friedman. The time is that of one fit on one thread, from the
//! inputs to the model, kernels included; the least of three.
#![allow(clippy::print_stdout, reason = "a program that prints a table")]

use std::path::Path;
use std::time::Instant;

use bme::{Design, Expert, Gate, Gaussian, Inputs, Kernel, Rvm, RvmClassifier, RvmParams};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Task and inverse kernel width g.
const TASKS: [(&str, f64); 7] = [
    ("sinc_500", 0.25),
    ("sinc_1000", 0.25),
    ("friedman_500", 0.3),
    ("friedman_1000", 0.3),
    ("syn400_1000", 1.0 / 600.0),
    ("syn400_2000", 1.0 / 600.0),
    ("cls400_2000", 1.0 / 600.0),
];

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, wanted) = arguments.split_first().ok_or("usage: rvm_bench FOLDER [TASK...]")?;
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    if let Some(unknown) = wanted.iter().find(|name| TASKS.iter().all(|(task, _)| task != name)) {
        return Err(format!(
            "no task is called {unknown}, expected some of {:?}",
            TASKS.map(|(task, _)| task)
        )
        .into());
    }
    println!("{:<14} {:>9} {:>8} {:>11}", "task", "seconds", "vectors", "test error");
    for (task, inverse_width) in TASKS {
        let folder = Path::new(folder).join(task);
        let is_wanted = if wanted.is_empty() { folder.is_dir() } else { wanted.iter().any(|w| w == task) };
        if is_wanted {
            one_thread.install(|| run(&folder, task, inverse_width))?;
        }
    }
    Ok(())
}

fn run(folder: &Path, task: &str, inverse_width: f64) -> Outcome<()> {
    let (dim, x) = table(&folder.join("x_train.npy"))?;
    let (_, y) = table(&folder.join("y_train.npy"))?;
    let (_, x_test) = table(&folder.join("x_test.npy"))?;
    let (_, y_test) = table(&folder.join("y_test.npy"))?;
    let is_classification = task.starts_with("cls");
    let mut best: Option<(f64, Model)> = None;
    for _ in 0..3 {
        let start = Instant::now();
        let design =
            Design::new(Kernel::gaussian(dim, inverse_width)?, Inputs::from_rows(dim, x.iter().copied())?);
        let params = RvmParams::default();
        let model = if is_classification {
            let others = y.iter().map(|y| 1.0 - y).collect();
            Model::Classification(RvmClassifier::fit(&design, &[y.clone(), others], &params)?)
        } else {
            Model::Regression(Rvm::fit(&design, std::slice::from_ref(&y), &vec![1.0; y.len()], &params)?)
        };
        let seconds = start.elapsed().as_secs_f64();
        if best.as_ref().is_none_or(|(least, _)| seconds < *least) {
            best = Some((seconds, model));
        }
    }
    let (seconds, model) = best.ok_or("no fit")?;
    let (vectors, error) = match &model {
        Model::Regression(model) => {
            let mut prediction = Gaussian::default();
            let squares = x_test.chunks_exact(dim).zip(&y_test).map(|(x, y)| {
                model.predict(x, &mut prediction);
                (prediction.mean[0] - y).powi(2)
            });
            (model.n_bases(), (squares.sum::<f64>() / y_test.len() as f64).sqrt())
        }
        Model::Classification(model) => {
            let mut log_gates = [0.0; 2];
            let wrong = x_test.chunks_exact(dim).zip(&y_test).filter(|(x, y)| {
                model.log_gates(x, &mut log_gates);
                (log_gates[0] > log_gates[1]) != (**y > 0.5)
            });
            (model.n_bases(), wrong.count() as f64 / y_test.len() as f64)
        }
    };
    println!("{task:<14} {seconds:>9.4} {vectors:>8} {error:>11.4}");
    Ok(())
}

enum Model {
    Regression(Rvm),
    Classification(RvmClassifier),
}

/// Row length and values of an `.npy` (version 1) of little-endian `f32` or `f64`, row after row.
fn table(path: &Path) -> Outcome<(usize, Vec<f64>)> {
    let bytes = std::fs::read(path)?;
    let damaged = || format!("{}: no .npy table of little-endian f32 or f64", path.display());
    let length =
        bytes.get(8..10).and_then(|l| l.try_into().ok()).map(u16::from_le_bytes).ok_or_else(damaged)?;
    let (header, data) = bytes.split_at_checked(10 + usize::from(length)).ok_or_else(damaged)?;
    let header = String::from_utf8_lossy(header);
    let shape = header.split("'shape': (").nth(1).and_then(|s| s.split(')').next()).ok_or_else(damaged)?;
    let dim = shape.split(',').nth(1).and_then(|d| d.trim().parse().ok()).unwrap_or(1);
    let values = if header.contains("<f4") {
        data.as_chunks::<4>().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
    } else if header.contains("<f8") {
        data.as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b)).collect()
    } else {
        return Err(damaged().into());
    };
    Ok((dim, values))
}
