//! How many answers a data set has for one input, and how many of them a tracker holds.

use crate::{Clusters, Inputs};

/// Which clusters of outputs go with which clusters of inputs, and how often (`[Kanaujia2014]`).
///
/// ```
/// use bme::{Inputs, Multimodality};
/// // Input 0 has two answers, input 1 has one.
/// let inputs = Inputs::from_rows(1, [0.0, 0.0, 0.0, 0.0, 1.0, 1.0])?;
/// let outputs = Inputs::from_rows(1, [-5.0, -5.0, 5.0, 5.0, 9.0, 9.0])?;
/// let measure = Multimodality::new(&inputs, &outputs, 2, 3, 1);
/// let (first, second) = (measure.input_cluster(&[0.0]), measure.input_cluster(&[1.0]));
/// assert_eq!([measure.n_modes(first), measure.n_modes(second)], [2, 1]);
/// assert!((measure.weight(first) - 4.0 * 2.0_f64.ln().exp() / 2.0).abs() < 1e-12);
/// assert!((measure.weight(second) - 2.0).abs() < 1e-12);
/// # Ok::<(), bme::InputsError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Multimodality {
    inputs: Clusters,
    outputs: Clusters,
    /// [input cluster][output cluster] samples.
    counts: Vec<Vec<usize>>,
}

/// What a tracker's particles hit of the associations there are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Weight of the associations that were hit.
    pub hit: f64,
    /// The largest weight there is to hit.
    pub possible: f64,
}

impl Coverage {
    /// Hit over possible; 1 where there is nothing to hit.
    pub fn share(&self) -> f64 {
        if self.possible > 0.0 { self.hit / self.possible } else { 1.0 }
    }
}

impl std::ops::AddAssign for Coverage {
    fn add_assign(&mut self, other: Self) {
        self.hit += other.hit;
        self.possible += other.possible;
    }
}

impl Multimodality {
    /// Clusters inputs and outputs of the same samples.
    ///
    /// # Panics
    /// When there are no samples, no clusters, or unequal numbers of rows.
    pub fn new(
        inputs: &Inputs,
        outputs: &Inputs,
        n_input_clusters: usize,
        n_output_clusters: usize,
        seed: u64,
    ) -> Self {
        assert_eq!(inputs.len(), outputs.len(), "{} inputs, {} outputs", inputs.len(), outputs.len());
        let inputs = Clusters::new(inputs, n_input_clusters, seed);
        let outputs = Clusters::new(outputs, n_output_clusters, seed);
        let mut counts = vec![vec![0; outputs.centres.len()]; inputs.centres.len()];
        for (&input, &output) in inputs.assignment.iter().zip(&outputs.assignment) {
            counts[input][output] += 1;
        }
        Self { inputs, outputs, counts }
    }

    /// How many clusters of inputs there are.
    pub fn n_input_clusters(&self) -> usize {
        self.counts.len()
    }

    /// The cluster of an input.
    pub fn input_cluster(&self, x: &[f64]) -> usize {
        self.inputs.nearest(x)
    }

    /// n: how many output clusters go with an input cluster.
    pub fn n_modes(&self, input_cluster: usize) -> usize {
        self.counts[input_cluster].iter().filter(|&&count| count > 0).count()
    }

    /// h_n = N exp(−Σ pᵢ ln pᵢ) / n of an input cluster of N samples spread over n output clusters with shares pᵢ.
    ///
    /// At most N, which it reaches when all answers are equally likely. Deviation: the paper prints other entropies in
    /// its examples than its formula gives; this is the formula (`tests::entropies_of_the_papers_examples`).
    pub fn weight(&self, input_cluster: usize) -> f64 {
        let counts = &self.counts[input_cluster];
        let n_samples: usize = counts.iter().sum();
        if n_samples == 0 {
            return 0.0;
        }
        n_samples as f64 * entropy(counts).exp() / self.n_modes(input_cluster) as f64
    }

