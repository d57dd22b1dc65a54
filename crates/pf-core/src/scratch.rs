//! Short-lived buffers without allocations: one stack of them per thread, kept between uses.

use std::cell::RefCell;

thread_local! {
    static BUFFERS: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
}

/// Calls `work` with a buffer of `len` zeros. Calls may be nested; each gets its own buffer.
///
/// A [`Proposal`](crate::Proposal) or [`Mutation`](crate::Mutation) that needs room for an increment finds it here.
///
/// ```
/// let norm = pf_core::scratch::with_buffer(2, |delta| {
///     delta.copy_from_slice(&[3.0, 4.0]);
///     delta.iter().map(|d| d * d).sum::<f64>().sqrt()
/// });
/// assert_eq!(norm, 5.0);
/// ```
pub fn with_buffer<R>(len: usize, work: impl FnOnce(&mut [f64]) -> R) -> R {
    let mut buffer = BUFFERS.with_borrow_mut(Vec::pop).unwrap_or_default();
    buffer.clear();
    buffer.resize(len, 0.0);
    let result = work(&mut buffer);
    BUFFERS.with_borrow_mut(|buffers| buffers.push(buffer));
    result
}
