//! What every scorer must get right: cases to run any implementation against, and the judge.

use crate::camera::Intrinsics;
use crate::project::NEAR_M;
use crate::raster::Silhouette;
use crate::reference::ReferenceScorer;
use crate::rows::RowStep;
use crate::scorer::{MeshBatch, OverlapCounts, ScoreError, SilhouetteScorer, TargetError};

/// A mesh: vertices and triangles.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Vertices, metres.
    pub positions: Vec<[f32; 3]>,
    /// Corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A sphere about the origin, cut along circles of latitude and longitude.
    pub fn sphere(radius_m: f32, n_rings: u32, n_sectors: u32) -> Self {
        let mut positions = vec![[0.0, -radius_m, 0.0]];
        for ring in 1..n_rings {
            let latitude = std::f32::consts::PI * ring as f32 / n_rings as f32;
            for sector in 0..n_sectors {
                let longitude = std::f32::consts::TAU * sector as f32 / n_sectors as f32;
                let across = latitude.sin();
                let unit = [across * longitude.cos(), -latitude.cos(), across * longitude.sin()];
                positions.push(unit.map(|c| radius_m * c));
            }
        }
        positions.push([0.0, radius_m, 0.0]);
        let (top, bottom) = (0, positions.len() as u32 - 1);
        let at = |ring: u32, sector: u32| 1 + ring * n_sectors + sector % n_sectors;
        let mut triangles = Vec::new();
        for sector in 0..n_sectors {
            triangles.push([top, at(0, sector), at(0, sector + 1)]);
            for ring in 1..n_rings - 1 {
                let [a, b] = [at(ring - 1, sector), at(ring - 1, sector + 1)];
                let [c, d] = [at(ring, sector), at(ring, sector + 1)];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
            triangles.push([at(n_rings - 2, sector + 1), at(n_rings - 2, sector), bottom]);
        }
        Self { positions, triangles }
    }

    /// A box about the origin.
    pub fn cuboid(size_m: [f32; 3]) -> Self {
        let corner =
            |i: u32| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 0.5 } else { -0.5 } * size_m[axis]);
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self {
            positions: (0..8).map(corner).collect(),
            triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    /// The same mesh elsewhere.
    pub fn moved(&self, by: [f32; 3]) -> Self {
        let positions = self.positions.iter().map(|p| [0, 1, 2].map(|axis| p[axis] + by[axis])).collect();
        Self { positions, triangles: self.triangles.clone() }
    }

    /// The same mesh inside out.
    pub fn inside_out(&self) -> Self {
        let triangles = self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        Self { positions: self.positions.clone(), triangles }
    }

    /// Several meshes as one.
    pub fn joined(parts: &[Self]) -> Self {
        let mut whole = Self { positions: Vec::new(), triangles: Vec::new() };
        for part in parts {
            let offset = whole.positions.len() as u32;
            whole.positions.extend(&part.positions);
            whole.triangles.extend(part.triangles.iter().map(|t| t.map(|vertex| vertex + offset)));
        }
        whole
    }
}

/// One thing to score.
#[derive(Clone, Debug)]
pub struct Case {
    /// What is special about it.
    pub name: &'static str,
    /// The camera.
    pub camera: Intrinsics,
    /// The observed mask.
    pub mask: Silhouette,
    /// Which rows to score.
    pub row_step: RowStep,
    /// The meshes, of one topology.
    pub meshes: Vec<Mesh>,
}

/// Why a scorer failed a [`Case`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// It refused the target.
    #[error("{case}: the target is refused")]
    Target {
        /// The case.
        case: &'static str,
        /// The refusal.
        source: TargetError,
    },
    /// It refused the meshes.
    #[error("{case}: the meshes are refused")]
    Score {
        /// The case.
        case: &'static str,
        /// The refusal.
        source: ScoreError,
    },
    /// It counted something else than the reference.
    #[error("{case}, mesh {mesh}: counted {counted:?}, expected {expected:?}")]
    Counts {
        /// The case.
        case: &'static str,
        /// The first mesh that differs.
        mesh: usize,
        /// What the scorer counted.
        counted: OverlapCounts,
        /// What the reference counts.
        expected: OverlapCounts,
    },
}

