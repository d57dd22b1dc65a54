//! k-means clustering with careful first centres.

use rand::Rng;

use crate::Inputs;
use crate::density::draw;
use crate::rng::{Purpose, stream};

/// Rounds after which a clustering that still moves is taken as it is.
const MAX_ROUNDS: usize = 100;

/// Centres and which of them each row is nearest to.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    /// `[n_clusters]` points in the units of the rows.
    pub centres: Vec<Vec<f64>>,
    /// `[n_rows]` indices of centres.
    pub assignment: Vec<usize>,
}

impl Clusters {
    /// At most `n_clusters` clusters of the rows; first centres as `[Arthur2007]`, then Lloyd's rounds until nothing moves.
    ///
    /// Fewer come back where the rows have fewer different values.
    ///
    /// # Panics
    /// When there are no rows or no clusters.
    pub fn new(rows: &Inputs, n_clusters: usize, seed: u64) -> Self {
        assert!(!rows.is_empty(), "no rows to cluster");
        assert!(n_clusters > 0, "no clusters, expected at least one");
        let mut centres = first_centres(rows, n_clusters, &mut stream(seed, Purpose::KMeans));
        let mut assignment = assign(rows, &centres);
        for _ in 0..MAX_ROUNDS {
            for (cluster, centre) in centres.iter_mut().enumerate() {
                let members: Vec<usize> = (0..rows.len()).filter(|&i| assignment[i] == cluster).collect();
                if !members.is_empty() {
                    centre.fill(0.0);
                    for &i in &members {
                        centre.iter_mut().zip(rows.row(i)).for_each(|(c, &v)| *c += f64::from(v));
                    }
                    centre.iter_mut().for_each(|c| *c /= members.len() as f64);
                }
            }
            let next = assign(rows, &centres);
            if next == assignment {
                break;
            }
            assignment = next;
        }
        Self { centres, assignment }
    }

    /// The centre nearest to `x`.
    pub fn nearest(&self, x: &[f64]) -> usize {
        nearest(x.iter().copied(), &self.centres).0
    }
}

fn first_centres<R: Rng>(rows: &Inputs, n_clusters: usize, rng: &mut R) -> Vec<Vec<f64>> {
    let first = draw(&vec![0.0; rows.len()], rng);
    let mut centres = vec![rows.row_f64(first)];
    while centres.len() < n_clusters {
        let weights: Vec<f64> = (0..rows.len())
            .map(|i| nearest(rows.row(i).iter().map(|&v| f64::from(v)), &centres).1.ln())
            .collect();
        if weights.iter().all(|&w| w == f64::NEG_INFINITY) {
            break;
        }
        centres.push(rows.row_f64(draw(&weights, rng)));
    }
    centres
}

fn assign(rows: &Inputs, centres: &[Vec<f64>]) -> Vec<usize> {
    (0..rows.len()).map(|i| nearest(rows.row(i).iter().map(|&v| f64::from(v)), centres).0).collect()
}

/// The nearest centre and the squared distance to it.
fn nearest(x: impl Iterator<Item = f64> + Clone, centres: &[Vec<f64>]) -> (usize, f64) {
    let mut best = (0, f64::INFINITY);
    for (index, centre) in centres.iter().enumerate() {
        let distance = x.clone().zip(centre).map(|(a, b)| (a - b) * (a - b)).sum();
        if distance < best.1 {
            best = (index, distance);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_three_heaps() {
        let values = (0..90).map(|i| f64::from(i % 3) * 10.0 + f64::from(i) * 0.01);
        let rows = Inputs::from_rows(1, values).unwrap();
        let clusters = Clusters::new(&rows, 3, 5);
        assert!((0..90).all(|i| clusters.assignment[i] == clusters.assignment[i % 3]));
        let mut centres: Vec<f64> = clusters.centres.iter().map(|c| c[0]).collect();
        centres.sort_by(f64::total_cmp);
        // The mean of 0.00, 0.03 … 0.87, and the other two alike.
        for (centre, expected) in centres.iter().zip([0.435, 10.445, 20.455]) {
            assert!((centre - expected).abs() < 1e-5);
        }
        assert_eq!(clusters.nearest(&[9.0]), clusters.assignment[1]);
    }

    #[test]
    fn equal_rows_make_one_cluster() {
        let rows = Inputs::from_rows(2, [1.0; 20]).unwrap();
        assert_eq!(Clusters::new(&rows, 4, 0).centres.len(), 1);
    }
}
