use std::path::Path;

use super::*;

const OBJ: &str = "\
# two faces, one of them with four corners
v 0 0 0
v 1 0 0 0.5 0.5 0.5
v 1 1 0
vn 0 0 1
v 0 1.5e0 -2
g part
f 1/1/1 2//1 3 4
f -4 -3 -2
";

const PLY: &str = "\
ply
format ascii 1.0
comment made by hand
element vertex 4
property float x
property double y
property float z
property uchar red
element face 2
property list uchar int vertex_indices
end_header
0 0 0 255
1 0 0 255
1 1 0 255
0 1.5 -2 255
4 0 1 2 3
3 0 1 2
";

fn expected() -> MeshFile {
    MeshFile {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.5, -2.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 2]],
    }
}

/// The same mesh in binary, little or big endian.
fn binary_ply(is_little: bool) -> Vec<u8> {
    let format = if is_little { "binary_little_endian" } else { "binary_big_endian" };
    let header_end = PLY.find("end_header\n").expect("it is there") + "end_header\n".len();
    let mut bytes = PLY[..header_end].replace("ascii", format).into_bytes();
    let mut put = |number: &[u8]| {
        if is_little { bytes.extend(number) } else { bytes.extend(number.iter().rev()) }
    };
    for [x, y, z] in expected().positions {
        put(&x.to_le_bytes());
        put(&f64::from(y).to_le_bytes());
        put(&z.to_le_bytes());
        put(&[255]);
    }
    for face in [&[0i32, 1, 2, 3][..], &[0, 1, 2]] {
        put(&[face.len() as u8]);
        face.iter().for_each(|corner| put(&corner.to_le_bytes()));
    }
    bytes
}

fn obj(text: &str) -> Result<MeshFile, LoadMeshError> {
    read_obj(Path::new("a.obj"), text.as_bytes())
}

fn ply(bytes: &[u8]) -> Result<MeshFile, LoadMeshError> {
    read_ply(Path::new("a.ply"), bytes)
}

#[test]
fn reads_obj_and_all_kinds_of_ply() {
    assert_eq!(obj(OBJ).expect("a good file"), expected());
    assert_eq!(ply(PLY.as_bytes()).expect("a good file"), expected());
    for is_little in [true, false] {
        assert_eq!(ply(&binary_ply(is_little)).expect("a good file"), expected());
    }
}

#[test]
fn points_need_no_faces() {
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    let mesh = ply(points.as_bytes()).expect("a good file");
    assert_eq!((mesh.positions, mesh.triangles), (vec![[1.0, 2.0, 3.0]], Vec::new()));
}

#[test]
fn messages_name_file_place_and_value() {
    let message = |result: Result<MeshFile, LoadMeshError>| result.expect_err("a bad file").to_string();
    assert_eq!(
        message(obj(&OBJ.replace("v 1 1 0", "v 1 x 0"))),
        "a.obj: line 4: `v 1 x 0`, expected three coordinates"
    );
    assert_eq!(
        message(obj(&OBJ.replace("v 1 1 0", "v 1 nan 0"))),
        "a.obj: `vertices[2]` is [1.0, NaN, 0.0], expected finite numbers"
    );
    assert_eq!(
        message(obj(&OBJ.replace("3 4", "3 9"))),
        "a.obj: `faces[0]` names vertex 8, but there are 4 vertices"
    );
    assert_eq!(
        message(obj(&OBJ.replace("f -4", "f 0"))),
        "a.obj: line 9: `f 0 -3 -2`, expected three vertex numbers or more"
    );
    assert_eq!(message(obj("# nothing\n")), "a.obj: has no vertices");
    assert_eq!(message(ply(&PLY.as_bytes()[..PLY.len() - 5])), "a.ply: is not valid PLY");
    assert_eq!(message(ply(&binary_ply(true)[..200])), "a.ply: is not valid PLY");
    assert_eq!(message(ply(b"solid nothing")), "a.ply: is not valid PLY");
    assert_eq!(
        message(ply(PLY.replace("double y", "double v").as_bytes())),
        "a.ply: `element vertex` has no `property y`"
    );
    assert_eq!(
        message(ply(PLY.replace("3 0 1 2\n", "3 0 1 -2\n").as_bytes())),
        "a.ply: `faces[1]` names vertex -2, but there are 4 vertices"
    );
    assert_eq!(message(load_mesh(Path::new("no/such.ply"))), "no/such.ply: cannot read the file");
    assert_eq!(message(load_mesh(Path::new("a.stl"))), "a.stl: the name does not end in .obj or .ply");
}

#[test]
fn what_is_written_is_read_again() {
    let folder = tempfile::tempdir().expect("a folder for tests");
    let path = folder.path().join("mesh.obj");
    let mut mesh = expected();
    mesh.positions[1] = [0.1, -1.0 / 3.0, 1e-7];
    write_obj(&path, &mesh.positions, &mesh.triangles).expect("a folder to write into");
    assert_eq!(load_mesh(&path).expect("a good file"), mesh);
    let nowhere = folder.path().join("none/mesh.obj");
    let message = write_obj(&nowhere, &[], &[]).expect_err("no folder").to_string();
    assert_eq!(message, format!("{}: cannot write the file", nowhere.display()));
}

#[test]
fn scans_and_bodies_of_the_data_are_read() {
    let Some(data) = crate::test_data::folder() else { return };
    let scan = load_mesh(&data.join("scans/s000.ply")).expect("a good file");
    assert_eq!((scan.positions.len(), scan.triangles.len()), (40_000, 0));
    let body = load_mesh(&data.join("stage/S1/rest_pose.obj")).expect("a good file");
    assert_eq!(body.positions.len(), 13_348); // as its README says
    assert_eq!(body.triangles.len(), 26_692);
    // Millimetres, z up, standing on the floor; subject.json gives the stature.
    let height = |fold: fn(f32, f32) -> f32, start| body.positions.iter().map(|p| p[2]).fold(start, fold);
    assert!(height(f32::min, f32::MAX).abs() < 5.0);
    assert!((height(f32::max, 0.0) - 1830.0).abs() < 5.0);
}
