//! Laplacian eigenmaps: coordinates in which neighbours stay neighbours.

use crate::Inputs;
use crate::linalg::{Symmetric, add_scaled, dot, jacobi_eigen};

/// Vectors iterated beyond those wanted: they take up what converges slowly.
const GUARD_VECTORS: usize = 10;
/// Most rounds of inverse iteration.
const ROUNDS: usize = 200;
/// Relative change of the eigenvalues at which the iteration has settled.
const SETTLED: f64 = 1e-12;

/// Spectral coordinates of rows, [n_rows][n_dims], each of mean 0 and variance 1.
///
/// `[Belkin2003]`: a graph of mutual `n_neighbours` nearest rows with heat weights exp(−|y − y′|²/t), t the mean squared
/// distance of neighbours; the eigenvectors of L f = λ D f with the smallest λ, the constant one left out. Parts that do
/// not hang together are joined by their shortest links, so that a coordinate never only tells the parts apart.
///
/// Cost: n² distances and one Cholesky factor of n × n.
///
/// # Panics
/// When there are not more rows than dimensions + 1, or no neighbours are asked for.
pub(crate) fn laplacian_eigenmaps(
    rows: &Inputs,
    n_dims: usize,
    n_neighbours: usize,
) -> Option<Vec<Vec<f64>>> {
    let n = rows.len();
    assert!(n > n_dims + 1, "{n} rows for {n_dims} dimensions, expected more than {}", n_dims + 1);
    assert!(n_neighbours > 0, "no neighbours, expected at least one");
    let distances = squared_distances(rows);
    let mut edges = neighbour_edges(&distances, n, n_neighbours);
    let scale = edges.iter().map(|&(i, j)| distances[i * n + j]).sum::<f64>() / edges.len() as f64;
    edges.extend(joining_edges(&distances, n, &edges));
    let mut weights = vec![0.0; n * n];
    for (i, j) in edges {
        // Never zero: a bridge between far parts has to hold.
        let weight = if scale > 0.0 { (-distances[i * n + j] / scale).exp().max(1e-6) } else { 1.0 };
        weights[i * n + j] = weight;
        weights[j * n + i] = weight;
    }
    let degrees: Vec<f64> = weights.chunks_exact(n).map(|row| row.iter().sum()).collect();
    // 1 − D^-½ W D^-½ has the eigenvalues λ; f = D^-½ u.
    let laplacian = Symmetric::from_fn(n, |i, j| {
        f64::from(u8::from(i == j)) - weights[i * n + j] / (degrees[i] * degrees[j]).sqrt()
    });
    let constant: Vec<f64> = degrees.iter().map(|d| d.sqrt()).collect();
    let vectors = smallest_eigenvectors(&laplacian, &constant, n_dims)?;
    let mut coordinates = vec![vec![0.0; n_dims]; n];
    for d in 0..n_dims {
        let column: Vec<f64> = (0..n).map(|i| vectors[d][i] / degrees[i].sqrt()).collect();
        let mean = column.iter().sum::<f64>() / n as f64;
        let deviation = (column.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        // An eigenvector has no sign of its own: the entry farthest from the mean is made positive.
        let farthest =
            column.iter().fold(0.0_f64, |far, v| if (v - mean).abs() > far.abs() { v - mean } else { far });
        let sign = farthest.signum() / deviation.max(f64::MIN_POSITIVE);
        coordinates.iter_mut().zip(&column).for_each(|(row, v)| row[d] = (v - mean) * sign);
    }
    Some(coordinates)
}

/// The eigenvectors of the smallest eigenvalues that are orthogonal to `constant`, by block inverse iteration.
///
/// `None` where the factorisation fails.
fn smallest_eigenvectors(laplacian: &Symmetric, constant: &[f64], count: usize) -> Option<Vec<Vec<f64>>> {
    let n = constant.len();
    let size = (count + GUARD_VECTORS).min(n - 1);
    // The shift makes it positive definite; the constant, the one null vector, is taken out of every iterate.
    let shifted = Symmetric::from_fn(n, |i, j| laplacian.row(i)[j] + if i == j { 1e-9 } else { 0.0 });
    let factor = shifted.cholesky()?;
    // Starting vectors: cosines of rising frequency, which no symmetry of a graph makes orthogonal to what is sought.
    let mut basis: Vec<Vec<f64>> = (0..size)
        .map(|k| (0..n).map(|i| ((i * i % 1009) as f64 * 0.37 + (i * (k + 1)) as f64 * 1.7).cos()).collect())
        .collect();
    let mut previous = vec![0.0; size];
    for _ in 0..ROUNDS {
        basis = basis.iter().map(|v| factor.solve(v)).collect();
        orthonormalise(&mut basis, constant);
        // Rayleigh-Ritz: the best vectors within the span.
        let images: Vec<Vec<f64>> = basis.iter().map(|v| laplacian.times(v)).collect();
        let projected = Symmetric::from_fn(size, |i, j| dot(&basis[i.min(j)], &images[i.max(j)]));
        let (values, vectors) = jacobi_eigen(&projected);
        basis = vectors
            .iter()
            .rev()
            .map(|coefficients| {
                let mut v = vec![0.0; n];
                coefficients.iter().zip(&basis).for_each(|(c, b)| add_scaled(&mut v, *c, b));
                v
            })
            .collect();
        let values: Vec<f64> = values.into_iter().rev().collect();
        let moved = values
            .iter()
            .zip(&previous)
            .take(count)
            .any(|(new, old)| (new - old).abs() > SETTLED * new.abs());
        previous = values;
        if !moved {
            break;
        }
    }
    basis.truncate(count);
    Some(basis)
}

/// Gram-Schmidt, twice over, against `constant` and one another.
fn orthonormalise(basis: &mut [Vec<f64>], constant: &[f64]) {
    let square = dot(constant, constant);
    for k in 0..basis.len() {
        let (before, from) = basis.split_at_mut(k);
        let v = &mut from[0];
        for _ in 0..2 {
            let share = dot(v, constant) / square;
            add_scaled(v, -share, constant);
            for b in before.iter() {
                let share = dot(v, b);
                add_scaled(v, -share, b);
            }
            let norm = dot(v, v).sqrt();
            v.iter_mut().for_each(|x| *x /= norm);
        }
    }
}

/// |y_i − y_j|², row after row.
fn squared_distances(rows: &Inputs) -> Vec<f64> {
    let n = rows.len();
    let mut distances = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..i {
            let square = rows.row(i).iter().zip(rows.row(j)).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            distances[i * n + j] = square;
            distances[j * n + i] = square;
        }
    }
    distances
}

