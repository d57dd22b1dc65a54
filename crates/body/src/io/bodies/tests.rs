use super::*;

#[test]
fn says_which_file_is_missing() {
    let message = BodiesData::read(Path::new("no/such/folder")).unwrap_err().to_string();
    assert_eq!(message, "no/such/folder/template_vertices.npy: cannot read the file");
}

/// The stored joints of single bodies against the sum over the basis.
#[test]
fn bodies_are_sums_over_the_basis() {
    let Some(folder) = crate::test_data::folder() else { return };
    let folder = folder.join("bodies");
    let data = BodiesData::read(&folder).unwrap();
    assert_eq!((data.mean.len(), data.triangles.len(), data.basis.len()), (13_348, 26_692, 190));
    assert_eq!((data.coefficients.len(), data.landmarks.len(), data.part_names.len()), (1_200, 75, 17));
    assert_eq!(data.is_female.iter().filter(|&&is_female| is_female).count(), 600);
    let stored = points(&folder.join("joints_public.npy"), Some(N_POPULATION_JOINTS)).unwrap();
    for body in [0, 517, 1_199] {
        for (found, expected) in data.joints(body).iter().zip(&stored[body]) {
            assert!(found.distance(*expected) < 1e-5);
        }
    }
    let statures = column(&folder.join("truth.csv"), "stature_m").unwrap();
    let heights = data.vertices(5).into_iter().map(|p| p.y);
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
    assert!((high - low - statures[5].parse::<f64>().unwrap()).abs() < 1e-3);
}

#[test]
fn says_what_a_cell_should_hold() {
    let folder = std::env::temp_dir().join(format!("umbra-body-cells-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("truth.csv");
    std::fs::write(&path, "sex\nfemale\nboth\n").unwrap();
    let message = read_sexes(&path, 2).unwrap_err().to_string();
    assert_eq!(message, format!("{}: row 2, `sex` is `both`, expected `female` or `male`", path.display()));
    std::fs::write(&path, "name,vertex_id\nSellion,99\n").unwrap();
    let message = read_landmarks(&path, 10).unwrap_err().to_string();
    assert_eq!(message, format!("{}: element 0 is 99, but there are 10", path.display()));
    std::fs::write(&path, "not an array").unwrap();
    let message = points(&path, None).unwrap_err().to_string();
    assert_eq!(message, format!("{}: expected a NumPy array of <f4", path.display()));
    std::fs::remove_dir_all(&folder).unwrap();
}
