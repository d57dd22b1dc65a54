//! A small z-buffer that shades a mesh.

use std::ops::Range;

use silhouette::Mask;

use super::canvas::Canvas;

/// A mesh as a camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct SeenMesh<'a> {
    /// Vertices in the image, `[n_vertices]`, pixels; NaN where the camera does not see one.
    pub pixels: &'a [[f32; 2]],
    /// The same vertices in the camera frame, `[n_vertices]`, metres.
    pub points_camera: &'a [[f32; 3]],
    /// Corners of each triangle, outward by the right-hand rule.
    pub triangles: &'a [[u32; 3]],
}

/// Samples a pixel along each axis.
const SAMPLES: u32 = 2;
/// Direction to the light, camera frame: over the viewer's left shoulder.
const LIGHT: [f32; 3] = [-0.36, -0.48, -0.8];
/// Brightness of a surface that faces away from the light, and what one that faces it has more.
const SHADOW: f32 = 0.5;
const GLOW: f32 = 0.6;

/// A mesh drawn on its own: which samples it covers and how bright each is.
pub(super) struct BodyLayer {
    /// Covered samples of the whole image.
    pub coverage: Mask,
    /// The samples about the mesh: columns and rows.
    columns: Range<u32>,
    rows: Range<u32>,
    /// Brightness of the samples about the mesh, `[rows][columns]`.
    brightness: Vec<f32>,
    /// Reciprocal depth of the same samples, 1/metres; 0 where nothing is.
    nearness: Vec<f32>,
}

/// Samples per pixel along each axis of [`BodyLayer::coverage`].
pub(super) const COVERAGE_SCALE: f32 = 1.0 / SAMPLES as f32;

impl BodyLayer {
    /// Draws `mesh` for an image of `width` by `height` pixels.
    pub fn draw(mesh: &SeenMesh<'_>, width: u32, height: u32) -> Self {
        let coverage = Mask::new(width * SAMPLES, height * SAMPLES);
        let along = |axis: usize| mesh.pixels.iter().map(move |pixel| pixel[axis] * SAMPLES as f32);
        let columns = samples_between(along(0), coverage.width());
        let rows = samples_between(along(1), coverage.height());
        let n_samples = columns.len() * rows.len();
        let (brightness, nearness) = (vec![0.0; n_samples], vec![0.0; n_samples]);
        let mut layer = Self { coverage, columns, rows, brightness, nearness };
        let brightness = vertex_brightness(mesh);
        for triangle in mesh.triangles {
            layer.fill(&triangle.map(|vertex| {
                let vertex = vertex as usize;
                let [x, y] = mesh.pixels[vertex].map(|value| value * SAMPLES as f32);
                Corner { x, y, nearness: 1.0 / mesh.points_camera[vertex][2], brightness: brightness[vertex] }
            }));
        }
        layer
    }

    /// Fills one triangle where it is nearer than what is there. Reciprocal depth is linear in the image.
    fn fill(&mut self, [a, b, c]: &[Corner; 3]) {
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area.is_nan() || area == 0.0 {
            return;
        }
        let scale = 1.0 / area;
        let columns = samples_between([a.x, b.x, c.x].into_iter(), self.coverage.width());
        for y in samples_between([a.y, b.y, c.y].into_iter(), self.coverage.height()) {
            for x in columns.clone() {
                let (px, py) = (x as f32 + 0.5 - a.x, y as f32 + 0.5 - a.y);
                let share_b = (px * (c.y - a.y) - py * (c.x - a.x)) * scale;
                let share_c = ((b.x - a.x) * py - (b.y - a.y) * px) * scale;
                let share_a = 1.0 - share_b - share_c;
                if share_a < 0.0 || share_b < 0.0 || share_c < 0.0 {
                    continue;
                }
                let near = share_a * a.nearness + share_b * b.nearness + share_c * c.nearness;
                let at = self.sample(x, y);
                if near > self.nearness[at] {
                    self.nearness[at] = near;
                    self.brightness[at] =
                        share_a * a.brightness + share_b * b.brightness + share_c * c.brightness;
                    self.coverage.set(x, y, true);
                }
            }
        }
    }

    /// Where a sample about the mesh lies in the buffers.
    fn sample(&self, x: u32, y: u32) -> usize {
        (y - self.rows.start) as usize * self.columns.len() + (x - self.columns.start) as usize
    }

