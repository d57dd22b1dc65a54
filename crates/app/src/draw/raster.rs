//! A small z-buffer that shades a mesh.

use silhouette::Mask;

use super::canvas::Canvas;

/// A mesh as a camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct SeenMesh<'a> {
    /// Vertices in the image, [n_vertices], pixels; NaN where the camera does not see one.
    pub pixels: &'a [[f32; 2]],
    /// The same vertices in the camera frame, [n_vertices], metres.
    pub points_camera: &'a [[f32; 3]],
    /// Corners of each triangle, outward by the right-hand rule.
    pub triangles: &'a [[u32; 3]],
}

/// Samples a pixel along each axis.
const SAMPLES: u32 = 2;
/// Direction to the light, camera frame: over the viewer's left shoulder.
const LIGHT: [f32; 3] = [-0.36, -0.48, -0.8];
/// Brightness of a surface that faces away from the light.
const SHADOW: f32 = 0.35;

/// A mesh drawn on its own: which samples it covers and how bright each is.
pub(super) struct BodyLayer {
    /// Covered samples.
    pub coverage: Mask,
    brightness: Vec<f32>,
}

/// Samples per pixel along each axis of [`BodyLayer::coverage`].
pub(super) const COVERAGE_SCALE: f32 = 1.0 / SAMPLES as f32;

impl BodyLayer {
    /// Draws `mesh` for an image of `width` by `height` pixels.
    pub fn draw(mesh: &SeenMesh<'_>, width: u32, height: u32) -> Self {
        let (columns, rows) = (width * SAMPLES, height * SAMPLES);
        let mut layer = Self {
            coverage: Mask::new(columns, rows),
            brightness: vec![0.0; columns as usize * rows as usize],
        };
        let brightness = vertex_brightness(mesh);
        let mut nearness = vec![0.0; layer.brightness.len()];
        for triangle in mesh.triangles {
            let corners = triangle.map(|vertex| {
                let vertex = vertex as usize;
                let [x, y] = mesh.pixels[vertex].map(|value| value * SAMPLES as f32);
                Corner { x, y, nearness: 1.0 / mesh.points_camera[vertex][2], brightness: brightness[vertex] }
            });
            layer.fill(&corners, &mut nearness);
        }
        layer
    }

    /// Fills one triangle where it is nearer than what is there. Reciprocal depth is linear in the image.
    fn fill(&mut self, [a, b, c]: &[Corner; 3], nearness: &mut [f32]) {
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area.is_nan() || area == 0.0 || [a, b, c].iter().any(|corner| corner.nearness.is_nan()) {
            return;
        }
        let (columns, rows) = (self.coverage.width(), self.coverage.height());
        let range = |values: [f32; 3], size: u32| {
            let low = values.into_iter().fold(f32::INFINITY, f32::min).floor().clamp(0.0, size as f32);
            let high = values.into_iter().fold(f32::NEG_INFINITY, f32::max).ceil().clamp(0.0, size as f32);
            low as u32..high as u32
        };
        for y in range([a.y, b.y, c.y], rows) {
            for x in range([a.x, b.x, c.x], columns) {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let share_b = ((px - a.x) * (c.y - a.y) - (py - a.y) * (c.x - a.x)) / area;
                let share_c = ((b.x - a.x) * (py - a.y) - (b.y - a.y) * (px - a.x)) / area;
                let share_a = 1.0 - share_b - share_c;
                if share_a < 0.0 || share_b < 0.0 || share_c < 0.0 {
                    continue;
                }
                let near = share_a * a.nearness + share_b * b.nearness + share_c * c.nearness;
                let at = y as usize * columns as usize + x as usize;
                if near > nearness[at] {
                    nearness[at] = near;
                    self.brightness[at] =
                        share_a * a.brightness + share_b * b.brightness + share_c * c.brightness;
                    self.coverage.set(x, y, true);
                }
            }
        }
    }

    /// Lays the body over `canvas` in shades of `color`.
    pub fn blend_onto(&self, canvas: &mut Canvas, color: [u8; 3], opacity: f32) {
        let Some(covered) = self.coverage.bounding_box() else { return };
        let columns = self.coverage.width();
        for y in covered.y0 / SAMPLES..covered.y1.div_ceil(SAMPLES) {
            for x in covered.x0 / SAMPLES..covered.x1.div_ceil(SAMPLES) {
                let (mut count, mut sum) = (0, 0.0);
                for sample in 0..SAMPLES * SAMPLES {
                    let (sx, sy) = (x * SAMPLES + sample % SAMPLES, y * SAMPLES + sample / SAMPLES);
                    if self.coverage.get(sx, sy) {
                        count += 1;
                        sum += self.brightness[sy as usize * columns as usize + sx as usize];
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
        SHADOW + (1.0 - SHADOW) * (dot(*normal, LIGHT) / length).max(0.0)
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
        let brightness = |x: usize, y: usize| layer.brightness[y * 40 + x];
        assert!(brightness(20, 20) > 0.8, "lit, {}", brightness(20, 20));
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
