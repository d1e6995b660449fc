//! Writers of a test's set in each dialect.

use glam::{DMat3, DVec3};
use serde_json::{Value, json};

use super::{Folder, SIZE, npy, npz, poses};
use crate::photographs::ViewCamera;

/// The pose of a camera as a matrix of a JSON file.
pub fn matrix(camera: &ViewCamera) -> Value {
    let mut rows: Vec<[f64; 4]> = camera.to_world.into();
    rows.push([0.0, 0.0, 0.0, 1.0]);
    json!(rows)
}

/// `transforms.json` with one K for all frames.
pub fn nerfstudio(folder: &Folder, cameras: &[ViewCamera], more: &Value) {
    let frame = |(i, camera): (usize, &ViewCamera)| json!({"file_path": format!("./images/{i:03}.png"), "transform_matrix": matrix(camera)});
    let frames: Vec<Value> = cameras.iter().enumerate().map(frame).collect();
    let c = &cameras[0];
    let mut whole = json!({
        "fl_x": c.focal[0], "fl_y": c.focal[1], "cx": c.principal[0], "cy": c.principal[1],
        "w": c.size[0], "h": c.size[1], "frames": frames,
    });
    let fields = whole.as_object_mut().expect("an object");
    for (name, value) in more.as_object().expect("an object") {
        fields.insert(name.clone(), value.clone());
    }
    folder.write("transforms.json", whole.to_string());
}

/// The three files of a synthetic scene of NeRF, one camera each.
pub fn nerf_synthetic(folder: &Folder, cameras: &[ViewCamera]) {
    for (camera, part) in cameras.iter().zip(["train", "val", "test"]) {
        let angle = 2.0 * (0.5 * SIZE[0] as f64 / camera.focal[0]).atan();
        let frame = json!({
            "file_path": format!("./{part}/r_0"), "rotation": 0.1, "transform_matrix": matrix(camera),
        });
        let whole = json!({"camera_angle_x": angle, "frames": [frame]});
        folder.write(&format!("transforms_{part}.json"), whole.to_string());
        let size = SIZE.map(|n| n as u32);
        folder.image(&format!("{part}/r_0.png"), size, |x, _| {
            [200, 100, 50, (x * 6) as u8]
        });
    }
}

/// The quaternion w, x, y, z of a rotation.
fn quaternion(rotation: DMat3) -> [f64; 4] {
    let q = glam::DQuat::from_mat3(&rotation);
    [q.w, q.x, q.y, q.z]
}

/// The points of the models of COLMAP.
pub const POINTS: [[f64; 3]; 2] = [[0.5, -1.0, 2.0], [0.25, 0.125, -3.0]];

/// `cameras.txt`, `images.txt` and `points3D.txt`, with the model and the parameters of a camera.
pub fn colmap_text(folder: &Folder, place: &str, model: &str, parameters: &[f64]) {
    let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let [w, h] = SIZE;
    let cameras = format!("# Camera list\n4 {model} {w} {h} {}\n", numbers(parameters));
    folder.write(&format!("{place}/cameras.txt"), cameras);
    let mut images = String::from("# Image list\n");
    // The order is not that of the names.
    for (i, (rotation, t)) in poses().into_iter().enumerate().rev() {
        let [q, t] = [&quaternion(rotation)[..], &t.to_array()[..]].map(numbers);
        images += &format!("{} {q} {t} 4 {i:03}.png\n10.5 20.5 -1 3 4 7\n", i + 1);
    }
    folder.write(&format!("{place}/images.txt"), images);
    let point = |(i, p): (usize, &[f64; 3])| format!("{i} {} 1 2 3 0.5 1 0 2 0\n", numbers(p));
    let points: String = POINTS.iter().enumerate().map(point).collect();
    folder.write(&format!("{place}/points3D.txt"), points);
}

/// `cameras.bin`, `images.bin` and `points3D.bin`, with `rigs.bin` and `frames.bin` beside them.
pub fn colmap_binary(folder: &Folder, place: &str, model: i32, parameters: &[f64]) {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(4u32.to_le_bytes());
    cameras.extend(model.to_le_bytes());
    let floats = |v: &[f64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    cameras.extend(SIZE.iter().flat_map(|&n| (n as u64).to_le_bytes()));
    cameras.extend(floats(parameters));
    folder.write(&format!("{place}/cameras.bin"), cameras);
    let mut images = (poses().len() as u64).to_le_bytes().to_vec();
    for (i, (rotation, t)) in poses().into_iter().enumerate().rev() {
        images.extend((i as u32 + 1).to_le_bytes());
        images.extend(floats(&quaternion(rotation)));
        images.extend(floats(&t.to_array()));
        images.extend(4u32.to_le_bytes());
        images.extend(format!("{i:03}.png\0").bytes());
        images.extend(1u64.to_le_bytes());
        images.extend([7; 24]);
    }
    folder.write(&format!("{place}/images.bin"), images);
    let mut points = (POINTS.len() as u64).to_le_bytes().to_vec();
    for point in POINTS {
        points.extend(3u64.to_le_bytes());
        points.extend(floats(&point));
        points.extend([9; 11]);
        points.extend(2u64.to_le_bytes());
        points.extend([1; 16]);
    }
    folder.write(&format!("{place}/points3D.bin"), points);
    for name in ["rigs", "frames"] {
        folder.write(&format!("{place}/{name}.bin"), [0; 8]);
    }
}

/// `poses_bounds.npy`, for images of `factor` times the size.
pub fn llff(folder: &Folder, cameras: &[ViewCamera], factor: f64) {
    let mut values = Vec::new();
    for camera in cameras {
        let side = [SIZE[1] as f64, SIZE[0] as f64, camera.focal[0]].map(|v| v * factor);
        for (row, side) in camera.to_world.iter().zip(side) {
            let [right, up, backward, position] = *row;
            values.extend([-up, right, backward, position, side]);
        }
        values.extend([0.5, 9.0]);
    }
    folder.write("poses_bounds.npy", npy(&[cameras.len(), 17], &values));
}

/// `cameras_sphere.npz`. Its pixels have their centers at whole numbers.
pub fn neus(folder: &Folder, focal: [f64; 2], principal: [f64; 2]) {
    let mut matrices = Vec::new();
    for (i, (rotation, translation)) in poses().into_iter().enumerate() {
        let k = DMat3::from_cols(
            DVec3::new(focal[0], 0.0, 0.0),
            DVec3::new(0.0, focal[1], 0.0),
            DVec3::new(principal[0] - 0.5, principal[1] - 0.5, 1.0),
        );
        // A projection has no scale of its own.
        let (left, right) = (k * rotation * -2.5, k * translation * -2.5);
        let row = |i: usize| {
            let row = left.row(i);
            [row.x, row.y, row.z, right[i]]
        };
        let mut world = [row(0), row(1), row(2)].concat();
        world.extend([0.0, 0.0, 0.0, 1.0]);
        matrices.push((format!("world_mat_{i}"), world));
        let scale = [
            2.0, 0.0, 0.0, 0.1, 0.0, 2.0, 0.0, 0.2, 0.0, 0.0, 2.0, 0.3, 0.0, 0.0, 0.0, 1.0,
        ];
        matrices.push((format!("scale_mat_{i}"), scale.into()));
    }
    folder.write("cameras_sphere.npz", npz(&matrices));
}
