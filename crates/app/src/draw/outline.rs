//! Outlines of a mask as polygons.

use silhouette::Mask;

/// A closed polygon along pixel edges, simplified, in pixels; the last point joins the first.
pub type Outline = Vec<[f32; 2]>;

/// How far a simplified outline may leave the pixel edges, pixels.
const TOLERANCE_PX: f32 = 0.75;

/// The outlines of all parts and holes of `mask` that enclose at least `least_area` pixels, multiplied by `scale`.
/// Parts run clockwise as seen on the screen, holes anticlockwise.
pub fn outlines(mask: &Mask, least_area: f32, scale: f32) -> Vec<Outline> {
    let mut visited = Mask::new(mask.width(), mask.height());
    let mut found = Vec::new();
    for y in 0..mask.height() {
        for (start, _) in mask.runs(y) {
            // Every loop has a left edge, and a left edge is where a run starts.
            if visited.get(start, y) {
                continue;
            }
            let corners = follow(mask, &mut visited, start, y);
            if signed_area(&corners).abs() >= least_area {
                found.push(simplified(&corners).iter().map(|[x, y]| [x * scale, y * scale]).collect());
            }
        }
    }
    found
}

/// Follows pixel edges with the person on the right hand, starting up the left edge of pixel (`x`, `y`). Marks the
/// pixels whose left edges it takes upwards.
fn follow(mask: &Mask, visited: &mut Mask, x: u32, y: u32) -> Vec<[f32; 2]> {
    // Steps to the right, down, left and up: a turn to the right adds 1.
    const STEP: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    // Pixel ahead on the right hand of a corner, by direction; that on the left hand is the next one round.
    const AHEAD_RIGHT: [[i64; 2]; 4] = [[0, 0], [-1, 0], [-1, -1], [0, -1]];
    const UP: usize = 3;
    let start = [i64::from(x), i64::from(y) + 1];
    let (mut at, mut direction) = (start, UP);
    let mut corners = Vec::new();
    loop {
        if direction == UP {
            visited.set(at[0] as u32, at[1] as u32 - 1, true);
        }
        at = [at[0] + STEP[direction][0], at[1] + STEP[direction][1]];
        let is_person = |offset: [i64; 2]| mask.get_or_background(at[0] + offset[0], at[1] + offset[1]);
        let next = if is_person(AHEAD_RIGHT[(direction + 3) % 4]) {
            (direction + 3) % 4
        } else if is_person(AHEAD_RIGHT[direction]) {
            direction
        } else {
            (direction + 1) % 4
        };
        if next != direction {
            corners.push([at[0] as f32, at[1] as f32]);
        }
        direction = next;
        if at == start && direction == UP {
            return corners;
        }
    }
}

/// Area inside a polygon, positive when it runs clockwise on the screen.
fn signed_area(points: &[[f32; 2]]) -> f32 {
    let next = points.iter().cycle().skip(1);
    0.5 * points.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f32>()
}

/// The middles of the steps, thinned out by the rule of Douglas and Peucker.
fn simplified(corners: &[[f32; 2]]) -> Outline {
    let next = corners.iter().cycle().skip(1);
    let middles: Vec<[f32; 2]> =
        corners.iter().zip(next).map(|(a, b)| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]).collect();
    if middles.len() < 8 {
        return corners.to_vec();
    }
    let first = middles[0];
    let distance2 = |p: &[f32; 2]| (p[0] - first[0]).powi(2) + (p[1] - first[1]).powi(2);
    let farthest =
        (0..middles.len()).max_by(|&a, &b| distance2(&middles[a]).total_cmp(&distance2(&middles[b])));
    let farthest = farthest.expect("there are at least 8 points");
    let mut back = middles[farthest..].to_vec();
    back.push(first);
    let mut kept = Vec::new();
    keep_far_points(&middles[..=farthest], &mut kept);
    keep_far_points(&back, &mut kept);
    kept
}

/// Pushes the points of an open line that matter, without its last.
fn keep_far_points(line: &[[f32; 2]], kept: &mut Outline) {
    let (a, b) = (line[0], line[line.len() - 1]);
    let (ab_x, ab_y) = (b[0] - a[0], b[1] - a[1]);
    let length = ab_x.hypot(ab_y);
    let distance = |p: &[f32; 2]| {
        let (x, y) = (p[0] - a[0], p[1] - a[1]);
        if length > 0.0 { (x * ab_y - y * ab_x).abs() / length } else { x.hypot(y) }
    };
    let inner = 1..line.len().max(2) - 1;
    match inner.max_by(|&i, &j| distance(&line[i]).total_cmp(&distance(&line[j]))) {
        Some(split) if distance(&line[split]) > TOLERANCE_PX => {
            keep_far_points(&line[..=split], kept);
            keep_far_points(&line[split..], kept);
        }
        _ => kept.push(a),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(text: &str) -> Mask {
        text.parse().expect("the text is a mask")
    }

    #[test]
    fn a_square_has_four_corners() {
        let square = mask("....\n.##.\n.##.\n....");
        assert_eq!(outlines(&square, 1.0, 2.0), [vec![[2.0, 2.0], [6.0, 2.0], [6.0, 6.0], [2.0, 6.0]]]);
        assert!(outlines(&square, 5.0, 1.0).is_empty(), "it encloses only 4 pixels");
    }

    #[test]
    fn parts_and_holes_enclose_their_pixels() {
        let ring = mask("#####\n#...#\n#.#.#\n#...#\n#####");
        let areas: Vec<f32> = outlines(&ring, 0.0, 1.0).iter().map(|o| signed_area(o)).collect();
        assert_eq!(areas, [25.0, -9.0, 1.0]);
    }

    #[test]
    fn a_disc_is_thinned_out_and_keeps_its_area() {
        let disc = Mask::from_fn(200, 200, |x, y| (f64::from(x) - 99.5).hypot(f64::from(y) - 99.5) < 80.0);
        let found = outlines(&disc, 10.0, 1.0);
        assert_eq!(found.len(), 1);
        assert!(found[0].len() < 80, "{} points", found[0].len());
        let area = f64::from(signed_area(&found[0]));
        assert!((area / disc.area() as f64 - 1.0).abs() < 0.01, "{area}");
    }
}
