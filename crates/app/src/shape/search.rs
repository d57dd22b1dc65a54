//! The search of the paper: shape coefficients by the annealed particle filter, `[Deutscher2005]`; the other way is
//! [`adjust`](super::adjust).
//!
//! A particle is a set of shape coefficients. Every hypothesis has a skeleton of its own: the lengths of its bones follow from
//! its coefficients, and on each frame its pose is fitted anew to the outline (a step of Levenberg-Marquardt on position,
//! heading and joint angles). The likelihood is that of tracking, the overlap of body and mask, summed over the frames. Each round
//! begins with the poses that suit the body of the round before.
//!
//! Deviation: the paper fits the angles to the joints that were tracked; these hold every hypothesis to the bones of the body
//! that they were tracked with.

use body::{JointId, Pose};
use nalgebra::{DMatrix, DVector};
use pf_core::estimate::weighted_covariance;
use pf_core::schedule::{DiffusionConfig, SurvivalRate, SurvivalRateConfig};
use pf_core::{
    Filter, FilterConfig, FilterParams, Gaussian, GaussianDiffusion, Likelihood, RandomWalk, StateSpace, Step,
};
use rayon::prelude::*;
use render_gpu::{CpuScorer, MeshBatch, OverlapCounts, RowStep, ScoreError, SilhouetteScorer};
use silhouette::Mask;

use super::adjust::{Adjusted, Adjuster, View};
use super::figure::Rest;
use crate::track::overlap::{scorer_intrinsics, scorer_mask};

/// Settings of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchConfig {
    /// Hypotheses.
    pub particles: usize,
    /// Layers of a round.
    pub layers: u32,
    /// Rounds, each with the poses that suit the body of the one before.
    pub rounds: u32,
    /// Log-likelihood that a frame loses when body and mask share nothing.
    pub sharpness: f64,
    /// Spread of the first round's hypotheses, standard deviations of the population; each further round halves it.
    pub first_sd: f64,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for SearchConfig {
    fn default() -> Self {
        Self { particles: 60, layers: 6, rounds: 1, sharpness: 300.0, first_sd: 0.8, seed: 0 }
    }
}

type ShapeFilter<'a> = Filter<Coefficients, RandomWalk<[Frame<'a>]>>;

impl SearchConfig {
    /// The filter of a round.
    fn filter<'a>(&self, space: Coefficients, round: u32) -> anyhow::Result<ShapeFilter<'a>> {
        let spread = vec![self.first_sd / f64::from(1 << round); space.count];
        let schedule = SurvivalRate::new(SurvivalRateConfig {
            layers: self.layers,
            max_beta: 1.0,
            diffusion: DiffusionConfig { first: 1.0, ratio: 0.9 },
            ..SurvivalRateConfig::default()
        })?;
        let diffusion = GaussianDiffusion::of_survivors(vec![LEAST_SD; space.count])?;
        let params = FilterParams::new(FilterConfig {
            n_particles: self.particles,
            seed: self.seed + u64::from(round),
            ..FilterConfig::default()
        })?;
        let walk = RandomWalk::new(Gaussian::diagonal(spread)?);
        Ok(Filter::annealed(space, walk, schedule, diffusion, params))
    }
}

/// Coefficients beyond this are no body, standard deviations.
const FARTHEST: f64 = 4.0;
/// Survivors that are alike still part by this, standard deviations.
const LEAST_SD: f64 = 0.03;
/// Steps of a pose towards the outline for each hypothesis,
const HYPOTHESIS_STEPS: usize = 1;
/// and for the body of a round.
const ROUND_STEPS: usize = 6;
/// Rows of pixels of which one is scored, as in tracking.
const SCORED_ROWS: u32 = 2;

/// Searches the shape that explains `views`, whose masks are `masks`, from `shape` on. The covariance is that of the last
/// particles: how wide the search still was, no posterior.
///
/// # Panics
/// Without a view, when a mask has another size than the camera's image, or when a setting is out of range.
pub fn search(
    adjuster: &Adjuster<'_>,
    views: &[View<'_>],
    masks: &[&Mask],
    shape: &[f64],
    config: &SearchConfig,
) -> Adjusted {
    let space = Coefficients { count: shape.len() };
    let figure = adjuster.figure();
    let mut shape = shape.to_vec();
    let mut covariance = vec![0.0; shape.len().pow(2)];
    let mut poses: Vec<Pose> = views.iter().map(|view| view.pose.clone()).collect();
    let mut overlaps = Overlaps::new(adjuster, config.sharpness);
    for round in 0..config.rounds {
        let head_m = head_m(&figure.rest(&shape));
        let frames: Vec<Frame<'_>> = views
            .iter()
            .zip(masks)
            .zip(poses)
            .map(|((&View { seen, weight, .. }, mask), pose)| Frame {
                mask,
                view: View { seen, pose, weight },
                head_m,
            })
            .collect();
        let mut filter = config.filter(space, round).expect("the settings are in range");
        filter.initialise(vec![shape.clone()]).expect("there is a particle");
        let step = filter.step(&frames[..], &mut overlaps, &mut ()).expect("bodies are finite");
        if let Step::Tracked(found) = step {
            shape = found.mean(&space);
            weighted_covariance(&space, &shape, found.states, found.weights, &mut covariance);
        }
        let rest = figure.rest(&shape);
        let suited =
            frames.par_iter().map(|frame| adjuster.fit_pose(&frame.start(&rest), &rest, ROUND_STEPS));
        poses = suited.collect();
    }
    let n = space.count;
    shape.push(0.0); // the clothes are as thick as they are said to be
    let mut found = adjuster.assess(views, poses, DVector::from_vec(shape));
    found.covariance.view_mut((0, 0), (n, n)).copy_from(&DMatrix::from_row_slice(n, n, &covariance));
    found
}

/// Shape coefficients, inside the limits of the population.
#[derive(Clone, Copy)]
struct Coefficients {
    count: usize,
}

impl StateSpace for Coefficients {
    type State = Vec<f64>;

    fn dim(&self) -> usize {
        self.count
    }

    fn retract(&self, state: &mut Vec<f64>, delta: &[f64]) {
        for (coefficient, step) in state.iter_mut().zip(delta) {
            *coefficient = (*coefficient + step).clamp(-FARTHEST, FARTHEST);
        }
    }

    fn local(&self, from: &Vec<f64>, to: &Vec<f64>, delta: &mut [f64]) {
        for ((out, a), b) in delta.iter_mut().zip(from).zip(to) {
            *out = b - a;
        }
    }
}

/// A frame, as a body of the height `head_m` explains it.
struct Frame<'a> {
    mask: &'a Mask,
    view: View<'a>,
    /// Height of the head joint at rest, metres.
    head_m: f64,
}

