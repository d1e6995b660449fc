//! Errors name the file, the frame, the field, the value and what is expected.

use std::fs;

use serde_json::{Value, json};

use super::{Folder, SIZE, cameras, npy, sets};
use crate::photographs::{Photographs, Split};

const PINHOLE: [f64; 4] = [50.0, 50.0, 20.0, 15.0];

fn folder() -> Folder {
    let folder = Folder::new();
    folder.gray_images("images", 3, SIZE.map(|n| n as u32));
    folder
}

#[track_caller]
fn assert_fails(folder: &Folder, parts: &[&str]) {
    let error = Photographs::open(folder).expect_err("an error").to_string();
    let missing = parts.iter().find(|part| !error.contains(**part));
    assert_eq!(missing, None, "{error}");
}

/// A set of nerfstudio whose file was changed.
fn changed(change: impl Fn(&mut Value)) -> Folder {
    let folder = folder();
    sets::nerfstudio(&folder, &cameras([50.0; 2], [20.0, 15.0]), &json!({}));
    let path = folder.at("transforms.json");
    let text = fs::read_to_string(&path).expect("a text");
    let mut whole = serde_json::from_str(&text).expect("JSON");
    change(&mut whole);
    fs::write(path, whole.to_string()).expect("a file");
    folder
}

#[test]
fn empty_folders_list_what_was_looked_for() {
    let parts = [
        "transforms.json",
        "transforms_train.json",
        "sparse/0",
        "cameras_sphere.npz",
        "poses_bounds.npy",
    ];
    assert_fails(&Folder::new(), &parts);
}

#[test]
fn fields_of_frames() {
    type Change<'a> = &'a dyn Fn(&mut Value);
    let cases: [(Change, &[&str]); 8] = [
        (
            &|v| drop(v.as_object_mut().expect("an object").remove("fl_x")),
            &[
                "transforms.json",
                "frames[0]: fl_x is missing",
                "camera_angle_x",
            ],
        ),
        (
            &|v| v["frames"][1]["fl_x"] = json!("50"),
            &[r#"frames[1]: fl_x is "50""#, "a finite number"],
        ),
        (
            &|v| v["frames"][2]["fl_x"] = json!(-1.0),
            &["frames[2]: focal length is -1"],
        ),
        (
            &|v| v["frames"][2]["transform_matrix"][1][1] = Value::Null,
            &[
                "frames[2]: transform_matrix is",
                "3 rows of 4 finite numbers",
            ],
        ),
        (
            &|v| v["frames"][0]["file_path"] = json!("images/x.png"),
            &[
                r#"frames[0]: file_path is "images/x.png""#,
                "there is no image",
            ],
        ),
        (
            &|v| v["frames"][0]["mask_path"] = json!("masks/x.png"),
            &[
                r#"frames[0]: mask_path is "masks/x.png""#,
                "there is no image",
            ],
        ),
        (
            &|v| v["camera_model"] = json!("EQUIRECTANGULAR"),
            &["camera_model is \"EQUIRECTANGULAR\"", "OPENCV_FISHEYE"],
        ),
        (
            &|v| v["test_filenames"] = json!(["images/7.png"]),
            &["\"images/7.png\" is in a list"],
        ),
    ];
    for (change, parts) in cases {
        assert_fails(&changed(change), parts);
    }
}

#[test]
fn poses_that_are_no_rotation() {
    let folder = changed(|v| v["frames"][1]["transform_matrix"][0][0] = json!(9.0));
    assert_fails(&folder, &["frames[1]: pose is", "perpendicular"]);
    let folder = folder_with_text("1 nan 0 0 0 0 0 1 4 000.png\n\n");
    assert_fails(&folder, &["images.txt", "line 1: rotation is NaN"]);
    let folder = folder_with_text("1 0 0 0 0 0 0 1 4 000.png\n\n");
    assert_fails(&folder, &["images.txt", "image 1: rotation is 0"]);
    let folder = self::folder();
    folder.write("poses_bounds.npy", npy(&[3, 17], &[f64::NAN; 51]));
    assert_fails(&folder, &["poses_bounds.npy", "value 0 is NaN"]);
}

/// A model of COLMAP with these images.
fn folder_with_text(images: &str) -> Folder {
    let folder = folder();
    sets::colmap_text(&folder, "sparse/0", "PINHOLE", &PINHOLE);
    folder.write("sparse/0/images.txt", images);
    folder
}

#[test]
fn models_of_colmap() {
    let cut = folder();
    sets::colmap_binary(&cut, "sparse/0", 1, &PINHOLE);
    let path = cut.at("sparse/0/images.bin");
    let bytes = fs::read(&path).expect("bytes");
    fs::write(path, &bytes[..bytes.len() - 30]).expect("a file");
    assert_fails(&cut, &["images.bin", "image 1: the file ends after"]);
    let unknown = folder();
    sets::colmap_binary(&unknown, "sparse/0", 10, &PINHOLE);
    assert_fails(
        &unknown,
        &[
            "cameras.bin",
            "camera 4: model is THIN_PRISM_FISHEYE",
            "OPENCV",
        ],
    );
    let other = folder_with_text("1 1 0 0 0 0 0 1 5 000.png\n\n");
    assert_fails(&other, &["image 1: camera is 5", "cameras.txt"]);
    let missing = folder_with_text("1 1 0 0 0 0 0 1 4 000.png\n\n2 1 0 0 0 0 0 1 4 x.png\n\n");
    assert_fails(
        &missing,
        &[r#"image 2: name is "x.png""#, "there is no file"],
    );
    let outside =
        folder_with_text("1 1 0 0 0 0 0 1 4 000.png\n\n2 1 0 0 0 0 0 1 4 ../../x.png\n\n");
    assert_fails(&outside, &["outside"]);
}

#[test]
fn sizes() {
    let folder = changed(|v| v["w"] = json!(60));
    assert_fails(
        &folder,
        &[
            "frames[0]: size of the camera's image is 60 × 30",
            "40 × 30",
            "aspect",
        ],
    );
    let folder = self::folder();
    sets::llff(&folder, &cameras([50.0; 2], [20.0, 15.0])[..2], 1.0);
    assert_fails(&folder, &["it has 2 poses", "3 images"]);
}

#[test]
fn images_without_a_camera_are_noted() {
    let folder = folder();
    sets::colmap_text(&folder, "sparse/0", "PINHOLE", &PINHOLE);
    folder.image("images/more/x.png", [4, 4], |_, _| [0, 0, 0, 255]);
    let mut set = Photographs::open(&folder).expect("a set");
    assert!(set.notes[0].contains("1 images in") && set.notes[0].ends_with("left out: more/x.png"));
    assert!(set.split_every(1).is_err());
    set.split_every(2).expect("a split");
    assert_eq!(set.of_split(Split::Test), [0, 2]);
}
