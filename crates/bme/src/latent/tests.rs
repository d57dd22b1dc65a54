use rand::{Rng, RngExt as _};
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::rng::{Purpose, stream};

/// Rows of a gait: 20 angles (radians) of two harmonics of a phase, at three strides, with a little noise.
fn gait(n: usize, seed: u64) -> Inputs {
    let mut rng = stream(seed, Purpose::Components);
    let mut values = Vec::new();
    for _ in 0..n {
        let phase = std::f64::consts::TAU * f64::from(rng.next_u32()) / 4_294_967_296.0;
        let stride = 0.8 + 0.2 * f64::from(rng.next_u32() % 3);
        for d in 0..20 {
            let d = f64::from(d);
            let noise: f64 = StandardNormal.sample(&mut rng);
            values
                .push(stride * (0.5 * (phase + d).sin() + 0.15 * (2.0 * phase + d * d).cos()) + 0.01 * noise);
        }
    }
    Inputs::from_rows(20, values).unwrap()
}

fn fit(outputs: &Inputs) -> SpectralLatentModel {
    let params =
        LatentParams::new(LatentConfig { n_dims: 3, max_landmarks: 240, ..LatentConfig::default() }).unwrap();
    SpectralLatentModel::fit(outputs, &params).unwrap()
}

#[test]
fn poses_it_has_not_seen_come_back() {
    let model = fit(&gait(300, 1));
    let test = gait(100, 2);
    let mut error = 0.0;
    for i in 0..test.len() {
        let y = test.row_f64(i);
        let decoded = model.decode(&model.encode(&y).mean);
        error += y.iter().zip(&decoded).map(|(a, b)| (a - b).abs()).sum::<f64>() / (20.0 * test.len() as f64);
    }
    // The noise alone has a mean absolute value of 0.008 rad; 0.02 rad is 1.1 degrees.
    assert!(error < 0.02, "mean absolute error {error} rad");
    assert_eq!((model.latent_dim(), model.output_dim()), (3, 20));
}

#[test]
fn a_posture_that_nobody_held_is_kept() {
    // Sheets of two coordinates: a bent one, and a lean that the training knows up to 1.
    let row = |bend: f64, lean: f64| -> Vec<f64> {
        (0..12).map(f64::from).map(|d| 0.3 * (bend + d).sin() + lean * (0.4 * d).cos()).collect()
    };
    let mut rng = stream(6, Purpose::Components);
    let outputs = (0..300).flat_map(|_| row(rng.random_range(0.0..3.0), rng.random_range(-1.0..1.0)));
    let model = fit(&Inputs::from_rows(12, outputs).unwrap());
    let y = row(1.0, 1.8);
    let off = |decoded: &[f64]| decoded.iter().zip(&y).map(|(a, b)| (a - b).abs()).sum::<f64>() / 12.0;
    let nearest = off(&model.decode(&model.nearest(&y)));
    // Kernels alone end where the training does.
    let edge = off(&row(1.0, 1.0));
    assert!(nearest < 0.5 * edge, "off by {nearest}, the edge of the training by {edge}");
    assert!(nearest <= off(&model.decode(&model.encode(&y).mean)) + 1e-9);
}

#[test]
fn prior_tells_gaits_from_other_points() {
    let model = fit(&gait(300, 1));
    let test = gait(50, 3);
    let inside: f64 =
        (0..50).map(|i| model.prior().log_density(&model.encode(&test.row_f64(i)).mean)).sum::<f64>() / 50.0;
    assert!(inside > model.prior().log_density(&[6.0, 6.0, 6.0]) + 5.0);
}

#[test]
fn jacobian_is_the_derivative() {
    let model = fit(&gait(150, 4));
    let x = [0.3, -0.2, 0.5];
    let (mean, jacobian) = model.decoder().mean_and_jacobian(&x);
    assert_eq!(mean, model.decode(&x));
    for i in 0..3 {
        let (mut up, mut down) = (x, x);
        up[i] += 1e-5;
        down[i] -= 1e-5;
        for (d, (a, b)) in model.decode(&up).iter().zip(model.decode(&down)).enumerate() {
            assert!(((a - b) / 2e-5 - jacobian[d][i]).abs() < 1e-6);
        }
    }
}

#[test]
fn unusable_rows_are_named() {
    let params = LatentParams::new(LatentConfig::default()).unwrap();
    let few = Inputs::from_rows(2, [1.0, 2.0, 3.0, 4.0]).unwrap();
    let error = SpectralLatentModel::fit(&few, &params).unwrap_err();
    assert_eq!(error.to_string(), "2 rows for 5 latent dimensions, expected at least 7");
    let alike = Inputs::from_rows(1, [1.0; 30]).unwrap();
    assert_eq!(
        SpectralLatentModel::fit(&alike, &params).unwrap_err().to_string(),
        "all 30 rows are alike, expected some that differ"
    );
}

#[test]
fn a_small_file_decodes_and_encodes_as_before() {
    use crate::file::LatentFile;
    let model = fit(&gait(150, 5));
    let mut file = LatentFile::from(&model);
    let whole = file.clone();
    file.shrink();
    assert!(file.decoder.outputs.iter().all(|output| output.covariance.is_empty()));
    assert_eq!(SpectralLatentModel::try_from(whole).unwrap().encoder.outputs, model.encoder.outputs);
    let small = SpectralLatentModel::try_from(file).unwrap();
    let y = gait(1, 6).row_f64(0);
    assert_eq!(small.encode(&y).mean, model.encode(&y).mean);
    assert_eq!(small.decode(&[0.1, 0.2, 0.3]), model.decode(&[0.1, 0.2, 0.3]));
    let (mut room, mut mean, mut variance) = (vec![0.0; small.decoder.n_features()], [0.0; 20], [0.0; 20]);
    small.decoder.kernels.predict_into(&[0.1, 0.2, 0.3], &mut room, &mut mean, &mut variance);
    assert_eq!(variance.to_vec(), small.decoder.noise_variance());
}
