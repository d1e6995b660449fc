//! Gradients of the Cornell box by every class of parameter against central differences.

use crate::common;
use crate::common::scenes::scene_file;
use burn::tensor::Device;
use softray::gradcheck::{Checked, GradCheck, Point, gradcheck};
use softray::prelude::*;

/// The standard error of each side as a share of the derivative: `SOFTRAY_PRECISION`, or 0.5 %,
/// which takes some minutes.
fn cornell_precision() -> f64 {
    let given = std::env::var("SOFTRAY_PRECISION").ok();
    given.and_then(|p| p.parse().ok()).unwrap_or(0.005)
}

/// The Cornell box with every class of parameter: its light turns, moves and has a free vertex, the
/// back wall has a texture under a gloss, the camera a lens. The light hangs off the ceiling.
fn cornell_box(point: &Point, camera: Camera) -> softray::Result<(Scene, Camera)> {
    let mut scene = scene_file("cornell", &point.device).scene;
    for object in &mut scene.objects {
        object.mesh = object.mesh.clone().cast(point.dtype);
    }
    let (vertex, translation) = (point.get("vertex")?, point.get("translation")?);
    let turn = Transform::new()
        .with_axis_angle([1.0, 0.2, 0.3], point.get("rotation")? * 1f64.to_degrees());
    let velocity = point.get("velocity")?;
    let constant = |v: &[f64]| Tensor::<1>::from_data(v, (&point.device, point.dtype));
    let texel = point.get("texel")?.reshape([1, 1, 1]);
    let rest = constant(&[0.5, 0.4, 0.3, 0.2, 0.5, 0.4, 0.4, 0.3, 0.5, 0.3, 0.3, 0.3]);
    let first = constant(&[0.7, 0.6, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
    let texels = rest.reshape([2, 2, 3]) + first.reshape([2, 2, 3]) * texel;
    let emission = point.get("emission")? * constant(&[1.0, 0.8, 0.5]);
    let gloss = (point.get("specular")?.expand([3]), point.get("shininess")?);
    let wall = point.get("albedo")? * constant(&[1.0, 0.3, 0.2]);
    let one_row = |rows: usize| {
        let one: Vec<f64> = (0..rows).map(|i| if i == 0 { 1.0 } else { 0.0 }).collect();
        constant(&one).reshape([rows, 1])
    };
    let scene = scene
        .map_object("light", |o| {
            let o = o.with_material(Material::emitter(emission.clone()));
            o.with_velocity(velocity.clone()).map_mesh(|m| {
                let middle = m.vertices.clone().mean_dim(0).reshape([3]);
                let hung = constant(&[0.0, -0.8, 0.0]);
                let m = m.translated(middle.clone().neg()).transformed(&turn);
                let moved = one_row(m.vertices.dims()[0]) * vertex.clone().reshape([1, 3]);
                let vertices = m.vertices.clone() + moved;
                m.with_vertices(vertices)
                    .translated(middle + hung + translation.clone())
            })
        })?
        .map_object("back", |o| {
            let diffuse = ColorTexture::texture(texels.clone());
            o.with_material(Material::phong(diffuse, gloss.0.clone(), gloss.1.clone()))
                .map_mesh(|m| {
                    let flat: Vec<f64> = m
                        .host_vertices()
                        .expect("vertices")
                        .iter()
                        .flat_map(|v| [v[0] / 5.0, v[1] / 5.0])
                        .collect();
                    let uvs = constant(&flat).reshape([flat.len() / 2, 2]);
                    m.with_uvs(uvs)
                })
        })?
        .map_object("left", |o| o.with_material(Material::diffuse(wall.clone())))?
        .with_environment(point.get("environment")?.expand([3]));
    Ok((scene, camera))
}

/// Mean radiance, counted most about a place of the image.
fn spot(at: [f64; 2], width: f64) -> impl Fn(Tensor<3>) -> Tensor<1> + Send + Sync {
    move |image| {
        let [h, w, _] = image.dims();
        let weights: Vec<f64> = (0..h * w)
            .map(|i| {
                let y = ((i / w) as f64 + 0.5) / h as f64;
                let x = ((i % w) as f64 + 0.5) / w as f64;
                let spot = ((x - at[0]).powi(2) + (y - at[1]).powi(2)) / (width * width);
                0.2 + 0.1 * x + 2.0 * (-spot).exp()
            })
            .collect();
        let like = (&image.device().inner(), image.dtype());
        let weights = Tensor::<1>::from_data(weights.as_slice(), like).reshape([h, w, 1]);
        (image * weights).mean()
    }
}

/// Geometry, motion and camera where the light is looked at from below, materials where the box is
/// looked into: each class where it shows.
#[test]
fn the_cornell_box_in_every_class_of_parameter() {
    let long = common::long();
    let options = RenderOptions::new(12, 12)
        .with_samples(16)
        .with_bounces(1)
        .with_blur(2.865);
    let (precision, least, most) = if long {
        (cornell_precision(), 256, 1_000_000)
    } else {
        (0.08, 32, 4000)
    };
    let settings = |options: &RenderOptions, at, width| {
        GradCheck::new(options.clone(), &Device::flex())
            .with_precision(precision)
            .with_tolerance(0.01)
            .with_seeds(least, most)
            .with_objective(spot(at, width))
    };
    let shift = [0.3, 1.0, -0.4];
    let all = |environment: f64| {
        [
            Checked::new("vertex", [0.0; 3], 0.03).with_direction(shift),
            Checked::new("translation", [0.0; 3], 0.02).with_direction(shift),
            Checked::new("rotation", [0.1], 0.02),
            Checked::new("velocity", [0.2, 0.0, 0.1], 0.04).with_direction(shift),
            Checked::new("eye", [3.9, 1.0, 1.0], 0.03).with_direction([-0.2, 1.0, 0.3]),
            Checked::new("fov", [45.0], 0.5),
            Checked::new("aperture", [0.5], 0.03),
            Checked::new("focus", [2.5], 0.08),
            Checked::new("albedo", [0.3], 0.1),
            Checked::new("texel", [0.4], 0.2),
            Checked::new("specular", [0.3], 0.15),
            Checked::new("shininess", [12.0], 1.0),
            Checked::new("emission", [10.0], 2.0),
            Checked::new("environment", [environment], 0.1),
        ]
    };
    let start = std::time::Instant::now();
    let report = |looking: &str, settings: GradCheck, environment: f64| {
        let report = gradcheck(&all(environment), &settings, |point| {
            let camera = Camera::look_at(point.get("eye")?, [2.78, 5.49, 2.8])
                .with_fov_y(point.get("fov")?)
                .with_thin_lens(point.get("aperture")?, point.get("focus")?);
            let inside = Camera::look_at([2.78, 2.73, -8.0], [2.78, 2.73, 0.0]).with_fov_y(39.3);
            cornell_box(point, if looking == "up" { camera } else { inside })
        });
        let report = report.expect("a report");
        println!("{report}{:.0} s", start.elapsed().as_secs_f64());
        report.rows
    };
    let geometry = ["vertex", "translation", "rotation", "velocity"];
    let camera = ["eye", "fov", "aperture", "focus"];
    let up = settings(&options, [0.55, 0.45], 0.2).with_parameters(&[geometry, camera].concat());
    let light = ["albedo", "texel", "emission", "environment"];
    let inside = settings(&options, [0.5, 0.25], 0.3).with_parameters(&light);
    // Bounced light brings the derivative of a lobe's width much noise, and little else.
    let direct = options.clone().with_bounces(0);
    let gloss = settings(&direct, [0.5, 0.33], 0.08).with_parameters(&["specular", "shininess"]);
    let rows = [
        report("up", up, 0.2),
        report("in", inside, 0.2),
        report("in", gloss, 0.0),
    ]
    .concat();
    let report = softray::gradcheck::Report { rows };
    println!("mean relative error {:.4}", report.mean_relative_error());
    assert!(report.agrees(), "{report}");
    if long {
        let bound = cornell_precision().max(0.01);
        assert!(report.mean_relative_error() <= bound, "{report}");
    }
}
