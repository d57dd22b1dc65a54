//! `umbra measure` and `umbra register` on meshes of a body of the model, sound and spoilt.

use std::fs;
use std::path::{Path, PathBuf};

use body::io::write_obj;
use body::{BodyModel, Sex};
use tempfile::TempDir;

use crate::support::{Answer, umbra};

/// A woman of 1.68 m at rest, in a folder of her own, with landmarks.
struct Woman {
    folder: TempDir,
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    landmarks: String,
}

impl Woman {
    fn new() -> Self {
        let model = BodyModel::builtin();
        let body = model.shape_for_stature(1.68, Some(Sex::Female));
        let mut landmarks = String::from("name,x_m,y_m,z_m\n");
        for landmark in &model.template().landmarks {
            let place = body.landmark(&landmark.name).expect("a landmark of the template");
            landmarks += &format!("\"{}\",{},{},{}\n", landmark.name, place.x, place.y, place.z);
        }
        Self {
            folder: TempDir::new().expect("a folder for a test"),
            vertices: body.rest_vertices().to_vec(),
            triangles: body.triangles().to_vec(),
            landmarks,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes her mesh, each vertex changed.
    fn write(&self, name: &str, change: impl Fn([f32; 3]) -> [f32; 3]) -> PathBuf {
        let vertices: Vec<[f32; 3]> = self.vertices.iter().map(|vertex| change(*vertex)).collect();
        write_obj(&self.path(name), &vertices, &self.triangles).expect("it can be written");
        self.path(name)
    }

    fn write_landmarks(&self, name: &str) -> PathBuf {
        fs::write(self.path(name), &self.landmarks).expect("it can be written");
        self.path(name)
    }
}

fn measure(mesh: &Path, more: &[&str]) -> Answer {
    Answer::of(umbra().arg("measure").arg(mesh).args(more))
}

/// The value of a line of the table.
fn value(answer: &Answer, name: &str) -> f64 {
    let line = answer.stdout.lines().find(|line| line.split_whitespace().next() == Some(name));
    let number = line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok());
    number.unwrap_or_else(|| panic!("no `{name}` in\n{}", answer.stdout))
}

#[test]
fn meshes_in_millimetres_and_spoilt_ones_are_measured_and_it_is_told() {
    let woman = Woman::new();
    let landmarks = woman.write_landmarks("landmarks.csv");
    let with_landmarks = ["--landmarks", landmarks.to_str().unwrap()];
    let json = woman.path("m.json");
    let large = woman.write("mm.obj", |v| v.map(|x| 1000.0 * x));
    let sound =
        measure(&large, &[&with_landmarks[..], &["--json", json.to_str().unwrap()]].concat()).succeeded();
    assert!(sound.stderr.contains("taken as mm"), "{}", sound.stderr);
    assert!((value(&sound, "stature") - 1680.0).abs() < 8.0, "{}", sound.stdout);
    let file: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(file["unit_of_mesh"], "mm");
    assert_eq!(file["quantities"][1]["name"], "waist");
    let told = measure(&woman.write("cm.obj", |v| v.map(|x| 100.0 * x)), &with_landmarks).succeeded();
    assert!(told.stderr.contains("taken as cm"), "{}", told.stderr);
    assert!((value(&told, "waist") - value(&sound, "waist")).abs() < 0.2, "{}", told.stdout);
    // A unit that is given is not guessed.
    measure(&large, &["--unit", "m"]).failed(1, &["mm.obj", "expected 10 m or less: check the unit"]);

    // Every corner its own vertex, one triangle twice, one missing.
    let spoilt = woman.path("spoilt.obj");
    let corners: Vec<[f32; 3]> =
        woman.triangles[1..].iter().flatten().map(|&vertex| woman.vertices[vertex as usize]).collect();
    let mut triangles: Vec<[u32; 3]> =
        (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    triangles.push(triangles[900]);
    write_obj(&spoilt, &corners, &triangles).unwrap();
    let told = measure(&spoilt, &with_landmarks).succeeded();
    for part in [
        "repeated vertices were joined",
        "more than two triangles",
        "open along 3 edges",
        "not closed: the volume",
    ] {
        assert!(told.stderr.contains(part), "{part:?} is missing:\n{}", told.stderr);
    }
    for name in ["chest", "waist", "hips", "right_thigh", "right_calf"] {
        assert!(
            (value(&told, name) - value(&sound, name)).abs() < 6.0,
            "{name}:\n{}\n{}",
            sound.stdout,
            told.stdout
        );
    }
}

#[test]
fn meshes_that_cannot_be_measured_as_they_are() {
    let woman = Woman::new();
    let empty = woman.path("empty.obj");
    fs::write(&empty, "# nothing\n").unwrap();
    measure(&empty, &[]).failed(1, &["empty.obj", "has no vertices"]);
    let flat = woman.write("flat.obj", |[_, y, _]| [0.0, y, 0.0]);
    measure(&flat, &[]).failed(1, &["flat.obj", "triangles of the mesh have no area"]);
    let tiny = woman.write("tiny.obj", |v| v.map(|x| 1e-4 * x));
    measure(&tiny, &[]).failed(1, &["tiny.obj", "person's in no unit", "--unit"]);
    let lying = woman.write("lying.obj", |[x, y, z]| [x, -z, y]);
    measure(&lying, &[]).failed(1, &["lying.obj", "stands along y", "try --up z"]);
    let raised = measure(&lying, &["--up", "z"]).succeeded();
    assert!((value(&raised, "stature") - 1680.0).abs() < 8.0, "{}", raised.stdout);
    let inverted = woman.write("inverted.obj", |[x, y, z]| [-x, -y, z]);
    measure(&inverted, &[]).failed(1, &["inverted.obj", "stands on its head", "--up"]);
}

#[test]
fn a_folder_of_scans_is_registered_and_resumed() {
    let woman = Woman::new();
    let scans = woman.path("scans");
    fs::create_dir(&scans).unwrap();
    woman.write("scans/a.obj", |v| v);
    let unknown = woman.landmarks.replace("Sellion", "Tip of the nose");
    fs::write(scans.join("a_landmarks.csv"), unknown).unwrap();
    fs::write(scans.join("b.obj"), "v 0 0 0\n").unwrap();
    let out = woman.path("out");
    let register = || Answer::of(umbra().arg("register").arg(&scans).arg("--out").arg(&out));
    let first = register();
    assert_eq!(first.status, Some(1), "{}", first.stderr);
    for part in ["not known and not used: Tip of the nose", "b.obj", "1 of 2 scans could not be registered"] {
        assert!(first.stderr.contains(part), "{part:?} is missing:\n{}", first.stderr);
    }
    let mesh = body::io::load_mesh(&out.join("a.obj")).unwrap();
    assert_eq!(mesh.triangles, woman.triangles);
    let far = mesh
        .positions
        .iter()
        .zip(&woman.vertices)
        .map(|(found, truth)| found.iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt());
    let mean = far.sum::<f32>() / woman.vertices.len() as f32;
    assert!(mean < 0.004, "{mean}");
    let again = register();
    assert!(again.stderr.contains("1 of 2 scans are done already"), "{}", again.stderr);
}
