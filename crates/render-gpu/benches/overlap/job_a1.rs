//! Job A1 of the benchmark data: 200 posed bodies of 1,202 vertices against one 640 x 480 mask.

use std::path::{Path, PathBuf};

use render_gpu::{Intrinsics, MaskView, MeshBatch};

/// The job, in the frames and types of this crate.
pub struct JobA1 {
    pub camera: Intrinsics,
    pub positions_camera: Vec<[f32; 3]>,
    pub vertices_per_mesh: usize,
    pub triangles: Vec<[u32; 3]>,
    pub words_per_row: usize,
    pub mask_words: Vec<u64>,
    /// Intersection over union of each body and the mask, by a rasteriser in f64 without snapping.
    pub iou_reference: Vec<f64>,
}

impl JobA1 {
    /// `None` where the benchmark data is not at hand: `UMBRA_BENCH`, or the folder `bench` beside `UMBRA_DATA`, or
    /// beside the repository.
    pub fn load() -> Option<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = std::env::var_os("UMBRA_BENCH")
            .map(PathBuf::from)
            .or_else(|| std::env::var_os("UMBRA_DATA").map(|data| Path::new(&data).join("../bench")))
            .unwrap_or_else(|| root.join("../../../shared/bench"))
            .join("silhouette");
        folder.is_dir().then(|| Self::read(&folder))
    }

    fn read(folder: &Path) -> Self {
        let intrinsics: Vec<f64> = npy(folder, "intrinsics");
        let translation: Vec<f64> = npy(folder, "camera_translation");
        let (mask, [height, width]): (Vec<u8>, [usize; 2]) = npy_shaped(folder, "observed_mask");
        let (posed, [_, vertices_per_mesh, _]): (Vec<f32>, [usize; 3]) = npy_shaped(folder, "posed_vertices");
        // The camera of the data stands at `translation` and looks along -z with y up.
        let positions_camera = posed
            .chunks_exact(3)
            .map(|v| [0, 1, 2].map(|axis| f64::from(v[axis]) - translation[axis]))
            .map(|[x, y, z]| [x as f32, -y as f32, -z as f32])
            .collect();
        let words_per_row = width.div_ceil(64);
        let mut mask_words = vec![0_u64; height * words_per_row];
        for (pixel, _) in mask.iter().enumerate().filter(|&(_, &value)| value != 0) {
            mask_words[pixel / width * words_per_row + pixel % width / 64] |= 1 << (pixel % width % 64);
        }
        let triangles: Vec<u32> = npy(folder, "triangles");
        Self {
            camera: Intrinsics {
                focal_px: [intrinsics[0], intrinsics[4]],
                principal_point_px: [intrinsics[2], intrinsics[5]],
                ..Intrinsics::centred(width as u32, height as u32, 1.0)
            },
            positions_camera,
            vertices_per_mesh,
            triangles: triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            words_per_row,
            mask_words,
            iou_reference: npy(folder, "iou_reference"),
        }
    }

    pub fn mask(&self) -> MaskView<'_> {
        MaskView {
            width: self.camera.width,
            height: self.camera.height,
            words_per_row: self.words_per_row,
            words: &self.mask_words,
        }
    }

    pub fn batch(&self) -> MeshBatch<'_> {
        MeshBatch {
            positions_camera: &self.positions_camera,
            vertices_per_mesh: self.vertices_per_mesh,
            triangles: &self.triangles,
        }
    }
}

fn npy<T: npyz::Deserialize>(folder: &Path, name: &str) -> Vec<T> {
    read_npy(folder, name).0
}

fn npy_shaped<T: npyz::Deserialize, const D: usize>(folder: &Path, name: &str) -> (Vec<T>, [usize; D]) {
    let (values, shape) = read_npy(folder, name);
    let shape: Vec<usize> = shape.iter().map(|&n| n as usize).collect();
    (
        values,
        shape.try_into().unwrap_or_else(|shape| panic!("{name}.npy has shape {shape:?}, expected {D} axes")),
    )
}

/// Values in C order; of a Fortran-ordered file only its order of axes would differ, and the data has none with two axes.
fn read_npy<T: npyz::Deserialize>(folder: &Path, name: &str) -> (Vec<T>, Vec<u64>) {
    let path = folder.join(format!("{name}.npy"));
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let file = npyz::NpyFile::new(&bytes[..]).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let shape = file.shape().to_vec();
    assert!(shape.len() == 1 || file.order() == npyz::Order::C, "{}: Fortran order", path.display());
    (file.into_vec().unwrap_or_else(|error| panic!("{}: {error}", path.display())), shape)
}