impl Case {
    /// Scores the case.
    pub fn counts(&self, scorer: &mut dyn SilhouetteScorer) -> Result<Vec<OverlapCounts>, Failure> {
        let case = self.name;
        let positions: Vec<[f32; 3]> = self.meshes.iter().flat_map(|mesh| mesh.positions.clone()).collect();
        let triangles = self.meshes.first().map_or(&[][..], |mesh| &mesh.triangles);
        let vertices_per_mesh = self.meshes.first().map_or(0, |mesh| mesh.positions.len());
        let batch = MeshBatch { positions_camera: &positions, vertices_per_mesh, triangles };
        let mut counts = vec![OverlapCounts::default(); self.meshes.len()];
        scorer
            .set_target(&self.mask.view(), &self.camera)
            .map_err(|source| Failure::Target { case, source })?;
        scorer.set_row_step(self.row_step);
        scorer.score(&batch, &mut counts).map_err(|source| Failure::Score { case, source })?;
        Ok(counts)
    }

    /// Compares a scorer with the [`ReferenceScorer`].
    pub fn check(&self, scorer: &mut dyn SilhouetteScorer) -> Result<(), Failure> {
        let counted = self.counts(scorer)?;
        let expected = self.counts(&mut ReferenceScorer::default())?;
        match (0..counted.len()).find(|&mesh| counted[mesh] != expected[mesh]) {
            None => Ok(()),
            Some(mesh) => {
                let (counted, expected) = (counted[mesh], expected[mesh]);
                Err(Failure::Counts { case: self.name, mesh, counted, expected })
            }
        }
    }
}

/// Checks a scorer against every case, in order, so that it also has to change targets, sizes and meshes.
pub fn check_all(scorer: &mut dyn SilhouetteScorer) -> Result<(), Failure> {
    cases().iter().try_for_each(|case| case.check(scorer))
}

/// A mask with ones and zeros in no simple pattern.
pub fn mottled_mask(width: u32, height: u32) -> Silhouette {
    let words_per_row = width.div_ceil(64) as usize;
    let mut words = vec![0; height as usize * words_per_row];
    for (y, row) in words.chunks_exact_mut(words_per_row).enumerate() {
        for x in 0..width as usize {
            let bit = (x * x / 7 + 3 * y + x * y / 5) % 11 < 6;
            row[x / 64] |= u64::from(bit) << (x % 64);
        }
    }
    Silhouette { width, height, words_per_row, words }
}

fn even_mask(width: u32, height: u32, observed: bool) -> Silhouette {
    let mut mask = mottled_mask(width, height);
    for (i, word) in mask.words.iter_mut().enumerate() {
        let start = (i % mask.words_per_row) as u32 * 64;
        *word = if observed { !0 >> (64 - (width - start).min(64)) } else { 0 };
    }
    mask
}

/// The cases.
pub fn cases() -> Vec<Case> {
    let mut cases = in_view();
    cases.extend(out_of_view());
    cases.extend(odd_meshes());
    cases.extend(cameras_and_masks());
    cases
}

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

fn case(name: &'static str, meshes: Vec<Mesh>) -> Case {
    Case {
        name,
        camera: Intrinsics::centred(WIDTH, HEIGHT, 150.0),
        mask: mottled_mask(WIDTH, HEIGHT),
        row_step: RowStep::EVERY,
        meshes,
    }
}

fn ball() -> Mesh {
    Mesh::sphere(0.4, 7, 11)
}

fn in_view() -> Vec<Case> {
    // With a focal length of 150 px, a step of 1/2400 m at 1 m is 1/16 px.
    let square = Mesh::cuboid([32.0 / 150.0, 16.0 / 150.0, 0.5]).moved([0.0, 0.0, 1.25]);
    let sixteenth = 1.0 / 2400.0;
    let nudged = |dx: i32, dy: i32| square.moved([dx as f32 * sixteenth, dy as f32 * sixteenth, 0.0]);
    vec![
        case("no mesh", vec![]),
        case("one ball", vec![ball().moved([0.1, 0.05, 2.0])]),
        case(
            "nine balls",
            (0..9).map(|i| ball().moved([0.05 * i as f32 - 0.2, 0.03 * i as f32, 2.0])).collect(),
        ),
        case(
            "corners and edges on pixel centres",
            vec![nudged(8, 8), nudged(0, 8), nudged(8, 0), nudged(-8, -8)],
        ),
        case("corners and edges on pixel corners", vec![nudged(0, 0), nudged(16, 16)]),
        case("corners next to pixel centres", vec![nudged(7, 7), nudged(9, 9), nudged(7, 9), nudged(9, 7)]),
    ]
}