    /// Sum of the weights of all input clusters with n modes, at index n − 1: how multimodal the data set is.
    pub fn histogram(&self) -> Vec<f64> {
        let mut histogram = Vec::new();
        for cluster in 0..self.n_input_clusters() {
            let n = self.n_modes(cluster);
            if n > histogram.len() {
                histogram.resize(n, 0.0);
            }
            if n > 0 {
                histogram[n - 1] += self.weight(cluster);
            }
        }
        histogram
    }

    /// What these outputs (a tracker's particles) hit of the answers that go with the input `x`.
    ///
    /// Each answer of an input cluster weighs its share of the cluster's weight; sums over frames are meant.
    pub fn coverage<'a>(&self, x: &[f64], particles: impl IntoIterator<Item = &'a [f64]>) -> Coverage {
        let cluster = self.input_cluster(x);
        let counts = &self.counts[cluster];
        let mut is_hit = vec![false; counts.len()];
        for particle in particles {
            is_hit[self.outputs.nearest(particle)] = true;
        }
        let n_samples: usize = counts.iter().sum();
        let possible = self.weight(cluster);
        let hit: usize = counts.iter().zip(&is_hit).filter(|(_, hit)| **hit).map(|(count, _)| count).sum();
        Coverage { hit: possible * hit as f64 / n_samples.max(1) as f64, possible }
    }
}

/// −Σ pᵢ ln pᵢ in nats, pᵢ the shares of the counts.
fn entropy(counts: &[usize]) -> f64 {
    let total = counts.iter().sum::<usize>() as f64;
    let shares = counts.iter().filter(|&&count| count > 0).map(|&count| count as f64 / total);
    -shares.map(|p| p * p.ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entropies_of_the_papers_examples() {
        // [1,1,1,1,2,3] and [1,1,2,2,3,3], worked out by hand.
        assert!((entropy(&[4, 1, 1]) - 0.8676).abs() < 5e-5);
        assert!((entropy(&[2, 2, 2]) - 1.0986).abs() < 5e-5);
        assert!((entropy(&[4, 1, 1]) / 2.0_f64.ln() - 1.2516).abs() < 5e-5);
        assert!((entropy(&[2, 2, 2]) / 2.0_f64.ln() - 1.5850).abs() < 5e-5);
        assert_eq!(entropy(&[7, 0]), 0.0);
    }

    fn measure() -> Multimodality {
        let inputs = Inputs::from_rows(1, [0.0, 0.0, 0.0, 0.0, 10.0, 10.0]).unwrap();
        let outputs = Inputs::from_rows(1, [1.0, 1.0, 1.0, 50.0, 90.0, 90.0]).unwrap();
        Multimodality::new(&inputs, &outputs, 2, 3, 7)
    }

    #[test]
    fn histogram_adds_up_weights_by_number_of_modes() {
        let histogram = measure().histogram();
        assert_eq!(histogram.len(), 2);
        assert!((histogram[0] - 2.0).abs() < 1e-12);
        // 4 exp(−¾ ln ¾ − ¼ ln ¼) / 2.
        assert!((histogram[1] - 3.509_9).abs() < 1e-3);
    }

    #[test]
    fn coverage_is_the_share_of_answers_hit() {
        let measure = measure();
        let particles: [&[f64]; 3] = [&[2.0], &[1.0], &[91.0]];
        let one_of_two = measure.coverage(&[0.1], particles);
        assert!((one_of_two.share() - 0.75).abs() < 1e-12);
        let both: [&[f64]; 2] = [&[2.0], &[47.0]];
        assert!((measure.coverage(&[0.1], both).share() - 1.0).abs() < 1e-12);
        let mut sum = measure.coverage(&[0.1], both);
        sum += measure.coverage(&[9.0], [&[1.0][..]]);
        assert!((sum.share() - 3.509_9 / 5.509_9).abs() < 1e-3);
    }
}
