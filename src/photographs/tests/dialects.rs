//! A set that is written in each dialect has the same rays.

use serde_json::json;

use super::{Folder, SIZE, assert_same_rays, cameras, sets};
use crate::io::LoadLimits;
use crate::photographs::{Dialect, Distortion, Photographs, Region, Split, ViewCamera};

const FOCAL: [f64; 2] = [50.0, 53.0];
const PRINCIPAL: [f64; 2] = [18.5, 16.25];
const MIDDLE: [f64; 2] = [20.0, 15.0];

fn folder() -> Folder {
    let folder = Folder::new();
    folder.gray_images("images", 3, SIZE.map(|n| n as u32));
    folder
}

#[track_caller]
fn open(folder: &Folder, dialect: Dialect, expected: &[ViewCamera]) -> Photographs {
    let set = Photographs::open(folder).expect("a set");
    assert_eq!(set.dialect, dialect);
    assert_eq!(set.views.len(), expected.len());
    for (view, expected) in set.views.iter().zip(expected) {
        assert_same_rays(&view.camera, expected);
    }
    set
}

#[test]
fn nerfstudio() {
    let folder = folder();
    let lists = json!({
        "train_filenames": ["./images/000.png", "images/002.png"],
        "test_filenames": ["images/001.png"],
        "camera_model": "PINHOLE",
    });
    let expected = cameras(FOCAL, PRINCIPAL);
    sets::nerfstudio(&folder, &expected, &lists);
    let set = open(&folder, Dialect::Transforms, &expected);
    assert_eq!(set.of_split(Split::Train), [0, 2]);
    assert_eq!(set.of_split(Split::Test), [1]);
    assert!(set.notes.is_empty(), "{:?}", set.notes);
}