fn out_of_view() -> Vec<Case> {
    let at = |x: f32, y: f32, z: f32| ball().moved([x, y, z]);
    vec![
        case("across the left and right edges", vec![at(-1.1, 0.0, 2.0), at(1.1, 0.1, 2.0)]),
        case("across the top and bottom edges", vec![at(0.0, -0.8, 2.0), at(0.1, 0.8, 2.0)]),
        case("across a corner", vec![at(-1.1, -0.8, 2.0), at(1.1, 0.8, 2.0)]),
        case(
            "left, right, above and below",
            vec![at(-3.0, 0.0, 2.0), at(3.0, 0.0, 2.0), at(0.0, -3.0, 2.0), at(0.0, 3.0, 2.0)],
        ),
        case("behind the camera", vec![at(0.0, 0.0, -2.0), at(0.0, 0.0, -0.3)]),
        case("around the camera", vec![at(0.0, 0.0, 0.0), at(0.1, 0.1, 0.2)]),
        case("through the near plane", vec![at(0.3, 0.0, 0.2), at(-0.2, 0.3, 0.39), at(0.0, 0.0, 2.0)]),
        case("touching the near plane", vec![at(0.3, 0.0, 0.4 + NEAR_M), at(0.0, 0.3, 0.41 + NEAR_M)]),
        case("larger than the view", vec![at(0.0, 0.0, 0.46), at(0.2, 0.1, 0.5)]),
        case("far beyond the range of snapped coordinates", vec![at(500.0, 0.0, 2.0), at(0.0, -1e6, 1.0)]),
        case(
            "a wall from far left to far right",
            vec![
                Mesh::cuboid([300.0, 0.5, 0.1]).moved([0.0, 0.1, 3.0]),
                Mesh::cuboid([0.5, 300.0, 0.1]).moved([0.1, 0.0, 3.0]),
            ],
        ),
    ]
}

fn odd_meshes() -> Vec<Case> {
    let point = Mesh { positions: vec![[0.0, 0.0, 2.0]; ball().positions.len()], ..ball() };
    let mut flat = ball().moved([0.0, 0.0, 2.0]);
    flat.positions.iter_mut().for_each(|p| p[0] = 0.25 * p[2]);
    let mut repeated = ball().moved([0.0, 0.1, 1.5]);
    repeated.triangles.extend([[0, 1, 1], [5, 5, 5], [1, 0, 0]]);
    let row: Vec<Mesh> =
        (0..40).map(|i| Mesh::sphere(0.12, 5, 6).moved([0.03 * i as f32 - 0.6, 0.0, 2.0])).collect();
    let nested =
        Mesh::joined(&[ball(), ball().inside_out().moved([0.3, 0.1, 0.2]), Mesh::cuboid([1.0, 0.2, 0.2])]);
    vec![
        case("all vertices in one point", vec![point]),
        case("seen edge-on", vec![flat]),
        case("triangles with repeated corners", vec![repeated]),
        case("more layers than there is room for", vec![Mesh::joined(&row)]),
        case(
            "parts that cross, one inside out",
            vec![nested.moved([0.0, 0.0, 2.0]), nested.moved([0.5, 0.2, 1.5])],
        ),
        case("smaller than a pixel", vec![Mesh::sphere(0.002, 4, 5).moved([0.011, 0.007, 2.0])]),
    ]
}

fn cameras_and_masks() -> Vec<Case> {
    let balls = || vec![ball().moved([0.1, 0.0, 1.6]), ball().moved([-0.9, 0.4, 1.6])];
    let sized = |name, width, height, focal_px| Case {
        camera: Intrinsics::centred(width, height, focal_px),
        mask: mottled_mask(width, height),
        ..case(name, balls())
    };
    let stepped =
        |name, n| Case { row_step: RowStep::new(n).expect("a power of two"), ..case(name, balls()) };
    let mut bent = case("a lens with all kinds of distortion", balls());
    bent.camera.distortion = [-0.25, 0.08, 0.002, -0.003, 0.01];
    let mut squeezed = case("unequal focal lengths, principal point aside", balls());
    squeezed.camera.focal_px = [170.0, 120.0];
    squeezed.camera.principal_point_px = [50.25, 71.5];
    vec![
        bent,
        squeezed,
        sized("one pixel", 1, 1, 100.0),
        sized("rows that fill their words", 128, 65, 100.0),
        sized("rows one pixel over their words", 65, 128, 100.0),
        sized("a tall image", 1088, 1920, 2000.0),
        sized("an image wider than the range of packed coordinates", 6000, 30, 3000.0),
        Case { mask: even_mask(WIDTH, HEIGHT, false), ..case("an empty mask", balls()) },
        Case { mask: even_mask(WIDTH, HEIGHT, true), ..case("a full mask", balls()) },
        stepped("every second row", 2),
        stepped("every eighth row", 8),
        stepped("only one row", 64),
    ]
}
