//! Filled polygons in masks.

use silhouette::Mask;

/// Sets every pixel whose centre lies inside the polygon, by the even-odd rule; corners in pixels.
pub(super) fn fill(mask: &mut Mask, corners_px: &[[f64; 2]], is_person: bool) {
    let rows = corners_px.iter().map(|corner| corner[1]);
    let (low, high) =
        rows.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
    let first = low.floor().max(0.0) as u32;
    let last = high.ceil().clamp(0.0, f64::from(mask.height())) as u32;
    let mut crossings = Vec::new();
    for y in first..last {
        let centre = f64::from(y) + 0.5;
        crossings.clear();
        for (index, a) in corners_px.iter().enumerate() {
            let b = corners_px[(index + 1) % corners_px.len()];
            if (a[1] <= centre) != (b[1] <= centre) {
                crossings.push(a[0] + (centre - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for span in crossings.chunks_exact(2) {
            let start = (span[0] - 0.5).ceil().max(0.0) as u32;
            let end = (span[1] - 0.5).ceil().clamp(0.0, f64::from(mask.width())) as u32;
            (start..end).for_each(|x| mask.set(x, y, is_person));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_has_its_area() {
        let mut mask = Mask::new(200, 100);
        let corner = |k: u32| {
            let angle = f64::from(k) * std::f64::consts::TAU / 180.0;
            [100.3 + 60.0 * angle.cos(), 49.8 + 30.0 * angle.sin()]
        };
        fill(&mut mask, &(0..180).map(corner).collect::<Vec<_>>(), true);
        let exact = std::f64::consts::PI * 60.0 * 30.0;
        assert!((mask.area() as f64 / exact - 1.0).abs() < 0.005, "{} instead of {exact}", mask.area());
    }

    #[test]
    fn what_lies_outside_the_image_is_cut_off() {
        let mut mask = Mask::new(10, 10);
        fill(&mut mask, &[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]], true);
        assert_eq!(mask.area(), 25);
    }
}