#[test]
fn lenses_of_nerfstudio() {
    for (more, expected) in [
        (
            json!({"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4, "p1": 0.01, "p2": 0.02}),
            Distortion::Radial {
                numerator: [0.1, 0.2, 0.3, 0.4],
                denominator: [0.0; 3],
                tangential: [0.01, 0.02],
            },
        ),
        (
            json!({"k1": 0.1, "k4": 0.4, "k6": 0.6, "camera_model": "OPENCV"}),
            Distortion::Radial {
                numerator: [0.1, 0.0, 0.0, 0.0],
                denominator: [0.4, 0.0, 0.6],
                tangential: [0.0; 2],
            },
        ),
        (
            json!({"k1": 0.1, "k2": 0.2, "k3": 0.0, "k4": 0.4, "camera_model": "OPENCV_FISHEYE"}),
            Distortion::Fisheye {
                k: [0.1, 0.2, 0.0, 0.4],
            },
        ),
        (json!({"k1": 0.0, "k2": 0.0}), Distortion::None),
    ] {
        let folder = folder();
        sets::nerfstudio(&folder, &cameras(FOCAL, PRINCIPAL), &more);
        let set = Photographs::open(&folder).expect("a set");
        assert!(set.views.iter().all(|v| v.camera.distortion == expected));
    }
}

#[test]
fn instant_ngp_with_angles_alone() {
    let folder = folder();
    let expected = cameras(FOCAL, MIDDLE);
    let [x, y] = [0, 1].map(|i| 2.0 * (0.5 * SIZE[i] as f64 / FOCAL[i]).atan());
    let frames = expected.iter().enumerate().map(|(i, camera)| {
        let name = format!("images/{i:03}");
        json!({"file_path": name, "camera_angle_y": y, "transform_matrix": sets::matrix(camera)})
    });
    let whole = json!({"camera_angle_x": x, "frames": frames.collect::<Vec<_>>()});
    folder.write("transforms.json", whole.to_string());
    open(&folder, Dialect::Transforms, &expected);
}

#[test]
fn nerf_synthetic() {
    let folder = Folder::new();
    let expected = cameras([FOCAL[0]; 2], MIDDLE);
    sets::nerf_synthetic(&folder, &expected);
    let set = open(&folder, Dialect::NerfSynthetic, &expected);
    let splits = [Split::Train, Split::Validation, Split::Test];
    assert_eq!(splits.map(|split| set.of_split(split)), [[0], [1], [2]]);
}

#[test]
fn colmap_as_text_and_binary() {
    let [fx, fy] = FOCAL;
    let [cx, cy] = PRINCIPAL;
    let expected = cameras(FOCAL, PRINCIPAL);
    for place in ["", "sparse/0", "sparse", "colmap/sparse/0"] {
        let text = folder();
        sets::colmap_text(&text, &format!("./{place}"), "PINHOLE", &[fx, fy, cx, cy]);
        let binary = folder();
        sets::colmap_binary(&binary, &format!("./{place}"), 1, &[fx, fy, cx, cy]);
        for folder in [text, binary] {
            let set = open(&folder, Dialect::Colmap, &expected);
            assert_eq!(set.points, sets::POINTS);
            assert_eq!(set.views[2].name, "002.png");
        }
    }
}

#[test]
fn lenses_of_colmap() {
    let radial = |numerator: [f64; 3], denominator, tangential| {
        let [a, b, c] = numerator;
        Distortion::Radial {
            numerator: [a, b, c, 0.0],
            denominator,
            tangential,
        }
    };
    let two = [50.0, 53.0, 18.0, 16.0];
    let one = [50.0, 18.0, 16.0];
    let with = |first: &[f64], more: &[f64]| [first, more].concat();
    let fisheye = |k: [f64; 4]| Distortion::Fisheye { k };
    let full = [0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6];
    for (number, model, parameters, expected) in [
        (0, "SIMPLE_PINHOLE", with(&one, &[]), Distortion::None),
        (
            2,
            "SIMPLE_RADIAL",
            with(&one, &[0.1]),
            radial([0.1, 0.0, 0.0], [0.0; 3], [0.0; 2]),
        ),
        (
            3,
            "RADIAL",
            with(&one, &[0.1, 0.2]),
            radial([0.1, 0.2, 0.0], [0.0; 3], [0.0; 2]),
        ),
        (
            4,
            "OPENCV",
            with(&two, &full[..4]),
            radial([0.1, 0.2, 0.0], [0.0; 3], [0.01, 0.02]),
        ),
        (
            5,
            "OPENCV_FISHEYE",
            with(&two, &[0.1, 0.2, 0.3, 0.4]),
            fisheye([0.1, 0.2, 0.3, 0.4]),
        ),
        (
            6,
            "FULL_OPENCV",
            with(&two, &full),
            radial([0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.01, 0.02]),
        ),
        (
            8,
            "SIMPLE_RADIAL_FISHEYE",
            with(&one, &[0.1]),
            fisheye([0.1, 0.0, 0.0, 0.0]),
        ),
        (
            9,
            "RADIAL_FISHEYE",
            with(&one, &[0.1, 0.2]),
            fisheye([0.1, 0.2, 0.0, 0.0]),
        ),
    ] {
        let text = folder();
        sets::colmap_text(&text, "sparse", model, &parameters);
        let binary = folder();
        sets::colmap_binary(&binary, "sparse", number, &parameters);
        for folder in [text, binary] {
            let set = Photographs::open(&folder).expect("a set");
            let camera = set.views[0].camera;
            assert_eq!(camera.distortion, expected, "{model}");
            assert_eq!(camera.principal, [18.0, 16.0]);
            let y = if parameters[1] == 53.0 { 53.0 } else { 50.0 };
            assert_eq!(camera.focal, [50.0, y]);
        }
    }
}

#[test]
fn llff_scaled_to_its_images() {
    let folder = folder();
    let expected = cameras([FOCAL[0]; 2], MIDDLE);
    sets::llff(&folder, &expected, 8.0);
    let set = open(&folder, Dialect::Llff, &expected);
    assert_eq!(set.views[0].depths, Some([0.5, 9.0]));
    assert!(
        set.notes[0].contains("scaled to the image's 40 × 30"),
        "{:?}",
        set.notes
    );
}

#[test]
fn neus() {
    let folder = folder();
    sets::neus(&folder, FOCAL, PRINCIPAL);
    for name in ["00", "01", "02"] {
        folder.image(&format!("mask/{name}.png"), [40, 30], |_, _| [255; 4]);
    }
    let set = open(&folder, Dialect::Neus, &cameras(FOCAL, PRINCIPAL));
    let mask = set.views[2].mask_path.as_ref().expect("a mask");
    assert!(mask.ends_with("mask/02.png"));
    let region = set.region().expect("a region");
    assert_eq!(region, Region::sphere([0.1, 0.2, 0.3], 2.0));
}

#[test]
fn the_first_dialect_is_read_and_the_others_are_noted() {
    let folder = folder();
    let expected = cameras([FOCAL[0]; 2], MIDDLE);
    sets::llff(&folder, &expected, 1.0);
    sets::nerfstudio(&folder, &expected, &json!({}));
    let set = open(&folder, Dialect::Transforms, &expected);
    assert!(set.notes[0].contains("poses_bounds.npy is not read"));
    let llff = Photographs::open_as(&folder, Dialect::Llff, &LoadLimits::default());
    assert_eq!(llff.expect("a set").dialect, Dialect::Llff);
}

#[test]
fn points_of_colmap_get_the_transformation_of_nerfstudio() {
    let folder = folder();
    let applied = json!({
        "applied_transform": [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 5.0]]
    });
    sets::nerfstudio(&folder, &cameras(FOCAL, PRINCIPAL), &applied);
    sets::colmap_text(&folder, "colmap/sparse/0", "PINHOLE", &[1.0, 1.0, 1.0, 1.0]);
    let set = Photographs::open(&folder).expect("a set");
    assert_eq!(set.points[0], [-1.0, 0.5, 3.0]);
}