impl Frame<'_> {
    /// Where the fit of a body's pose begins: a taller body stands taller on its spot.
    fn start(&self, rest: &Rest) -> View<'_> {
        let View { seen, ref pose, weight } = self.view;
        let mut pose = pose.clone();
        pose.root_position.z *= head_m(rest) / self.head_m;
        View { seen, pose, weight }
    }
}

fn head_m(rest: &Rest) -> f64 {
    rest.joints[JointId::HEAD.index()].y
}

/// Scores shapes by the overlap of their bodies and the masks of all frames, and by whether they stand on the floor: without it a
/// small body near the camera were as good as a large one.
struct Overlaps<'a> {
    adjuster: &'a Adjuster<'a>,
    sharpness: f64,
    scorer: CpuScorer,
    positions_camera: Vec<[f32; 3]>,
    counts: Vec<OverlapCounts>,
}

impl<'a> Overlaps<'a> {
    fn new(adjuster: &'a Adjuster<'a>, sharpness: f64) -> Self {
        let mut scorer = CpuScorer::with_threads(rayon::current_num_threads());
        scorer.set_row_step(RowStep::new(SCORED_ROWS).expect("it is a power of two"));
        Self { adjuster, sharpness, scorer, positions_camera: Vec::new(), counts: Vec::new() }
    }

    /// The vertices of a body on a frame, in the pose that suits it, in the camera's frame; and what its height above the
    /// floor costs.
    fn place(&self, frame: &Frame<'_>, rest: &Rest, positions_camera: &mut [[f32; 3]]) -> f64 {
        let pose = self.adjuster.fit_pose(&frame.start(rest), rest, HYPOTHESIS_STEPS);
        let posed = self.adjuster.figure().posed(rest, &pose, self.adjuster.config().clothing_m[0]);
        let camera_from_world = self.adjuster.camera().camera_from_world();
        for (out, vertex) in positions_camera.iter_mut().zip(&posed.vertices) {
            *out = camera_from_world.transform_point3(*vertex).as_vec3().to_array();
        }
        self.adjuster.floor_cost(posed.vertices[posed.lowest()].z)
    }
}

impl<'a> Likelihood<Vec<f64>> for Overlaps<'a> {
    type Frame = [Frame<'a>];
    type Error = ScoreError;

    fn log_likelihoods(
        &mut self,
        frames: &[Frame<'a>],
        states: &[Vec<f64>],
        out: &mut [f64],
    ) -> Result<(), ScoreError> {
        let figure = self.adjuster.figure();
        let rests: Vec<Rest> = states.par_iter().map(|shape| figure.rest(shape)).collect();
        // The prior: coefficients are in standard deviations.
        for (log_likelihood, shape) in out.iter_mut().zip(states) {
            *log_likelihood = -0.5 * shape.iter().map(|c| c * c).sum::<f64>();
        }
        let lens = scorer_intrinsics(self.adjuster.camera().intrinsics());
        let vertices_per_mesh = rests[0].vertices.len();
        let mut positions_camera = std::mem::take(&mut self.positions_camera);
        positions_camera.resize(states.len() * vertices_per_mesh, [0.0; 3]);
        self.counts.resize(states.len(), OverlapCounts::default());
        for frame in frames {
            let bodies = positions_camera.par_chunks_mut(vertices_per_mesh).zip(&rests).zip(&mut *out);
            bodies.for_each(|((positions, rest), log_likelihood)| {
                *log_likelihood -= frame.view.weight * self.place(frame, rest, positions);
            });
            self.scorer
                .set_target(&scorer_mask(frame.mask), &lens)
                .expect("masks have the size of the camera's image");
            let triangles = figure.triangles();
            let batch = MeshBatch { positions_camera: &positions_camera, vertices_per_mesh, triangles };
            self.scorer.score(&batch, &mut self.counts)?;
            for (log_likelihood, counts) in out.iter_mut().zip(&self.counts) {
                *log_likelihood -= frame.view.weight * self.sharpness * (1.0 - counts.iou());
            }
        }
        self.positions_camera = positions_camera;
        Ok(())
    }
}
