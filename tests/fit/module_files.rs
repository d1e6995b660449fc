//! Parameters of modules in burnpack and safetensors files, and those that do not fit.
#![cfg(feature = "safetensors")]

use std::path::PathBuf;

use crate::common;
use crate::common::errors::{message, says};
use crate::parameters::{changed, parameters};
use burn::module::Module;
use burn::tensor::DType;
use softray::Error;
use softray::meshing::TriangleMesh;
use softray::modules::{
    ExposureParams, ExposureParamsConfig, RotationForm, SurfaceNetworkConfig, TexturedMeshParams,
    ViewpointParams, cast, load_safetensors, save_safetensors,
};
use softray::prelude::*;

/// One of each.
#[derive(Module, Debug)]
struct OneOfEach {
    mesh: MeshParams,
    offsets: MeshOffsets,
    pose: RigidTransform,
    camera: CameraParams,
    texture: TextureParams,
    relief: NormalMapParams,
    sky: EnvironmentParams,
    surface: MaterialParams,
    object: TexturedMeshParams,
    exposure: ExposureParams,
    views: ViewpointParams,
}

fn one_of_each(device: &Device) -> OneOfEach {
    let ball = shapes::icosahedron(device);
    OneOfEach {
        mesh: MeshParams::from_mesh(&ball, device).expect("a mesh"),
        offsets: MeshOffsets::from_mesh(&ball, device).expect("a mesh"),
        pose: pose(device, Some(1.0)),
        camera: CameraParamsConfig::new([0.0, 0.0, 4.0], [0.0; 3])
            .with_lens(Some([0.1, 3.0]))
            .init(device)
            .expect("a camera")
            .freeze_lens(),
        texture: TextureParamsConfig::new(3, 4)
            .init(device)
            .expect("a texture"),
        relief: NormalMapParamsConfig::new(2, 3)
            .init(device)
            .expect("a map"),
        sky: EnvironmentParamsConfig::new(2, 4)
            .init(device)
            .expect("a sky"),
        surface: MaterialParamsConfig::new()
            .with_specular(Some([0.2; 3]))
            .with_emission(Some([1.0; 3]))
            .init(device)
            .expect("a material"),
        object: textured(device).expect("an object"),
        exposure: ExposureParamsConfig::new(3).init(device).expect("factors"),
        views: {
            let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
            ViewpointParams::from_cameras(&[camera], 4.0, device).expect("cameras")
        },
    }
}

fn textured(device: &Device) -> softray::Result<TexturedMeshParams> {
    let ball = TriangleMesh::try_from(&shapes::icosahedron(device))?;
    let network = SurfaceNetworkConfig::new().with_width(4).init(device)?;
    TexturedMeshParams::from_mesh(&ball, 0.3, [0.5; 3], network, device)?.with_normal_map()
}

fn pose(device: &Device, scale: Option<f64>) -> RigidTransform {
    let pose = RigidTransformConfig::new().with_scale(scale).init(device);
    pose.expect("a pose")
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("modules-{name}"))
}

/// Saved after every parameter was changed, and loaded into the module as it was: by both formats.
fn round_trip<M: Module>(name: &str, module: M) {
    let before = parameters(&module, None);
    let moved = changed(module.clone(), |_, i, v| v + 0.1 + 0.01 * i as f64);
    let expected = parameters(&moved, None);
    assert!(
        before
            .iter()
            .zip(&expected)
            .all(|(a, b)| a.values != b.values)
    );
    let file = path(&format!("{name}.safetensors"));
    save_safetensors(&moved, &file).expect("a file");
    let loaded = load_safetensors(module.clone(), &file).expect("a module");
    assert_eq!(parameters(&loaded, None), expected);
    let file = path(&format!("{name}.bpk"));
    moved.save_file(&file).expect("a file");
    let loaded = module.try_load_file(&file).expect("a module");
    assert_eq!(parameters(&loaded, None), expected);
}

#[test]
fn parameters_come_back_from_files() {
    let all = one_of_each(&Device::flex().autodiff());
    let found = parameters(&all, None);
    let trained = |name: &str| found.iter().find(|p| p.name == name).expect(name).trained;
    assert!(trained("mesh.vertices") && trained("camera.eye"));
    assert!(!trained("camera.up") && !trained("camera.lens.log_focus"));
    assert!(trained("object.surface.last.weight") && !trained("object.mesh.vertices"));
    round_trip("mesh", all.mesh.clone());
    round_trip("offsets", all.offsets.clone());
    round_trip("pose", all.pose.clone());
    round_trip("camera", all.camera.clone());
    round_trip("texture", all.texture.clone());
    round_trip("sky", all.sky.clone());
    round_trip("surface", all.surface.clone());
    round_trip("object", all.object.clone());
    round_trip("exposure", all.exposure.clone());
    round_trip("views", all.views.clone());
    round_trip("all", all);
}

/// The float type is the module's, whatever the file's.
#[test]
fn files_take_the_modules_float_type() {
    let device = Device::flex().autodiff();
    let file = path("f64.safetensors");
    save_safetensors(&cast(one_of_each(&device), DType::F64), &file).expect("a file");
    let loaded = load_safetensors(one_of_each(&device), &file).expect("a module");
    assert_eq!(loaded.mesh.vertices.val().dtype(), DType::F32);
    assert!(loaded.mesh.vertices.val().is_require_grad());
    let same = parameters(&one_of_each(&device), None);
    assert_eq!(parameters(&loaded, None), same);
    // Burn's records bring theirs: constants follow.
    let offsets = MeshOffsets::from_mesh(&shapes::icosahedron(&device), &device);
    let offsets = offsets.expect("a mesh");
    let double = cast(offsets.clone(), DType::F64).into_record();
    let mesh = offsets.try_load_record(double).expect("a module").mesh();
    assert_eq!(mesh.vertices.dtype(), DType::F64);
}

