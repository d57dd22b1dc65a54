use super::*;

fn survival(rate: f64) -> SurvivalRate {
    let config = SurvivalRateConfig { survival_rate: rate, ..SurvivalRateConfig::default() };
    SurvivalRate::new(config).expect("a rate between 0 and 1")
}

/// One good particle among 100, ln 10 better: the effective size is (1 + 99 r)² / (1 + 99 r²) with r = 10^−β. Half
/// survive where 4851 r² + 198 r − 49 = 0. With the wrong sign the size would never fall below 99.
#[test]
fn survival_rate_gives_the_exponent_worked_out_by_hand() {
    let mut log_weights = vec![-f64::ln(10.0); 100];
    log_weights[42] = 0.0;
    let r = (-198.0 + f64::sqrt(198.0 * 198.0 + 4.0 * 4851.0 * 49.0)) / (2.0 * 4851.0);
    let beta = survival(0.5).beta(0, &LogWeights::new(log_weights)).get();
    assert!((beta + r.log10()).abs() < 1e-8, "{beta}");
}

#[test]
fn survival_rate_counts_possible_particles() {
    let mut log_weights = vec![f64::NEG_INFINITY; 100];
    log_weights[..4].copy_from_slice(&[0.0, -1.0, -2.0, -3.0]);
    let all = LogWeights::new(log_weights);
    let beta = survival(0.5).beta(0, &all);
    assert!((all.effective_sample_size(beta) - 2.0).abs() < 1e-6);
}

#[test]
fn survival_rate_stops_at_the_largest_exponent() {
    assert_eq!(survival(0.5).beta(0, &LogWeights::new(vec![-3.0; 10])).get(), 1e4);
}

#[test]
fn ess_steps_go_on_from_the_exponent_before() {
    let schedule =
        EssSchedule::new(EssConfig { max_layers: 3, ..EssConfig::default() }).expect("three layers");
    let log_weights = LogWeights::new((0..100).map(|i| -f64::from(i)).collect());
    let first = schedule.beta(0, &log_weights).get();
    let before = Beta::new(0.25).expect("an exponent");
    let second = schedule.beta_after(1, before, &log_weights).get();
    assert!((second - 0.25 - first).abs() < 1e-9);
    assert_eq!(
        schedule.beta_after(2, before, &log_weights),
        Beta::ONE,
        "the last layer takes all that is left"
    );
    assert_eq!(
        schedule.beta_after(1, before, &LogWeights::new(vec![0.0; 9])),
        Beta::ONE,
        "nothing to be careful about"
    );
}

#[test]
fn refused_settings_are_named() {
    let refused = |result: Result<Geometric, BadSchedule>| result.expect_err("out of range").to_string();
    let config = GeometricConfig::default();
    assert_eq!(
        refused(Geometric::new(GeometricConfig { layers: 0, ..config })),
        "`layers` is 0, expected 1 to 256"
    );
    assert_eq!(
        refused(Geometric::new(GeometricConfig { first_beta: f64::NAN, ..config })),
        "`first_beta` is NaN, expected a finite number above zero"
    );
    let diffusion = DiffusionConfig { first: -1.0, ..DiffusionConfig::default() };
    assert_eq!(
        refused(Geometric::new(GeometricConfig { diffusion, ..config })),
        "`diffusion.first` is -1, expected a finite number of zero or more"
    );
    let all_survive = SurvivalRate::new(SurvivalRateConfig { survival_rate: 1.0, ..Default::default() });
    assert_eq!(
        all_survive.expect_err("out of range").to_string(),
        "`survival_rate` is 1, expected a number above 0 and below 1"
    );
}
