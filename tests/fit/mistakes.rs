//! Wrong arguments of trained parts and losses.

use crate::common::folder::Folder;
use crate::common::mistakes::{Mistakes, ball, flex, see};
use burn::tensor::Tensor;
use softray::modules::{
    CameraParamsConfig, EnvironmentParamsConfig, MaterialParams, MaterialParamsConfig,
    RenderLossConfig, Renderer, RigidTransformConfig, TextureParams,
};
use softray::optim::{BlurSchedule, LargeSteps, LargeStepsConfig, MeshRegularizer};
use softray::prelude::*;

#[test]
fn modules() {
    let mut mistakes = Mistakes::default();
    let device = flex().autodiff();
    mistakes.expect("fov of a module", &["fov_y", "0", "(1, 170)"], || {
        CameraParamsConfig::new([0.0, 0.0, 4.0], [0.0; 3])
            .with_fov_y(0.0)
            .init(&device)
    });
    mistakes.expect(
        "too much albedo",
        &["diffuse + specular", "1.4", "at most 1"],
        || {
            MaterialParamsConfig::new()
                .with_diffuse([0.7; 3])
                .with_specular(Some([0.7; 3]))
                .init(&device)
        },
    );
    mistakes.expect(
        "a texture as material",
        &["diffuse", "texture", "TextureParams"],
        || {
            let texels = Tensor::ones([2, 2, 3], &flex());
            MaterialParams::from_material(
                &Material::diffuse(ColorTexture::texture(texels)),
                &device,
            )
        },
    );
    mistakes.expect("a texture of bytes", &["texture", "255", "[0, 1]"], || {
        TextureParams::from_image(&Tensor::full([2, 2, 3], 255.0, &flex()), &device)
    });
    mistakes.expect(
        "a dark sky",
        &["environment", "radiance", "-1", "≥ 0"],
        || {
            EnvironmentParamsConfig::new(2, 4)
                .with_radiance([-1.0; 3])
                .init(&device)
        },
    );
    mistakes.expect("a sky without texels", &["environment", "0 × 4"], || {
        EnvironmentParamsConfig::new(0, 4).init(&device)
    });
    let pose = || RigidTransformConfig::new();
    mistakes.expect("a scale of 0", &["scale", "0", "> 0"], || {
        pose().with_scale(Some(0.0)).init(&device)
    });
    mistakes.expect("no columns", &["width", "0"], || {
        Renderer::new(RenderOptions::new(0, 4))
    });
    mistakes.expect("weights", &["weights", "0"], || {
        RenderLossConfig::new().with_mse(0.0).init()
    });
    mistakes.expect(
        "no vertices",
        &["regularizer", "face 0", "[0, 1, 2]"],
        || MeshRegularizer::new(&[[0, 1, 2]], 2, &device),
    );
    mistakes.expect("lambda", &["large steps", "lambda", "-1"], || {
        LargeSteps::from_mesh(&ball().mesh, &LargeStepsConfig::default().with_lambda(-1.0))
    });
    mistakes.expect("blur that rises", &["end", "0.1", "0.01"], || {
        BlurSchedule::decay(0.01, 0.1, 10)
    });
    mistakes.expect("blur to 0", &["end", "0", "> 0"], || {
        BlurSchedule::decay(0.01, 0.0, 10)
    });
    #[cfg(feature = "safetensors")]
    {
        use softray::modules::load_safetensors;
        let folder = Folder::new("modules");
        let path = folder.write("a.safetensors", "nothing");
        mistakes.expect("no safetensors file", &["b.safetensors", "No such"], || {
            load_safetensors(pose().init(&device)?, folder.path("b.safetensors"))
        });
        mistakes.expect("no safetensors", &["a.safetensors"], || {
            load_safetensors(pose().init(&device)?, &path)
        });
    }
}

#[test]
fn losses() {
    let mut mistakes = Mistakes::default();
    let image = |shape: [usize; 3]| Tensor::<3>::ones(shape, &flex());
    let parts = ["shape", "[4, 4, 3]", "[4, 5, 3]"];
    let (a, b) = (image([4, 4, 3]), image([4, 5, 3]));
    mistakes.expect("mse", &parts, || loss::mse(a.clone(), b.clone()));
    mistakes.expect("mse_unbiased", &parts, || {
        loss::mse_unbiased(a.clone(), a.clone(), b.clone())
    });
    mistakes.expect("l1", &parts, || loss::l1(a.clone(), b.clone()));
    mistakes.expect("no pixels", &["mse", "[0, 4, 3]", "at least 1"], || {
        loss::mse(image([0, 4, 3]), image([0, 4, 3]))
    });
    mistakes.expect("no levels", &["pyramid", "levels", "0"], || {
        loss::pyramid(a.clone(), 0)
    });
    mistakes.expect("range", &["ssim", "range", "0", "> 0"], || {
        loss::dssim(a.clone(), a.clone(), 0.0)
    });
    mistakes.expect("float types", &["l1", "dtype", "F64", "F32"], || {
        loss::l1(a.clone().cast(burn::tensor::DType::F64), a.clone())
    });
    // Burn's own message.
    mistakes.expect_panic("backward of a constant", &["require_grad()"], || {
        let mesh = shapes::cube(&flex().autodiff());
        let image = see(Object::new(mesh)).expect("an image");
        image.radiance.mean().backward()
    });
}
