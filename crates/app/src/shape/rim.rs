//! The rim of a posed body: where its silhouette ends, and how the mask lies to it.

use body::Camera;
use glam::{DMat3, DVec2, DVec3};
use silhouette::clean::{Components, Connectivity};
use silhouette::{Contour, DistanceField, Mask};

use super::figure::{Edge, Posed};

/// Pixels from the rim at which the body's own silhouette must have ended.
const JUST_OUTSIDE_PX: f64 = 1.3;
/// Holes of a mask up to this share of its area are taken for faults of the segmentation.
const SMALL_HOLE_SHARE: f64 = 0.004;
/// Distance between the points of a mask's outline, pixels.
pub const OUTLINE_STEP_PX: f64 = 4.0;
/// Margin of the distance field about a mask.
const FIELD_MARGIN_PX: u32 = 24;

/// A point of the rim.
#[derive(Clone, Copy, Debug)]
pub struct RimPoint {
    /// Ends of its edge; it lies in the middle.
    pub vertices: [u32; 2],
    /// Where it is seen, pixels.
    pub pixel: DVec2,
    /// Away from the body, unit, image.
    pub normal: DVec2,
    /// Length of its edge in the image, pixels.
    pub length_px: f64,
    /// Directions of the world in which the point moves by a pixel a metre along x and y of the image.
    pub pixel_per_m: [DVec3; 2],
}

/// A mask, prepared.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Distance from its outline.
    pub field: DistanceField,
    /// Points of its outer outline and the outward normals there.
    pub outline: Vec<(DVec2, DVec2)>,
    /// Whether the person touches the edge of the image.
    pub is_cropped: bool,
    /// Person pixels.
    pub area: u64,
}

impl Seen {
    /// Keeps the largest piece of the mask, without its small holes; `None` when nobody is on it.
    pub fn of(mask: &Mask) -> Option<Self> {
        let person = person_of(mask)?;
        let field = DistanceField::of(&person, FIELD_MARGIN_PX)?;
        let outline = outline_of(&person)?.into_iter().map(|point| {
            let (_, gradient) = field.with_gradient(point.to_array());
            (point, DVec2::from_array(gradient).normalize_or_zero())
        });
        Some(Self { outline: outline.collect(), is_cropped: is_cropped(&person), area: person.area(), field })
    }
}

/// The largest piece of the mask, without its small holes; `None` when nobody is on it.
pub fn person_of(mask: &Mask) -> Option<Mask> {
    let pieces = Components::of(mask, Connectivity::Eight);
    let largest = pieces.largest()?;
    let piece = pieces.select(|index| index == largest);
    Some(piece.with_holes_filled((SMALL_HOLE_SHARE * piece.area() as f64) as u64))
}

/// Points along the outer outline, [`OUTLINE_STEP_PX`] apart.
pub fn outline_of(person: &Mask) -> Option<Vec<DVec2>> {
    let contour = Contour::outer(person)?;
    let n_points = (contour.length_px() / OUTLINE_STEP_PX).ceil().max(3.0) as usize;
    Some(contour.resampled(n_points).into_iter().map(DVec2::from_array).collect())
}

/// Whether the person touches the edge of the image.
pub fn is_cropped(person: &Mask) -> bool {
    person.bounding_box().is_some_and(|rect| {
        rect.x0 == 0 || rect.y0 == 0 || rect.x1 == person.width() || rect.y1 == person.height()
    })
}