    /// Lays the body over `canvas` in shades of `color`.
    pub fn blend_onto(&self, canvas: &mut Canvas, color: [u8; 3], opacity: f32) {
        let Some(covered) = self.coverage.bounding_box() else { return };
        for y in covered.y0 / SAMPLES..covered.y1.div_ceil(SAMPLES) {
            for x in covered.x0 / SAMPLES..covered.x1.div_ceil(SAMPLES) {
                let (mut count, mut sum) = (0, 0.0);
                for sample in 0..SAMPLES * SAMPLES {
                    let (sx, sy) = (x * SAMPLES + sample % SAMPLES, y * SAMPLES + sample / SAMPLES);
                    if self.coverage.get(sx, sy) {
                        count += 1;
                        sum += self.brightness[self.sample(sx, sy)];
                    }
                }
                if count > 0 {
                    let brightness = sum / count as f32;
                    let shaded = color.map(|value| (f32::from(value) * brightness).min(255.0) as u8);
                    let coverage = count as f32 / (SAMPLES * SAMPLES) as f32;
                    canvas.blend(i64::from(x), i64::from(y), shaded, coverage * opacity);
                }
            }
        }
    }
}

struct Corner {
    x: f32,
    y: f32,
    /// Reciprocal of the depth, 1/metres.
    nearness: f32,
    brightness: f32,
}

/// The samples, of `size`, that some coordinates span; NaN among them counts for nothing.
fn samples_between(coordinates: impl Iterator<Item = f32>, size: u32) -> Range<u32> {
    let (low, high) = coordinates
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    let end = high.ceil().clamp(0.0, size as f32) as u32;
    (low.floor().clamp(0.0, size as f32) as u32).min(end)..end
}

/// Brightness of each vertex from its normal, the area-weighted mean over its triangles.
fn vertex_brightness(mesh: &SeenMesh<'_>) -> Vec<f32> {
    let mut normals = vec![[0.0_f32; 3]; mesh.points_camera.len()];
    for triangle in mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| mesh.points_camera[vertex as usize]);
        let (ab, ac) = (difference(b, a), difference(c, a));
        let normal =
            [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
        for vertex in triangle {
            normals[*vertex as usize].iter_mut().zip(normal).for_each(|(sum, part)| *sum += part);
        }
    }
    let brightness = |normal: &[f32; 3]| {
        let length = dot(*normal, *normal).sqrt().max(f32::MIN_POSITIVE);
        SHADOW + GLOW * (dot(*normal, LIGHT) / length).max(0.0)
    };
    normals.iter().map(brightness).collect()
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares over each other, facing the camera; pixel = 10 + 20 x / z.
    #[test]
    fn the_nearer_surface_wins_and_covers_its_area() {
        let points_camera = [
            [-0.4, -0.4, 1.0],
            [0.4, -0.4, 1.0],
            [0.4, 0.4, 1.0],
            [-0.4, 0.4, 1.0],
            [-1.0, -1.0, 2.0],
            [1.0, -1.0, 2.0],
            [1.0, 1.0, 2.0],
            [-1.0, 1.0, 2.0],
        ];
        let pixels = points_camera.map(|[x, y, z]| [10.0 + 20.0 * x / z, 10.0 + 20.0 * y / z]);
        // The near square faces the camera, the far one shows its back.
        let triangles = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]];
        let mesh = SeenMesh { pixels: &pixels, points_camera: &points_camera, triangles: &triangles };
        let layer = BodyLayer::draw(&mesh, 20, 20);
        assert_eq!(layer.coverage.area(), 40 * 40, "20 x 20 pixels at 2 x 2 samples");
        let brightness = |x: u32, y: u32| layer.brightness[layer.sample(x, y)];
        assert!(brightness(20, 20) > SHADOW + 0.7 * GLOW, "lit, {}", brightness(20, 20));
        assert!((brightness(2, 2) - SHADOW).abs() < 1e-6, "turned away");
    }

    #[test]
    fn unseen_vertices_are_left_out() {
        let points_camera = [[0.0, 0.0, -1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let pixels = [[f32::NAN; 2], [30.0, 10.0], [10.0, 30.0]];
        let mesh = SeenMesh { pixels: &pixels, points_camera: &points_camera, triangles: &[[0, 1, 2]] };
        assert!(BodyLayer::draw(&mesh, 20, 20).coverage.is_empty());
    }
}
