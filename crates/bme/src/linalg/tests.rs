use super::*;

/// A positive definite matrix without a pattern.
fn matrix(n: usize) -> Symmetric {
    let entry = |i: usize, k: usize| ((i * 31 + k * 17 + i * k) % 23) as f64 / 23.0 - 0.4;
    Symmetric::from_fn(n, |i, j| {
        (0..n).map(|k| entry(i, k) * entry(j, k)).sum::<f64>() + if i == j { 0.5 } else { 0.0 }
    })
}

#[test]
fn factor_inverse_and_solution_belong_to_the_matrix() {
    let a = matrix(23);
    let factor = a.cholesky().expect("it is positive definite");
    let inverse = factor.inverse();
    for i in 0..23 {
        let product = inverse.times(a.row(i));
        for (j, value) in product.iter().enumerate() {
            assert!((value - f64::from(u8::from(i == j))).abs() < 1e-10);
        }
    }
    let b: Vec<f64> = (0..23).map(|i| f64::from(i) - 7.0).collect();
    let back = a.times(&factor.solve(&b));
    assert!(back.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-10));
    // |A| by the eigenvalues; and not positive definite is noticed.
    let (values, vectors) = jacobi_eigen(&a);
    assert!((values.iter().map(|v| v.ln()).sum::<f64>() - factor.log_determinant()).abs() < 1e-9);
    assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
    for (value, vector) in values.iter().zip(&vectors) {
        assert!(a.times(vector).iter().zip(vector).all(|(x, v)| (x - value * v).abs() < 1e-9));
    }
    assert!(Symmetric::from_fn(2, |i, j| if i == j { 1.0 } else { 2.0 }).cholesky().is_none());
}

#[test]
fn whitened_squares_are_quadratic_forms() {
    let a = matrix(7);
    let rows: Vec<Vec<f64>> =
        (0..7).map(|i| (0..300).map(|j| ((i * j) % 13) as f64 - 5.0).collect()).collect();
    let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
    let factor = a.cholesky().unwrap();
    let mut squares = vec![0.0; 300];
    factor.whitened_squares(&rows, &mut squares);
    let inverse = factor.inverse();
    for (j, square) in squares.iter().enumerate() {
        let column: Vec<f64> = rows.iter().map(|row| row[j]).collect();
        assert!((square - inverse.quadratic(&column)).abs() < 1e-8 * (1.0 + square));
    }
}

#[test]
fn products_of_any_shape() {
    for (n_a, n_b, n) in [(1, 1, 1), (2, 40, 3_000), (3, 5, 7), (5, 300, 9)] {
        let a: Vec<f64> = (0..n_a * n).map(|i| f64::from(i as u32 % 7) - 2.0).collect();
        let b: Vec<f64> = (0..n_b * n).map(|i| f64::from(i as u32 % 5) - 1.0).collect();
        let mut out = vec![f64::NAN; n_a * n_b];
        products(&a, &b, n, &mut out);
        for i in 0..n_a {
            for j in 0..n_b {
                let plain: f64 = (0..n).map(|k| a[i * n + k] * b[j * n + k]).sum();
                assert_eq!(out[i * n_b + j], plain);
            }
        }
    }
}

#[test]
fn a_matrix_grows_and_shrinks() {
    let a = matrix(5);
    let mut b = a.clone();
    b.remove(2);
    assert_eq!(b.row(2)[3], a.row(3)[4]);
    b.push(&[1.0, 2.0, 3.0, 4.0], 9.0);
    assert_eq!((b.row(4)[1], b.row(1)[4], b.diagonal(4)), (2.0, 2.0, 9.0));
    assert_eq!(Symmetric::from_lower_triangle(5, &a.lower_triangle()), Some(a));
    assert_eq!(Symmetric::from_lower_triangle(3, &[1.0; 5]), None);
}

#[test]
fn shares_of_impossible_rows_are_even() {
    let none = f64::NEG_INFINITY;
    assert_eq!(shares(&[none; 4]), [0.25; 4]);
    assert_eq!(shares(&[none, -1e5, none]), [0.0, 1.0, 0.0]);
    let [a, b]: [f64; 2] = shares(&[1000.0, 1000.0 + 3f64.ln()]).try_into().unwrap();
    assert!((a - 0.25).abs() < 1e-9 && (b - 0.75).abs() < 1e-9);
}