/// The points of the rim of `posed` as `camera` sees it. Where one part of the body lies before another there is no rim.
pub fn rim(posed: &Posed<'_>, triangles: &[[u32; 3]], edges: &[Edge], camera: &Camera) -> Vec<RimPoint> {
    let camera_from_world = camera.camera_from_world();
    let in_camera: Vec<DVec3> =
        posed.vertices.iter().map(|vertex| camera_from_world.transform_point3(*vertex)).collect();
    let pixels: Vec<Option<DVec2>> =
        in_camera.iter().map(|&point| camera.project_from_camera(point)).collect();
    let mut own = Shade::new(camera.intrinsics().width, camera.intrinsics().height);
    let faces: Vec<bool> = triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.map(|vertex| in_camera[vertex as usize]);
            let is_front = (b - a).cross(c - a).dot(a) < 0.0;
            if let ([Some(a), Some(b), Some(c)], true) =
                (triangle.map(|vertex| pixels[vertex as usize]), is_front)
            {
                own.fill([a, b, c]);
            }
            is_front
        })
        .collect();
    let point = |edge: &Edge| {
        let [first, second] = edge.triangles.map(|triangle| faces[triangle as usize]);
        if first == second {
            return None;
        }
        let [a, b] = edge.vertices.map(|vertex| pixels[vertex as usize]);
        let (a, b, inner) = (a?, b?, pixels[edge.opposite[usize::from(second)] as usize]?);
        let [from, to] = edge.vertices.map(|vertex| in_camera[vertex as usize]);
        let (pixel, pixel_per_m) = projected(camera, 0.5 * (from + to))?;
        let outward = (b - a).normalize_or_zero().perp();
        let normal = if outward.dot(inner - pixel) > 0.0 { -outward } else { outward };
        let is_rim =
            own.is_in_image(pixel) && normal != DVec2::ZERO && !own.covers(pixel + JUST_OUTSIDE_PX * normal);
        is_rim.then(|| RimPoint {
            vertices: edge.vertices,
            pixel,
            normal,
            length_px: a.distance(b),
            pixel_per_m,
        })
    };
    edges.iter().filter_map(point).collect()
}

/// Pixels that the body covers: the union of the triangles that face the camera.
struct Shade {
    width: usize,
    height: usize,
    covered: Vec<bool>,
}

impl Shade {
    fn new(width: u32, height: u32) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, covered: vec![false; width * height] }
    }

    /// Covers the pixels whose centres lie in the triangle.
    fn fill(&mut self, corners: [DVec2; 3]) {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let first = (low.y - 0.5).ceil().clamp(0.0, self.height as f64) as usize;
        let end = ((high.y - 0.5).floor() + 1.0).clamp(0.0, self.height as f64) as usize;
        for row in first..end {
            let y = row as f64 + 0.5;
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if (p.y <= y) != (q.y <= y) {
                    let x = p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x);
                    (left, right) = (left.min(x), right.max(x));
                }
            }
            let start = (left - 0.5).ceil().clamp(0.0, self.width as f64) as usize;
            let end = ((right - 0.5).floor() + 1.0).clamp(0.0, self.width as f64) as usize;
            if start < end {
                self.covered[row * self.width + start..row * self.width + end].fill(true);
            }
        }
    }

    fn is_in_image(&self, pixel: DVec2) -> bool {
        (0.0..self.width as f64).contains(&pixel.x) && (0.0..self.height as f64).contains(&pixel.y)
    }

    fn covers(&self, pixel: DVec2) -> bool {
        self.is_in_image(pixel) && self.covered[pixel.y as usize * self.width + pixel.x as usize]
    }
}

/// Where a point in camera coordinates is seen, and the rows of the derivative by its place in the world.
fn projected(camera: &Camera, point: DVec3) -> Option<(DVec2, [DVec3; 2])> {
    const STEP_M: f64 = 1e-4;
    let pixel = camera.project_from_camera(point)?;
    let mut columns = [DVec2::ZERO; 3];
    for (column, axis) in columns.iter_mut().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
        *column = (camera.project_from_camera(point + STEP_M * axis)? - pixel) / STEP_M;
    }
    let rotation: DMat3 = camera.rotation().transpose();
    let row =
        |of: fn(&DVec2) -> f64| rotation * DVec3::new(of(&columns[0]), of(&columns[1]), of(&columns[2]));
    Some((pixel, [row(|c| c.x), row(|c| c.y)]))
}