#[test]
fn what_does_not_fit_is_named() {
    let device = Device::flex().autodiff();
    let [coarse, fine] = [0, 1].map(|level| {
        let ball = shapes::icosphere(level, &device);
        MeshParams::from_mesh(&ball, &device).expect("a mesh")
    });
    let file = path("fine.safetensors");
    save_safetensors(&fine, &file).expect("a file");
    let error = load_safetensors(coarse.clone(), &file).expect_err("another number of vertices");
    assert!(matches!(error, Error::Invalid { .. }));
    says(
        &error,
        [
            "fine.safetensors: vertices is of shape [42, 3]",
            "shape [12, 3]",
        ],
    );
    let error = coarse.clone().try_load_record(fine.clone().into_record());
    says(message(error), ["vertices", "[12, 3]", "[42, 3]"]);

    let offsets = MeshOffsets::from_mesh(&shapes::icosphere(1, &device), &device);
    let error = load_safetensors(offsets.expect("a mesh"), &file).expect_err("other names");
    says(&error, ["offsets is missing"]);
    let scaled = pose(&device, Some(2.0));
    let file = path("scaled.safetensors");
    save_safetensors(&scaled, &file).expect("a file");
    let error = load_safetensors(pose(&device, None), &file).expect_err("no scale");
    says(&error, ["log_scale is in the file alone"]);
    let turned = RigidTransformConfig::new()
        .with_rotation(RotationForm::Quaternion)
        .with_scale(Some(1.0))
        .init(&device);
    let error = load_safetensors(turned.expect("a pose"), &file).expect_err("another form");
    says(&error, ["rotation is of shape [6]", "shape [4]"]);

    let absent = path("absent.safetensors");
    let error = load_safetensors(coarse.clone(), &absent).expect_err("no file");
    assert!(matches!(error, Error::Io { .. }), "{error}");
    says(&error, ["absent.safetensors"]);
    let broken = path("broken.safetensors");
    std::fs::write(&broken, b"no tensors").expect("a file");
    let error = load_safetensors(coarse.clone(), &broken).expect_err("no tensors");
    assert!(matches!(error, Error::Format { .. }), "{error}");
    let nowhere = path("no-such-folder").join("a.safetensors");
    let error = save_safetensors(&coarse, &nowhere).expect_err("no folder");
    says(&error, ["no-such-folder"]);
}

/// A file's names have a version: a newer one is refused, and an error about older names lists today's.
#[test]
fn names_have_a_version() {
    use burn::module::Param;
    use burn::store::{ModuleSnapshot, SafetensorsStore};

    /// A material as it was before versions.
    #[derive(Module, Debug)]
    struct Old {
        shares: Param<Tensor<2>>,
    }
    #[derive(Module, Debug)]
    struct Holder<M: Module> {
        surface: M,
    }
    let device = Device::flex().autodiff();
    let today = || Holder {
        surface: MaterialParamsConfig::new()
            .init(&device)
            .expect("a material"),
    };
    let file = path("version.safetensors");
    let write = |version: Option<&str>| {
        let store = SafetensorsStore::from_file(&file).overwrite(true);
        let mut store = match version {
            Some(version) => store.metadata("softray_format", version),
            None => store,
        };
        today().save_into(&mut store).expect("a file");
    };
    save_safetensors(&today(), &file).expect("a file");
    let header = std::fs::read(&file).expect("a file");
    let header = String::from_utf8_lossy(&header);
    assert!(header.contains(r#""softray_format":"1""#), "{header}");
    for fits in [None, Some("1")] {
        write(fits);
        load_safetensors(today(), &file).expect("a module");
    }
    for newer in ["2", "new"] {
        write(Some(newer));
        let error = load_safetensors(today(), &file).expect_err("a newer file");
        let found = format!("version.safetensors: softray_format is {newer}");
        says(&error, [&*found, "a version up to 1"]);
    }
    let old = Holder {
        surface: Old {
            shares: Param::from_tensor(Tensor::zeros([3, 2], &device)),
        },
    };
    let mut store = SafetensorsStore::from_file(&file).overwrite(true);
    old.save_into(&mut store).expect("a file");
    let error = load_safetensors(today(), &file).expect_err("earlier names");
    let parts = [
        "softray_format is absent",
        "surface.shares, now logit_shares",
    ];
    says(&error, parts);

    // The name is another program's where no new name is missing beside it.
    #[derive(Module, Debug)]
    struct Network {
        surface: MaterialParams,
        head: Logits,
    }
    #[derive(Module, Debug)]
    struct Logits {
        logits: Param<Tensor<1>>,
    }
    let network = Network {
        surface: today().surface,
        head: Logits {
            logits: Param::from_tensor(Tensor::zeros([2], &device)),
        },
    };
    let mut store = SafetensorsStore::from_file(&file).overwrite(true);
    network.save_into(&mut store).expect("a file");
    let error = load_safetensors(today(), &file).expect_err("one more parameter");
    says(&error, ["head.logits is in the file alone"]);
}

/// Saving replaces the file, and leaves nothing beside it.
#[test]
fn files_are_replaced_whole() {
    let folder = path("replaced");
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join("pose.safetensors");
    let device = Device::flex();
    for x in [1.0, 2.0] {
        let pose = RigidTransformConfig::new()
            .with_translation([x, 0.0, 0.0])
            .init(&device);
        save_safetensors(&pose.expect("a pose"), &file).expect("a file");
    }
    let loaded = load_safetensors(pose(&device, None), &file).expect("a module");
    assert_eq!(common::values(&loaded.translation.val()), [2.0, 0.0, 0.0]);
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 1);
}