/// Pairs (i < j) of which one is among the nearest of the other.
fn neighbour_edges(distances: &[f64], n: usize, n_neighbours: usize) -> Vec<(usize, usize)> {
    let mut edges = Vec::with_capacity(n * n_neighbours);
    for i in 0..n {
        let mut others: Vec<usize> = (0..n).filter(|&j| j != i).collect();
        others.sort_by(|&a, &b| distances[i * n + a].total_cmp(&distances[i * n + b]).then(a.cmp(&b)));
        edges.extend(others.into_iter().take(n_neighbours).map(|j| (i.min(j), i.max(j))));
    }
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// The shortest links that make one part of many: Kruskal's spanning tree over the parts.
fn joining_edges(distances: &[f64], n: usize, edges: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut part: Vec<usize> = (0..n).collect();
    let join = |part: &mut Vec<usize>, i: usize, j: usize| {
        let (from, to) = (part[i].max(part[j]), part[i].min(part[j]));
        part.iter_mut().filter(|p| **p == from).for_each(|p| *p = to);
    };
    for &(i, j) in edges {
        if part[i] != part[j] {
            join(&mut part, i, j);
        }
    }
    let mut links = Vec::new();
    while let Some((i, j)) = (0..n)
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .filter(|&(i, j)| part[i] != part[j])
        .min_by(|&(a, b), &(c, d)| distances[a * n + b].total_cmp(&distances[c * n + d]))
    {
        join(&mut part, i, j);
        links.push((j, i));
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_becomes_sine_and_cosine() {
        // The graph of a ring is known: its first two eigenvectors are cos and sin of the angle.
        let n = 60;
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        let values = (0..n).flat_map(|i| [angle(i).cos(), angle(i).sin(), 0.0]);
        let rows = Inputs::from_rows(3, values).unwrap();
        let embedding = laplacian_eigenmaps(&rows, 2, 2).unwrap();
        for i in 0..n {
            let radius = (embedding[i][0].powi(2) + embedding[i][1].powi(2)).sqrt();
            assert!((radius - 2.0_f64.sqrt()).abs() < 1e-3, "radius {radius} at {i}");
            let next = &embedding[(i + 1) % n];
            let step = ((embedding[i][0] - next[0]).powi(2) + (embedding[i][1] - next[1]).powi(2)).sqrt();
            assert!((step - 2.0 * 2.0_f64.sqrt() * (angle(1) / 2.0).sin()).abs() < 1e-3);
        }
    }

    #[test]
    fn a_path_becomes_a_line() {
        let rows = Inputs::from_rows(1, (0..30).map(f64::from)).unwrap();
        let embedding = laplacian_eigenmaps(&rows, 1, 1).unwrap();
        let rising = embedding.windows(2).all(|pair| pair[1][0] > pair[0][0]);
        let falling = embedding.windows(2).all(|pair| pair[1][0] < pair[0][0]);
        assert!(rising || falling);
    }

    #[test]
    fn parts_are_joined_where_they_are_nearest() {
        let values = (0..20).map(|i| f64::from(i) + if i < 10 { 0.0 } else { 100.0 });
        let rows = Inputs::from_rows(1, values).unwrap();
        let distances = squared_distances(&rows);
        let edges = neighbour_edges(&distances, 20, 2);
        assert_eq!(joining_edges(&distances, 20, &edges), [(9, 10)]);
    }
}
